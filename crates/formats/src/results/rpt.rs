//! Field reports of Abaqus (`.rpt`): values at nodes, one report after another in the same file.
//!
//! ```text
//!    Step: Step-1
//!    Frame: Increment     12: Step Time =   0.5000
//! ...
//!             Node            U.U1            U.U2         S.Mises
//!            Label          @Loc 1          @Loc 1          @Loc 1
//! ------------------------------------------------------------------
//!                1     1.2345E-03 ...
//! ```
//! They are tables of the form that [`listing`](super::listing) reads, with other words around them: each line becomes one of those, so
//! that diagnostics name the line of the report.

use super::listing;
use super::run::Step;
use crate::error::Diagnostic;

/// Reads a text; `labels` are the numbers of the mesh's nodes.
///
/// # Errors
/// Everything that is wrong, with line numbers; never empty.
pub fn parse(text: &str, labels: &[u64]) -> Result<Vec<Step>, Vec<Diagnostic>> {
    let mut steps: Vec<&str> = Vec::new();
    let (mut step, mut time, mut in_table) = (0, None, false);
    let mut lines = String::with_capacity(text.len());
    for line in text.lines() {
        let line = line.trim();
        let mut words = line.split_ascii_whitespace();
        let first = words.next().unwrap_or_default();
        if let Some(name) = line.strip_prefix("Step:").map(str::trim) {
            step = steps.iter().position(|known| *known == name).unwrap_or(steps.len());
            if step == steps.len() {
                steps.push(name);
            }
        } else if let Some((increment, at)) = frame(line) {
            in_table = false;
            time = Some(at);
            lines.push_str(&format!("LOAD STEP= {} SUBSTEP= {increment}", step + 1));
        } else if first == "Node"
            && words.clone().all(|word| word.parse::<f64>().is_err())
            && words.clone().next().is_some()
        {
            in_table = true;
            lines.push_str("NODE");
            // `U.U1`: the component says all; `U.Magnitude` would be no component of `U`.
            words.for_each(|name| lines.push_str(&format!(" {}", name.rsplit('.').next().unwrap_or(name))));
        } else if let Some(at) = time.take() {
            // On a line of its own, below the frame's; what stands there is a blank or a heading.
            lines.push_str(&format!("TIME= {at}"));
        } else if in_table && first.starts_with(|c: char| c.is_ascii_digit()) {
            lines.push_str(line);
        } else if in_table && matches!(first, "Minimum" | "Maximum" | "Total") {
            in_table = false;
        }
        lines.push('\n');
    }
    listing::parse(&lines, labels).map_err(|diagnostics| diagnostics.into_iter().map(of_a_report).collect())
}

/// A diagnostic in the words of Abaqus' reports.
fn of_a_report(found: Diagnostic) -> Diagnostic {
    let expected = match found.expected.as_str() {
        text if text.starts_with("every node once") => {
            "every node once: Unique Nodal values of one part (a flat .inp, noPartsInputFile=ON)".to_owned()
        }
        text if text.contains("PRNSOL") => {
            "a report of Unique Nodal values: a line `Node` with the names of the columns, then a line a node"
                .to_owned()
        }
        text => text.to_owned(),
    };
    Diagnostic { expected, ..found }
}

/// Increment and time of `Frame: Increment 12: Step Time = 0.5`.
fn frame(line: &str) -> Option<(&str, &str)> {
    let (increment, time) = line.strip_prefix("Frame:")?.trim().strip_prefix("Increment")?.split_once(':')?;
    let time = time.rsplit_once('=')?.1.trim();
    time.parse::<f64>().is_ok().then_some((increment.trim(), time))
}
