//! The stability suite as a table.

use crate::hard_cases::{Ending, Outcome, hard_cases, run};
use std::fmt::Write as _;

pub fn section() -> String {
    let mut text = String::from(
        "\n## Hard cases\n\nThe table of `softtwin-studies hard-cases`: cases with a known truth that strain the numerics. Each must end in a \
         correct answer within its bound, a refusal with its reason, or an answer that is flagged; the paper's method runs \
         on the same cases. Error: the largest of displacement, stress and force, each over its largest true value.\n\n\
         | case | what is hard | bound | ours | condition | error | paper's method | condition | error |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for case in hard_cases() {
        let row = run(&case);
        let _ = writeln!(
            text,
            "| {} | {} | {:.0e} | {} | {} |",
            row.case,
            row.hard,
            row.bound,
            cells(&row.ours),
            cells(&row.paper)
        );
    }
    text
}

fn cells(outcome: &Outcome) -> String {
    let ending = match outcome.ending {
        Ending::Correct => "correct",
        Ending::Flagged => "flagged",
        Ending::Refused => "refused",
        Ending::SilentlyWrong => "**silently wrong**",
    };
    let number = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.0e}"));
    format!("{ending} | {} | {}", number(outcome.condition), number(outcome.error))
}
