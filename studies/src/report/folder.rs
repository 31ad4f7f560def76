//! The folder of the report.

use softtwin::picture::Figure;
use std::path::{Path, PathBuf};

/// The folder the report is written into.
pub struct Folder {
    /// Its path.
    pub dir: PathBuf,
    /// Ending of the pictures: svg or png.
    pub ending: &'static str,
}

impl Folder {
    /// Saves a picture and returns its line of Markdown.
    pub fn picture(&self, name: &str, caption: &str, figure: &Figure) -> anyhow::Result<String> {
        let file = format!("{name}.{}", self.ending);
        figure.save(&self.dir.join(&file))?;
        Ok(format!("\n![{caption}]({file})\n"))
    }
}

/// The file of the model's name beside a database's folder, `models/NAME/NAME.json` for `models/NAME/database`.
pub fn beside(database: &Path, ending: &str) -> Option<PathBuf> {
    let database = std::path::absolute(database).ok()?;
    let folder = database.parent()?;
    Some(folder.join(folder.file_name()?).with_extension(ending))
}
