//! The folder that `softtwin build` fills: progress lines, the model, the scene.

use crate::files::{self, save};
use crate::output;
use crate::progress::Doing;
use anyhow::{Context, Result};
use formats::database::ObstacleKind;
use rom::model::PressureLimit;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use train::config::{Definition, TrainConfig};

/// Where the twin's files go, and whether the answer is JSON.
pub struct Folder<'a> {
    pub path: &'a Path,
    pub json: bool,
}

impl Folder<'_> {
    /// Prints what a step did, unless the answer is JSON.
    pub fn say(&self, step: &str, text: &str) -> Result<()> {
        if !self.json {
            output!("{step:<10} {text}")?;
        }
        Ok(())
    }

    /// Trains on a database and saves the model; its path.
    pub fn train(
        &self,
        database: &Path,
        obstacle: ObstacleKind,
        observables: BTreeMap<String, Definition>,
        limit: Option<PressureLimit>,
        doing: &Doing,
    ) -> Result<PathBuf> {
        let data = files::database(database, obstacle)?;
        let config = TrainConfig { observables, ..TrainConfig::default() };
        let (mut model, sheet) =
            train::train(&data, &config, &mut |step| doing.begin(format!("training: {step}")))
                .with_context(|| format!("training on {}", database.display()))?;
        model.header.limit = limit;
        let path = self.path.join(format!("{}.twin", data.actuator));
        let bytes = model.to_bytes()?;
        save(&path, &bytes)?;
        files::save_data_sheet(&path, &sheet)?;
        self.say("model", &format!("{} ({:.1} MB)", path.display(), bytes.len() as f64 / 1e6))?;
        Ok(path)
    }

    /// Writes the scene; another one that stood there, perhaps with a sensor in it by now, is kept beside it.
    pub fn save_scene(&self, scene: &Path, text: &str) -> Result<()> {
        if let Some(other) = std::fs::read(scene).ok().filter(|other| other != text.as_bytes()) {
            let kept = scene.with_extension("toml.old");
            save(&kept, &other)?;
            self.say("scene", &format!("made again; the former one is {}", kept.display()))?;
        }
        save(scene, text.as_bytes())
    }
}
