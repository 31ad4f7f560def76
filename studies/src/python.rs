//! Separate Python environments for programs that are compared with ours.

use crate::testbed::output_of;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The interpreter of `build/NAME-venv` with these packages in it. The first call asks PyPI for them.
///
/// # Errors
/// No Python 3 with venv, or a package that cannot be installed.
pub fn environment(name: &str, packages: &[&str]) -> anyhow::Result<PathBuf> {
    let folder = Path::new("build").join(format!("{name}-venv"));
    let python = std::path::absolute(folder.join("bin/python"))?;
    let installed = folder.join("installed");
    if !installed.exists() {
        output_of(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
        install(&python, packages)?;
        std::fs::write(installed, "")?;
    }
    Ok(python)
}

/// Installs packages; `arguments` are pip's.
///
/// # Errors
/// A package that cannot be installed.
pub fn install(python: &Path, arguments: &[&str]) -> anyhow::Result<()> {
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    output_of(Command::new(python).args(pip).args(arguments))?;
    Ok(())
}
