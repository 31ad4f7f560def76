//! Dependencies between the files of a crate, from a scan of the source text: no files may form a circle.
//!
//! A path is followed to the file that defines the item: `crate::Thing`, where the root says `pub use thing::Thing;`, is a use of
//! `thing.rs`. Declaring a module (`mod x;`) and re-exporting from it (`pub use x::...`) is not a use. Test modules are ignored.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A module's path within its crate; the root is empty.
type Module = Vec<String>;

/// The source files of a crate.
#[derive(Debug, Default)]
pub struct Modules {
    sources: BTreeMap<Module, String>,
}

impl Modules {
    /// Reads all files below a crate's `src`, except `main.rs`.
    ///
    /// # Panics
    /// If a file cannot be read.
    pub fn read(src: &Path) -> Self {
        let mut modules = Self::default();
        modules.read_folder(src, &Vec::new());
        modules
    }

    fn read_folder(&mut self, folder: &Path, at: &Module) {
        for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path())
        {
            let name = entry.file_stem().expect("a name").to_string_lossy().into_owned();
            let child = || at.iter().cloned().chain([name.clone()]).collect::<Module>();
            if entry.is_dir() {
                self.read_folder(&entry, &child());
            } else if entry.extension().is_some_and(|ending| ending == "rs") && name != "main" {
                let module = if name == "mod" || name == "lib" { at.clone() } else { child() };
                self.sources.insert(module, code(&std::fs::read_to_string(&entry).expect("readable")));
            }
        }
    }

    /// Groups of files that all use each other, directly or through further files.
    pub fn circles(&self) -> Vec<Vec<String>> {
        let uses: BTreeMap<&Module, BTreeSet<Module>> =
            self.sources.keys().map(|module| (module, self.uses(module))).collect();
        let reach = |from: &Module| {
            let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
            while let Some(module) = open.pop() {
                for next in &uses[&module] {
                    if seen.insert(next.clone()) {
                        open.push(next.clone());
                    }
                }
            }
            seen
        };
        let reached: BTreeMap<&Module, BTreeSet<Module>> =
            uses.keys().map(|module| (*module, reach(module))).collect();
        let mut circles = BTreeSet::new();
        for (module, others) in reached.iter().filter(|(module, others)| others.contains(**module)) {
            let circle: BTreeSet<&Module> =
                others.iter().filter(|other| reached[*other].contains(*module)).collect();
            circles.insert(circle);
        }
        circles.iter().map(|circle| circle.iter().map(|module| name(module)).collect()).collect()
    }

    /// The other files that a file uses.
    fn uses(&self, module: &Module) -> BTreeSet<Module> {
        let mut found = BTreeSet::new();
        for (path, is_re_export) in paths(&self.sources[module]) {
            if !is_re_export && let Some(other) = self.resolve(module, &path, 0) {
                found.insert(other);
            }
        }
        found.remove(module);
        found
    }

    /// File that defines the item of `path` as written in `module`; `None` for other crates and local names.
    fn resolve(&self, module: &Module, path: &[String], depth: usize) -> Option<Module> {
        let mut at = module.clone();
        let mut rest = path;
        match path.first().map(String::as_str) {
            Some("crate") => (at, rest) = (Module::new(), &path[1..]),
            Some("self") => rest = &path[1..],
            Some("super") => {
                while rest.first().is_some_and(|part| part == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            Some(first) => {
                let child: Module = at.iter().chain([&first.to_owned()]).cloned().collect();
                if !self.sources.contains_key(&child) {
                    return None;
                }
            }
            None => return None,
        }
        while let Some(part) = rest.first() {
            let child: Module = at.iter().chain([part]).cloned().collect();
            if !self.sources.contains_key(&child) {
                break;
            }
            (at, rest) = (child, &rest[1..]);
        }
        // An item that this module only passes on is used where it is defined.
        if let Some(item) = rest.first().filter(|_| depth < 8) {
            for (target, is_re_export) in paths(self.sources.get(&at)?) {
                if is_re_export && target.len() > 1 && target.last() == Some(item) {
                    return self.resolve(&at, &target, depth + 1).or(Some(at));
                }
            }
        }
        Some(at)
    }
}

fn name(module: &Module) -> String {
    if module.is_empty() { "the crate's root".into() } else { module.join("::") }
}

/// Source text without comments, strings and inline test modules.
fn code(text: &str) -> String {
    let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let mut code = String::new();
    for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
        let line = line.split(" // ").next().unwrap_or_default();
        code.extend(line.split('"').step_by(2));
        code.push('\n');
    }
    code
}

/// All paths of a source text, and whether each is a re-export.
fn paths(code: &str) -> Vec<(Vec<String>, bool)> {
    let mut found = Vec::new();
    let mut rest = code;
    while let Some(start) = rest.find("use ") {
        let before = &rest[..start];
        inline_paths(before, &mut found);
        let is_statement = before.trim_end_matches([' ', '\t']).ends_with(['\n', ')', '}'])
            || before.is_empty()
            || before.ends_with("pub ");
        let end = rest[start..].find(';').map_or(rest.len(), |end| start + end);
        if is_statement {
            let re_export = before.trim_end().ends_with("pub") || before.trim_end().ends_with(')');
            let tree = rest[start + 4..end].split_whitespace().collect::<Vec<_>>().join(" ");
            expand("", &tree, re_export, &mut found);
            rest = &rest[end..];
        } else {
            rest = &rest[start + 4..];
        }
    }
    inline_paths(rest, &mut found);
    found
}

/// `a::{b, c::d}` to `a::b` and `a::c::d`.
fn expand(prefix: &str, tree: &str, re_export: bool, found: &mut Vec<(Vec<String>, bool)>) {
    let Some((head, body)) = tree.split_once('{') else {
        // A new name (`as`) does not change what is used.
        let tree = tree.split(" as ").next().unwrap_or_default();
        let path = format!("{prefix}{tree}").replace(' ', "").replace("::self", "");
        found.push((path.split("::").map(str::to_owned).collect(), re_export));
        return;
    };
    let body = body.strip_suffix('}').unwrap_or(body);
    let (mut depth, mut start) = (0_i32, 0);
    for (at, c) in body.char_indices().chain([(body.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if at > start {
                    expand(&format!("{prefix}{head}"), &body[start..at], re_export, found);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// Paths within expressions and types.
fn inline_paths(code: &str, found: &mut Vec<(Vec<String>, bool)>) {
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for token in code.split(|c: char| !is_path(c)).filter(|token| token.contains("::")) {
        let parts: Vec<String> =
            token.trim_matches(':').split("::").map(str::to_owned).take_while(|p| !p.is_empty()).collect();
        if parts.len() > 1 {
            found.push((parts, false));
        }
    }
}
