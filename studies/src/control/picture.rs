//! The named runs as a picture.

use super::figures::{Figures, Run};
use super::trial::Moment;
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};

/// Interval of the drawn control cycles.
const EVERY: usize = 5;

/// Target, truth and what was followed over time, one panel a run.
pub fn draw(figures: &Figures) -> Figure {
    let panels = figures.runs.iter().map(panel).collect();
    Figure { title: "The controller on a plant of a second mesh".into(), panels, columns: 2 }
}

fn panel(run: &Run) -> Panel {
    let series = |name: &str, colour: usize, value: fn(&Moment) -> f64| Series {
        name: name.into(),
        colour,
        mark: Mark::Line,
        points: run.moments.iter().step_by(EVERY).map(|moment| (moment.time_s, value(moment))).collect(),
    };
    let quantity = if run.unit == "N" { "contact force (N)" } else { "height of the tip (mm)" };
    Panel {
        title: run.name.into(),
        x: Axis::linear("time (s)"),
        y: Axis::linear(quantity),
        series: vec![
            series("target", 2, |moment| moment.target),
            series("followed", 1, |moment| moment.followed),
            series("truth", 0, |moment| moment.truth),
        ],
        map: None,
    }
}
