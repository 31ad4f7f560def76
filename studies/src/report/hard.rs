//! The hard cases as a table.

use crate::hard_cases::{HEAD, hard_cases, run};

pub fn section() -> String {
    let mut text = String::from(
        "\n## Hard cases\n\nThe table of `softtwin-studies hard-cases`: cases with a known truth that strain the numerics. Each must end in a \
         correct answer within its bound, a refusal with its reason, or an answer that is flagged; the paper's method runs \
         on the same cases. Error: the largest of displacement, stress and force, each over its largest true value.\n\n",
    );
    text += HEAD;
    for case in hard_cases() {
        text += &run(&case).line();
    }
    text
}
