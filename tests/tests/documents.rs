//! Documents compared with the repository: the two tables of files in ARCHITECTURE.md (the way of a reading, the way of training), links,
//! paths of files, and what a reader is told to type.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// One row: a file, the types it passes on, and the items it calls, each defined in another file of the table.
struct Row {
    file: String,
    text: String,
    data: Vec<String>,
    calls: Vec<String>,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &str) -> Option<String> {
    std::fs::read_to_string(root().join(path)).ok()
}

/// The words in backticks of a cell.
fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Words of Rust source text without comments.
fn words(text: &str) -> Vec<&str> {
    text.lines()
        .filter_map(|line| line.split("//").next())
        .flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .filter(|word| !word.is_empty())
        .collect()
}

/// True if the text defines a function, type, trait, constant or macro of this name.
fn defines(text: &str, name: &str) -> bool {
    const KEYWORDS: [&str; 7] = ["fn", "struct", "enum", "trait", "type", "const", "macro_rules"];
    words(text).windows(2).any(|pair| KEYWORDS.contains(&pair[0]) && pair[1] == name)
}

/// The rows `| step | file | data | calls |` below a heading.
fn table(heading: &str) -> Vec<Row> {
    let document = read("ARCHITECTURE.md").expect("ARCHITECTURE.md");
    let section = document.split("\n## ").find(|section| section.starts_with(heading)).expect(heading);
    let mut rows = Vec::new();
    for line in section.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| ---")).skip(1) {
        let cells: Vec<&str> = line.split('|').collect();
        let [_, _, file, data, calls, _] = cells.as_slice() else {
            panic!("{heading}: expected four cells: {line}")
        };
        let [file] =
            quoted(file).try_into().unwrap_or_else(|_| panic!("{heading}: expected one file: {line}"));
        let text =
            read(&format!("crates/{file}")).unwrap_or_else(|| panic!("{heading}: no file crates/{file}"));
        rows.push(Row { file, text, data: quoted(data), calls: quoted(calls) });
    }
    rows
}

/// Compares a table with its files: data and calls occur in the row's file, each call is defined in another row's file, and the calls
/// connect all files.
fn check(heading: &str, least: usize) {
    let rows = table(heading);
    assert!(rows.len() >= least, "{heading}: only {} rows", rows.len());
    let mut edges = Vec::new();
    for (at, row) in rows.iter().enumerate() {
        let here = words(&row.text);
        for name in row.data.iter().chain(&row.calls) {
            assert!(here.contains(&name.as_str()), "{heading}: {} does not contain `{name}`", row.file);
        }
        for name in &row.calls {
            let place = (0..rows.len()).find(|other| *other != at && defines(&rows[*other].text, name));
            edges.push((at, place.unwrap_or_else(|| panic!("{heading}: no other row defines `{name}`"))));
        }
    }
    let mut reached = BTreeSet::from([0]);
    for _ in &rows {
        for (a, b) in &edges {
            if reached.contains(a) || reached.contains(b) {
                reached.extend([*a, *b]);
            }
        }
    }
    let apart: Vec<&str> =
        (0..rows.len()).filter(|at| !reached.contains(at)).map(|at| rows[at].file.as_str()).collect();
    assert!(apart.is_empty(), "{heading}: no calls connect {apart:?} with {}", rows[0].file);
}

#[test]
fn files_of_a_reading_call_each_other_as_the_architecture_shows() {
    check("The way of a reading", 10);
}

#[test]
fn files_of_training_call_each_other_as_the_architecture_shows() {
    check("The way of training", 10);
}

/// Documents of a folder, by their path.
fn documents_of(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let documents = entries.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    documents.map(|path| (path.clone(), std::fs::read_to_string(path).expect("UTF-8"))).collect()
}

fn documents() -> Vec<(PathBuf, String)> {
    let inner = ["models/shapes", "examples/gallery"].map(|at| root().join(at));
    let inner = inner.into_iter().flat_map(|at| std::fs::read_dir(at).expect("a folder"));
    let inner = inner.map(|entry| entry.expect("an entry").path()).filter(|path| path.is_dir());
    let folders = ["", "docs", "docs/clients", "docs/report", "examples/gallery"].map(|at| root().join(at));
    folders.into_iter().chain(inner).flat_map(|folder| documents_of(&folder)).collect()
}

/// Anchors of a document's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let anchor = |line: &str| {
        let title = line.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
        title.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    let (mut checked, mut broken) = (0, Vec::new());
    for (path, text) in documents() {
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for target in targets.filter(|target| !target.contains("://")) {
            let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
            let other = if file.is_empty() { path.clone() } else { path.with_file_name("").join(file) };
            let has_anchor = || anchors(&std::fs::read_to_string(&other).expect("UTF-8")).contains(anchor);
            if !other.exists() || !(anchor.is_empty() || has_anchor()) {
                broken.push(format!("{}: {target}", path.display()));
            }
            checked += 1;
        }
    }
    assert!(checked >= 50 && broken.is_empty(), "{checked} links, without a file or heading: {broken:#?}");
}

