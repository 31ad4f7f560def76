//! `softtwin render`: states and modes as pictures.

mod args;
mod modes;
mod placed;
mod states;

pub use args::Args;

use crate::load::LoadedModel;
use crate::output;
use anyhow::Result;

impl Args {
    /// Draws the picture and prints its name and size.
    ///
    /// # Errors
    /// Arguments that do not fit together, files that cannot be read or written.
    pub fn run(self) -> Result<()> {
        let canvas = match (&self.model, &self.scene) {
            (Some(path), _) => {
                let loaded = LoadedModel::read(path)?;
                match self.modes {
                    Some(regime) => modes::draw(&self, &loaded, regime.kind())?,
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
