//! The folder that `softtwin build` fills: progress lines, the model, the scene.

use crate::cmd::train as train_command;
use crate::files::{self, save};
use crate::output;
use crate::progress::Doing;
use anyhow::{Context, Result};
use formats::database::ObstacleKind;
use rom::model::PressureLimit;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use train::config::Definition;

/// Keys of a training configuration that belong to the actuator.
#[derive(Serialize)]
pub struct OwnConfig {
    pub observables: BTreeMap<String, Definition>,
    pub limit: PressureLimit,
}

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

    /// Trains on a database and saves the model; its path, and the notes of the training, which are printed.
    pub fn train(
        &self,
        database: &Path,
        obstacle: ObstacleKind,
        doing: &Doing,
    ) -> Result<(PathBuf, Vec<String>)> {
        let data = files::database(database, obstacle)?;
        let config = train_command::config_of(database)?;
        let (model, sheet) =
            train::train(&data, &config, &mut |step| doing.begin(format!("training: {step}")))
                .with_context(|| format!("training on {}", database.display()))?;
        let path = self.path.join(format!("{}.twin", data.actuator));
        let bytes = model.to_bytes()?;
        save(&path, &bytes)?;
        files::save_data_sheet(&path, &sheet)?;
        self.say("model", &format!("{} ({:.1} MB)", path.display(), bytes.len() as f64 / 1e6))?;
        sheet.remarks.iter().try_for_each(|remark| self.say("note", remark))?;
        Ok((path, sheet.remarks))
    }

    /// Writes the scene; another one that stood there, perhaps with a sensor in it by now, is kept beside it.
    pub fn save_scene(&self, scene: &Path, text: &str) -> Result<()> {
        self.replace("scene", scene, text)
    }

    /// Writes what belongs to the actuator into the database's training configuration, so that every later training has it too.
    pub fn save_config(&self, database: &Path, own: &OwnConfig) -> Result<()> {
        let text = format!(
            "# How `softtwin train` trains on this database unless --config names another file; made by `softtwin build`.\n\
             # Further keys are those of config/train.toml.\n\n{}",
            toml::to_string(own)?
        );
        self.replace("training", &database.join(train_command::OWN_CONFIG), &text)
    }

    /// Writes a file; another one that stood there is kept beside it.
    fn replace(&self, step: &str, file: &Path, text: &str) -> Result<()> {
        if let Some(other) = std::fs::read(file).ok().filter(|other| other != text.as_bytes()) {
            let kept = file.with_extension("toml.old");
            save(&kept, &other)?;
            self.say(step, &format!("made again; the former one is {}", kept.display()))?;
        }
        save(file, text.as_bytes())
    }
}
