//! Error against training states, with and without derivatives.

use super::folder::Folder;
use super::study::Study;
use crate::learning::{Point, Unseen, curve, table};
use rom::snapshots::RegimeKind;
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use softtwin::progress::Progress;
use std::fmt::Write as _;

/// Fractions of the training states.
const SHARES: [f64; 5] = [0.25, 0.33, 0.5, 0.7, 1.0];

pub fn section(study: &Study, out: &Folder, progress: &mut Progress) -> anyhow::Result<String> {
    let mut text = String::from("\n## Error against training states, with and without derivatives\n");
    if study.database.sensitivities.is_none() {
        return Ok(text + "\nThe database has no derivatives.\n");
    }
    let contact = |i: &usize| study.database.cases[*i].regime == RegimeKind::Contact;
    let cases = study.held_out()?.into_iter().filter(contact).collect();
    let unseen = Unseen { database: &study.database, cases };
    let points = curve(&study.database, &unseen, &SHARES, &mut |step| progress.step(step))?;
    let figure = picture(&points);
    text += &out.picture("learning", "Errors on held-out contact states against training states", &figure)?;
    let _ = write!(
        text,
        "\nTraining states taken evenly from the list, free and contact together, with every mode that lowers the leave-one-out \
         error. Errors on the {} held-out contact states inside the training range, mean / 95th percentile in %; force per \
         largest force.\n\n{}",
        unseen.cases.len(),
        table(&points)
    );
    Ok(text)
}

fn picture(points: &[Point]) -> Figure {
    let panel = |(k, title): (usize, &str)| {
        let line = |colour: usize, name: &str, with: bool| Series {
            name: name.into(),
            colour,
            mark: Mark::LineDots,
            points: points
                .iter()
                .filter(|point| point.with_derivatives == with)
                .map(|point| (point.states as f64, 100.0 * point.errors[k][0]))
                .collect(),
        };
        Panel {
            title: title.into(),
            x: Axis::linear("training states"),
            y: Axis::log("mean error %"),
            series: vec![line(0, "with derivatives", true), line(1, "without", false)],
            map: None,
        }
    };
    let panels = ["Displacement", "Von Mises stress", "Contact force"].into_iter().enumerate().map(panel);
    Figure { title: "Error against training states".into(), panels: panels.collect(), columns: 3 }
}
