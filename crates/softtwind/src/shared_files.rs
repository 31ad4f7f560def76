//! Files that come with the programs: scenes, traces, models. They are in a checkout or in an installed `share/softtwin`.

use std::path::{Path, PathBuf};

/// Names a folder with `config` and `models` in it.
const VARIABLE: &str = "SOFTTWIN_SHARE";

/// The file at `path` (for example `config/scenes/finger.toml`): below `$SOFTTWIN_SHARE`, or else below the first of these
/// that has it: the current folder and its parents, `share/softtwin` next to the program's folder, the folders above
/// the program.
///
/// # Errors
/// No folder has it; the message lists the folders.
pub fn find(path: &str) -> anyhow::Result<PathBuf> {
    let folders = match std::env::var_os(VARIABLE) {
        Some(folder) => vec![PathBuf::from(folder)],
        None => folders(std::env::current_dir().ok().as_deref(), std::env::current_exe().ok().as_deref()),
    };
    first(&folders, path).ok_or_else(|| {
        let looked: Vec<String> = folders.iter().map(|folder| format!("  {}", folder.display())).collect();
        anyhow::anyhow!(
            "expected {path}, which comes with the sources and the packages; found in none of these folders:\n{}\nName a \
             checkout of softtwin or an installed share/softtwin in {VARIABLE}, or name another file by its option",
            looked.join("\n")
        )
    })
}

/// The folders in order. `own` is the running program.
fn folders(here: Option<&Path>, own: Option<&Path>) -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> =
        here.into_iter().flat_map(Path::ancestors).map(Path::to_path_buf).collect();
    let own = own.and_then(|own| own.canonicalize().ok());
    let installed = own.iter().filter_map(|own| Some(own.parent()?.parent()?.join("share/softtwin")));
    folders.extend(installed);
    folders.extend(own.iter().flat_map(|own| own.ancestors().skip(1)).map(Path::to_path_buf));
    folders
}

fn first(folders: &[PathBuf], path: &str) -> Option<PathBuf> {
    folders.iter().map(|folder| folder.join(path)).find(|path| path.is_file())
}

#[cfg(test)]
#[path = "../tests/unit/shared_files.rs"]
mod tests;
