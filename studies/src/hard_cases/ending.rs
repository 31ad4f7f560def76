//! How hard cases end.

use serde::Serialize;

/// How a case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Within the bound.
    Correct,
    /// Beyond the bound, but flagged as extrapolation or within the model's half-widths.
    Flagged,
    /// Training refused with a reason.
    Refused,
    /// Beyond the bound without a word.
    SilentlyWrong,
}

/// Result of one method on a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// How it ended.
    pub ending: Ending,
    /// Largest condition number of the systems solved; none when refused before solving.
    pub condition: Option<f64>,
    /// Largest error: displacement, stress and force, each over its largest true value.
    pub error: Option<f64>,
    /// Reason of a refusal, or what was merged.
    pub note: String,
}

/// A row of the report.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Case.
    pub case: String,
    /// Difficulty.
    pub hard: String,
    /// Bound in force.
    pub bound: f64,
    /// How ours must end.
    pub expected: Ending,
    /// Ours.
    pub ours: Outcome,
    /// The paper's method on the same case.
    pub paper: Outcome,
}

impl Row {
    /// Whether ours ended as it must.
    pub fn passed(&self) -> bool {
        self.ours.ending == self.expected
    }

    /// A line of the table below [`HEAD`].
    pub fn line(&self) -> String {
        let Self { case, hard, bound, ours, paper, .. } = self;
        format!("| {case} | {hard} | {bound:.0e} | {} | {} |\n", ours.cells(), paper.cells())
    }
}

/// Head of the table.
pub const HEAD: &str = "| case | what is hard | bound | ours | condition | error | paper's method | condition | error |\n\
    | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";

impl Outcome {
    fn cells(&self) -> String {
        let ending = match self.ending {
            Ending::Correct => "correct",
            Ending::Flagged => "flagged",
            Ending::Refused => "refused",
            Ending::SilentlyWrong => "**silently wrong**",
        };
        let number = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.0e}"));
        format!("{ending} | {} | {}", number(self.condition), number(self.error))
    }
}
