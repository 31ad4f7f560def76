//! `softtwin-studies report`: the paper's tables and figures on a database, with the paper's method and ours.

mod cases;
mod curves;
mod folder;
mod learning;
mod method;
mod pareto;
mod published;
mod reproduction;
mod sealed;
mod study;
mod summary;
mod switch;

use anyhow::Context;
use folder::Folder;
use formats::database::ObstacleKind;
use sealed::Sealed;
use softtwin::progress::Progress;
use softtwin::{files, output};
use std::path::{Path, PathBuf};
use study::Study;

const EXAMPLES: &str = "\
Examples:
  The report that is committed (docs/report/README.md and its pictures):
    softtwin-studies report --database models/pneunet/database
  The acceptance limits only, without writing anything; ends with 1 if one is exceeded:
    softtwin-studies report --database models/pneunet/database --check
  On another database, with more random subsets:
    softtwin-studies report --database fresh --out /tmp/report --repeats 20";

const NOTES: &str = "\
Three columns compare the paper's published figures, the paper's method on this database and ours.";

/// Regenerate the paper's tables and figures, and the table of speed against error.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Database folder.
    #[arg(long, value_name = "DIR")]
    database: PathBuf,
    /// Folder for the report and its pictures.
    #[arg(long, value_name = "DIR", default_value = "docs/report")]
    out: PathBuf,
    /// Random subsets for each number of training cases.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u64).range(1..=200))]
    repeats: u64,
    /// Print the acceptance limits, write nothing, and end with 1 if one is exceeded.
    #[arg(long, conflicts_with_all = ["out", "repeats", "png"])]
    check: bool,
    /// Draw PNG instead of SVG.
    #[arg(long)]
    png: bool,
}

impl Args {
    /// Computes everything and writes the folder.
    pub fn run(self) -> anyhow::Result<()> {
        let mut progress = Progress::new(false);
        progress.step("reading the database");
        let database = files::database(&self.database, ObstacleKind::Plate)?;
        progress.step("training by the paper's method and by ours");
        let study = Study::new(database, &self.database)?;
        if self.check {
            return check(&study, &self.database);
        }
        std::fs::create_dir_all(&self.out).with_context(|| self.out.display().to_string())?;
        let folder = Folder { dir: self.out, ending: if self.png { "png" } else { "svg" } };
        let mut page = study.heading(&self.database, self.repeats);
        progress.step("acceptance limits");
        page += &summary::section(&study, Sealed::read(&self.database)?.as_ref())?.0;
        progress.step("test cases A to D and states outside the training range");
        page += &cases::section(&study, &folder)?;
        progress.step("errors against modes and training cases (Fig. 5)");
        page += &curves::section(&study, &folder, self.repeats, &mut progress)?;
        page += &learning::section(&study, &folder, &mut progress)?;
        progress.step("contact onset");
        page += &switch::section(&study)?;
        progress.step("errors at training cases");
        page += &reproduction::section(&study)?;
        progress.step("speed against error");
        page += &pareto::section(&study, &folder, &mut progress)?;
        drop(progress);
        let path = folder.dir.join("README.md");
        files::save(&path, page.as_bytes())?;
        output!("{}", path.display())?;
        Ok(())
    }
}

/// Prints the acceptance limits; the error names those that are exceeded.
fn check(study: &Study, database: &Path) -> anyhow::Result<()> {
    let (table, missed) = summary::section(study, Sealed::read(database)?.as_ref())?;
    output!("{table}")?;
    anyhow::ensure!(missed.is_empty(), "limits exceeded:\n  {}", missed.join("\n  "));
    Ok(())
}
