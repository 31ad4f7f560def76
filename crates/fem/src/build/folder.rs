//! What a build writes into its folder and says of the model, whatever it was built from.

use super::report::{BuildError, BuildNotice, Notify};
use formats::database::{self, ObstacleKind};
use formats::file;
use rom::model::{Model, PressureLimit};
use rom::snapshots::Database;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use train::config::{Definition, OWN_CONFIG, TrainConfig};
use train::datasheet::DataSheet;
use train::evaluate::EvaluationReport;
use train::quality::Quality;

/// Keys of a training configuration that belong to the actuator.
#[derive(Serialize)]
pub(super) struct OwnConfig {
    pub(super) observables: BTreeMap<String, Definition>,
    pub(super) limit: PressureLimit,
}

/// Where the twin's files go, and who is told.
pub(super) struct Folder<'a> {
    pub(super) path: &'a Path,
    pub(super) notify: Notify<'a>,
}

/// A model with the database that it was trained on.
pub(super) struct Trained {
    pub(super) path: PathBuf,
    pub(super) model: Model,
    pub(super) sheet: DataSheet,
    data: Database,
}

impl Trained {
    /// Its errors on the held-out states of its database, if there are any, and by leaving out each training state in turn.
    pub(super) fn quality(&self) -> Result<(Quality, Option<EvaluationReport>), BuildError> {
        Ok(Quality::new(&self.model, Some(&self.sheet), &self.data)?)
    }
}

impl Folder<'_> {
    pub(super) fn say(&self, step: &str, text: &str) {
        (self.notify)(BuildNotice::Done { step, text });
    }

    pub(super) fn begin(&self, what: &str) {
        (self.notify)(BuildNotice::Begins(what));
    }

    /// Trains on a database and saves the model with its data sheet.
    pub(super) fn train(&self, folder: &Path, obstacle: ObstacleKind) -> Result<Trained, BuildError> {
        let data = database::read(folder, obstacle)?;
        let config = TrainConfig::of_database(folder)?;
        let (model, sheet) =
            train::train(&data, &config, &mut |step| self.begin(&format!("training: {step}")))
                .map_err(|source| BuildError::Train { database: folder.into(), source })?;
        let path = self.path.join(format!("{}.twin", data.actuator));
        let bytes = model.to_bytes()?;
        file::replace(&path, &bytes)?;
        sheet.save_beside(&path)?;
        self.say("model", &format!("{} ({:.1} MB)", path.display(), bytes.len() as f64 / 1e6));
        sheet.remarks.iter().for_each(|remark| self.say("note", remark));
        Ok(Trained { path, model, sheet, data })
    }

    /// Writes what belongs to the actuator into the database's training configuration, so that every later training has it too.
    pub(super) fn save_config(&self, database: &Path, own: &OwnConfig) -> Result<(), BuildError> {
        let text = format!(
            "# How `softtwin train` trains on this database unless --config names another file; made by `softtwin build`.\n\
             # Further keys are those of config/train.toml.\n\n{}",
            toml::to_string(own)?
        );
        self.replace("training", &database.join(OWN_CONFIG), &text)
    }

    /// Writes a file; another one that stood there is kept beside it.
    pub(super) fn replace(&self, step: &str, path: &Path, text: &str) -> Result<(), BuildError> {
        let present = file::read_bytes(path, file::MAX_TEXT_BYTES).ok();
        if let Some(other) = present.filter(|other| other != text.as_bytes()) {
            let kept = path.with_extension("toml.old");
            file::replace(&kept, &other)?;
            self.say(step, &format!("made again; the former one is {}", kept.display()));
        }
        Ok(file::replace(path, text.as_bytes())?)
    }
}
