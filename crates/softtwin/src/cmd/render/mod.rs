//! `softtwin render`: states and modes as pictures.

mod args;
mod modes;
mod placed;
mod states;

pub use args::Args;

use crate::failure::usage;
use crate::load::LoadedModel;
use crate::output;
use anyhow::Result;

impl Args {
    /// Draws the picture and prints its name and size.
    ///
    /// # Errors
    /// Arguments that do not fit together, files that cannot be read or written.
    pub fn run(self) -> Result<()> {
        if !self.out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
            return Err(usage(format!(
                "--out {}: expected a name that ends in .png, because a drawing is made of pixels; `softtwin plot` writes .svg",
                self.out.display()
            )));
        }
        let canvas = match (&self.model, &self.scene) {
            (Some(path), _) => {
                let mut loaded = LoadedModel::read(path)?;
                let given = self.settings.iter().map(|(name, value)| (name.as_str(), *value));
                loaded
                    .model
                    .header
                    .set_parameters(given)
                    .map_err(|error| usage(format!("--set: {error}")))?;
                match &self.modes {
                    Some(regime) => modes::draw(&self, &loaded, regime)?,
                    None if self.fig9 => states::fig9(&self, &loaded)?,
                    None => states::one(&self, &loaded)?,
                }
            }
            (None, Some(path)) => placed::scene(&self, path)?,
            (None, None) => states::case(&self)?,
        };
        canvas.write_png(&self.out)?;
        output!("{} ({} x {} px)", self.out.display(), canvas.width, canvas.height)?;
        Ok(())
    }
}