/// Paths below these folders that a document names exist; those with a placeholder in capitals or an asterisk are left out.
#[test]
fn paths_that_documents_name_exist() {
    const FOLDERS: [&str; 9] = [
        "clients/",
        "config/",
        "crates/",
        "docs/",
        "examples/",
        "models/",
        "scripts/",
        "studies/",
        "tests/tests/",
    ];
    let (mut checked, mut missing) = (0, Vec::new());
    for (path, text) in documents() {
        let words = text.split(|c: char| !c.is_alphanumeric() && !"/._-*@".contains(c));
        for word in words.map(|word| word.trim_end_matches(['.', '/'])) {
            let is_pattern = word.contains('*') || word.split(['/', '.']).any(|part| part == "NAME");
            if is_pattern || !FOLDERS.iter().any(|folder| word.starts_with(folder)) {
                continue;
            }
            // A link counts from the document's folder.
            let beside = path.parent().is_some_and(|folder| folder.join(word).exists());
            if !root().join(word).exists() && !beside {
                missing.push(format!("{}: {word}", path.display()));
            }
            checked += 1;
        }
    }
    assert!(checked >= 50 && missing.is_empty(), "{checked} paths, missing: {missing:#?}");
}

/// File, language and text of every fenced block.
fn blocks() -> Vec<(PathBuf, String, String)> {
    let mut blocks = Vec::new();
    for (file, text) in documents() {
        // Odd parts stand between the fences.
        for block in text.split("\n```").skip(1).step_by(2) {
            let (language, body) = block.split_once('\n').unwrap_or((block, ""));
            blocks.push((file.clone(), language.to_owned(), body.to_owned()));
        }
    }
    blocks
}

/// The commands of a shell script, each as its words: enough of the shell for what documents show, which are quotes, comments, continued
/// lines, and what stands between commands.
fn commands(script: &str) -> Vec<Vec<String>> {
    let (mut commands, mut words, mut word) = (vec![], vec![], None::<String>);
    let mut quote = None;
    let script = script.replace("\\\n", " ");
    let mut characters = script.chars();
    while let Some(c) = characters.next() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), c) => word.get_or_insert_default().push(c),
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, '#') if word.is_none() => {
                // A comment ends with its line, and so does the command before it.
                let _ = characters.by_ref().find(|c| *c == '\n');
                commands.push(std::mem::take(&mut words));
            }
            (None, ' ' | '\t') => words.extend(word.take()),
            (None, '\n' | '|' | '&' | ';' | '<' | '>' | '(' | ')') => {
                words.extend(word.take());
                commands.push(std::mem::take(&mut words));
            }
            (None, c) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    commands.push(words);
    commands.retain(|words| !words.is_empty());
    commands
}

/// `scripts/check.sh documents`, `gallery`, `actuators` and `clients` run those that take seconds, those of the gallery, of the shapes and of
/// the Python pages.
#[test]
fn commands_in_documents_are_ones_that_the_program_takes() {
    use clap::Subcommand;
    let program = softtwin::Command::augment_subcommands(clap::Command::new("softtwin"));
    let (mut checked, mut wrong) = (0, Vec::new());
    for (file, language, body) in blocks() {
        if language != "sh" {
            continue;
        }
        for words in commands(&body).into_iter().filter(|words| words[0] == "softtwin") {
            if let Err(error) = program.clone().try_get_matches_from(&words) {
                let said = error.to_string();
                wrong.push(format!(
                    "{}: {}: {}",
                    file.display(),
                    words.join(" "),
                    said.lines().next().unwrap()
                ));
            }
            checked += 1;
        }
    }
    assert!(checked >= 100 && wrong.is_empty(), "{checked} commands, wrong: {wrong:#?}");
}

#[test]
fn files_in_documents_can_be_read() {
    let (mut checked, mut wrong) = (0, Vec::new());
    for (file, language, body) in blocks() {
        let failure = match language.as_str() {
            "toml" => body.parse::<toml::Table>().err().map(|error| error.to_string()),
            "json" => serde_json::from_str::<serde_json::Value>(&body).err().map(|error| error.to_string()),
            _ => continue,
        };
        wrong.extend(failure.map(|error| format!("{}: {error}", file.display())));
        checked += 1;
    }
    assert!(checked >= 10 && wrong.is_empty(), "{checked} blocks, wrong: {wrong:#?}");
}

#[test]
fn a_script_is_taken_apart_as_a_shell_does() {
    let found = commands("a --b 'c d' \\\n  e=\"f\" # not | this\nsofttwin x >out && y; z#1 &");
    let expected = [&["a", "--b", "c d", "e=f"][..], &["softtwin", "x"], &["out"], &["y"], &["z#1"]];
    assert_eq!(found, expected);
}
