//! `softtwin export`: a recording as CSV tables.

use crate::failure::{configuration, usage};
use crate::say;
use anyhow::{Context, Result};
use recording::{Ending, Exported, Reader, export_csv};
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use wire::KeyExpr;

const EXAMPLES: &str = "\
Examples:
  One table for each topic, tables/softtwin.finger.state.csv and so on:
    softtwin export run.mcap --out tables
  States only:
    softtwin export run.mcap --out tables --key 'softtwin/*/state'";

/// Export a recording (MCAP) to CSV, one table for each topic.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Recording
    #[arg(value_name = "MCAP")]
    recording: PathBuf,
    /// Folder for the tables; made when it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Topics, as a key expression
    #[arg(long, value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// End with one JSON object
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Writes the tables.
    ///
    /// # Errors
    /// A file that is no recording, a folder that cannot be written.
    pub fn run(self) -> Result<()> {
        let key = KeyExpr::new(&self.key).map_err(usage)?;
        let file = File::open(&self.recording)
            .with_context(|| format!("cannot read the recording ({})", self.recording.display()))
            .map_err(configuration)?;
        let reader = Reader::new(BufReader::new(file)).map_err(configuration)?;
        std::fs::create_dir_all(&self.out).with_context(|| format!("cannot make {}", self.out.display()))?;
        let exported = export_csv(reader, &self.out, &key)?;
        self.report(&exported)
    }

    fn report(&self, exported: &Exported) -> Result<()> {
        let ending = describe(&exported.ending);
        if self.json {
            let rows: serde_json::Map<String, serde_json::Value> =
                exported.rows.iter().map(|(path, rows)| (path.display().to_string(), json!(rows))).collect();
            return say::json(&json!({"rows": rows, "left_out": exported.left_out, "ending": ending}));
        }
        for (path, rows) in &exported.rows {
            say!("{}  {rows} rows", path.display())?;
        }
        if exported.rows.is_empty() {
            say!("nothing in the recording matches {}", self.key)?;
        }
        if exported.left_out > 0 {
            say!("{} messages are no JSON objects and were left out", exported.left_out)?;
        }
        say!("the recording is {ending}")?;
        Ok(())
    }
}

fn describe(ending: &Ending) -> String {
    match ending {
        Ending::Complete => "complete".into(),
        Ending::Truncated { at_byte, reason } => {
            format!("cut short at byte {at_byte} ({reason}); everything before is exported")
        }
        Ending::Damaged { skipped } => format!("damaged: {skipped} chunks or records were left out"),
    }
}
