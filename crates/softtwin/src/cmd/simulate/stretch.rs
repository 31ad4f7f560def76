//! Stretches beyond the range over which a law was fitted.

use fem::{Problem, Stretches};

/// Fraction of the elastomer's volume that may be beyond the range of its law: re-entrant corners are.
pub const MAX_BEYOND: f64 = 0.01;

/// A line about a state that reaches beyond the range of its law; `None` within it.
pub fn warning(problem: &Problem, stretches: Stretches) -> Option<String> {
    let ranges = problem.config().elastomers.iter().filter_map(|elastomer| elastomer.stretch_range);
    let ranges: Vec<String> = ranges.map(|[low, high]| format!("{low} to {high}")).collect();
    (stretches.beyond > MAX_BEYOND).then(|| {
        format!(
            "{:.0} % of the elastomer is stretched beyond the range of its law ({}), up to {:.2}: its stress there is extrapolated",
            100.0 * stretches.beyond,
            ranges.join("; "),
            stretches.largest
        )
    })
}
