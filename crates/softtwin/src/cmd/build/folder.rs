//! What `build` writes into its folder and says of the model, whatever it was built from.

use crate::cmd::evaluate;
use crate::files::{self, refusal, save};
use crate::output;
use crate::progress::Doing;
use anyhow::{Context, Result};
use formats::database::ObstacleKind;
use rom::model::PressureLimit;
use rom::snapshots::Database;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use train::config::{Definition, OWN_CONFIG, TrainConfig};
use train::quality::{Quality, QualityRow};

/// For programs all figures, for people the errors as a table.
#[derive(Serialize)]
#[serde(untagged)]
pub enum QualityReport {
    Figures(Quality),
    Table(Vec<QualityRow>),
}

/// What the figures of a quality say to people, and the figures.
pub fn quality_report(quality: Quality, more_states: &str, as_json: bool) -> (QualityReport, Vec<String>) {
    if as_json {
        return (QualityReport::Figures(quality), Vec::new());
    }
    let mut remarks = vec![match &quality.picture {
        Some(picture) => format!(
            "errors are at the worst node of a state, mean and worst, in % of its largest value (of a force: of all); by state: {}",
            picture.display()
        ),
        None => "no held-out state (split = test): the error is from leave-one-out only".into(),
    }];
    if !quality.warnings.is_empty() {
        remarks.push("not good enough yet:".into());
        remarks.extend(quality.warnings.iter().map(|warning| format!("  {warning}")));
        remarks.push(format!("  {more_states}"));
    }
    (QualityReport::Table(quality.rows()), remarks)
}

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
    ) -> Result<(PathBuf, Vec<String>, Database)> {
        let data = files::database(database, obstacle)?;
        let config = TrainConfig::of_database(database).map_err(refusal)?;
        let (model, sheet) =
            train::train(&data, &config, &mut |step| doing.begin(format!("training: {step}")))
                .with_context(|| format!("training on {}", database.display()))?;
        let path = self.path.join(format!("{}.twin", data.actuator));
        let bytes = model.to_bytes()?;
        save(&path, &bytes)?;
        files::save_data_sheet(&path, &sheet)?;
        self.say("model", &format!("{} ({:.1} MB)", path.display(), bytes.len() as f64 / 1e6))?;
        sheet.remarks.iter().try_for_each(|remark| self.say("note", remark))?;
        Ok((path, sheet.remarks, data))
    }

    /// Measures a model on the held-out states of its database and draws the errors by state.
    pub fn quality(&self, model: &Path, data: &Database) -> Result<Quality> {
        let sheet = files::read_data_sheet(model);
        let (mut quality, held_out) = Quality::new(&files::model(model)?, sheet.as_ref(), data)?;
        if let Some(report) = held_out {
            let picture = self.path.join("errors.png");
            evaluate::picture(&report).save(&picture)?;
            quality.picture = Some(picture);
        }
        Ok(quality)
    }

    /// Writes what belongs to the actuator into the database's training configuration, so that every later training has it too.
    pub fn save_config(&self, database: &Path, own: &OwnConfig) -> Result<()> {
        let text = format!(
            "# How `softtwin train` trains on this database unless --config names another file; made by `softtwin build`.\n\
             # Further keys are those of config/train.toml.\n\n{}",
            toml::to_string(own)?
        );
        self.replace("training", &database.join(OWN_CONFIG), &text)
    }

    /// Writes a file; another one that stood there is kept beside it.
    pub fn replace(&self, step: &str, file: &Path, text: &str) -> Result<()> {
        if let Some(other) = std::fs::read(file).ok().filter(|other| other != text.as_bytes()) {
            let kept = file.with_extension("toml.old");
            save(&kept, &other)?;
            self.say(step, &format!("made again; the former one is {}", kept.display()))?;
        }
        save(file, text.as_bytes())
    }
}
