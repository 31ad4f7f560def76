//! `softtwin-studies hard-cases`.

use super::ending::HEAD;
use super::{hard_cases, run};
use softtwin::output;
use softtwin::progress::Progress;

const EXAMPLES: &str = "\
Examples:
    softtwin-studies hard-cases
  Only the cases with `duplicate` in their name, for a script:
    softtwin-studies hard-cases --only duplicate --json";

const NOTES: &str = "\
Every case has a known truth. It ends in a correct answer within its bound, a refusal with its reason, or an answer that is
flagged; a silent wrong number fails, and so does the command (exit code 1). The paper's method runs on the same cases for
comparison and fails nothing.";

/// Run the named hard cases: conditioning, duplicates, degenerate data, the contact onset.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Run only the cases whose name contains this.
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Print one JSON object per case instead of a table.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Runs the cases one after the other and prints each as it ends.
    pub fn run(self) -> anyhow::Result<()> {
        let wanted = |name: &str| self.only.as_ref().is_none_or(|part| name.contains(part.as_str()));
        let cases: Vec<_> = hard_cases().into_iter().filter(|case| wanted(&case.name)).collect();
        if cases.is_empty() {
            let names: Vec<String> = hard_cases().into_iter().map(|case| case.name).collect();
            return Err(softtwin::failure::usage(format!(
                "--only: no such case; there are {}",
                names.join(", ")
            )));
        }
        if !self.json {
            output!("{}", HEAD.trim_end())?;
        }
        let mut progress = Progress::new(self.json);
        let mut failed = Vec::new();
        for case in &cases {
            progress.step(&case.name);
            let row = run(case);
            match self.json {
                true => output::json(&row)?,
                false if row.ours.note.is_empty() => output!("{}", row.line().trim_end())?,
                false => output!("{}\nnote: {}", row.line().trim_end(), row.ours.note)?,
            }
            if !row.passed() {
                failed.push(row.case);
            }
        }
        drop(progress);
        if failed.is_empty() {
            return Ok(());
        }
        Err(anyhow::anyhow!(
            "{} of {} cases did not end as they must: {}",
            failed.len(),
            cases.len(),
            failed.join(", ")
        ))
    }
}
