//! States against error, with and without the states' derivatives.

use super::folder::Folder;
use super::study::{Study, ours, percent, train};
use anyhow::Context;
use rom::evaluate::Summary;
use rom::snapshots::{Database, RegimeKind, Split};
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use softtwin::progress::Progress;
use std::fmt::Write as _;

/// Shares of the training states.
const SHARES: [f64; 5] = [0.25, 0.33, 0.5, 0.7, 1.0];

/// Displacement, stress and force: mean and 95th percentile over the unseen states.
type Errors = [[f64; 2]; 3];

pub fn section(study: &Study, out: &Folder, progress: &mut Progress) -> anyhow::Result<String> {
    let mut text = String::from("\n## States against error, with and without derivatives\n");
    if study.database.sensitivities.is_none() {
        return Ok(text + "\nThe database has no derivatives.\n");
    }
    let contact = |i: &usize| study.database.cases[*i].regime == RegimeKind::Contact;
    let unseen: Vec<usize> = study.untouched()?.into_iter().filter(contact).collect();
    let mut rows = String::new();
    let mut curves: [Vec<(f64, Errors)>; 2] = Default::default();
    for share in SHARES {
        let (with, states) = thinned(&study.database, share);
        progress.step(&format!("states against error: {states} states"));
        let without = Database { sensitivities: None, ..with.clone() };
        for ((curve, database), name) in curves.iter_mut().zip([&with, &without]).zip(["with", "without"]) {
            let model = train(database, &ours()).with_context(|| format!("{states} states, {name}"))?;
            let report = study.evaluate(&model, &unseen)?;
            let Some(summary) = report.regimes.first() else { continue };
            let errors = errors(summary);
            let cells = errors.map(|[mean, p95]| format!("{} / {}", percent(mean), percent(p95)));
            let _ = writeln!(rows, "| {states} | {name} | {} |", cells.join(" | "));
            curve.push((states as f64, errors));
        }
    }
    let figure = picture(&curves);
    text += &out.picture("learning", "Errors on unseen contact states against training states", &figure)?;
    let _ = write!(
        text,
        "\nModels trained on more and more of the training states, taken evenly from the list, free and contact together; errors \
         on the {} contact states inside the domain that no training saw, mean / 95th percentile in %, the force by the largest \
         force.\n\n| states | derivatives | displacement | stress | force |\n| --- | --- | --- | --- | --- |\n{rows}",
        unseen.len()
    );
    Ok(text)
}

/// The database with a share of its training states; the others take part in nothing.
fn thinned(database: &Database, share: f64) -> (Database, usize) {
    let mut thin = database.clone();
    let taken = |k: usize| ((k + 1) as f64 * share).floor() > (k as f64 * share).floor();
    let train: Vec<usize> = database.of_split(Split::Train).collect();
    for (_, &case) in train.iter().enumerate().filter(|(k, _)| !taken(*k)) {
        thin.cases[case].split = Split::Check;
    }
    let count = thin.of_split(Split::Train).count();
    (thin, count)
}

fn errors(summary: &Summary) -> Errors {
    let field = |name: &str| {
        let found = summary.fields.iter().find(|field| field.field == name);
        found.map_or([f64::NAN; 2], |field| [field.normalised[0], field.normalised[1]])
    };
    [field("displacement"), field("von_mises"), [summary.force_normalised[0], summary.force_normalised[1]]]
}

fn picture(curves: &[Vec<(f64, Errors)>; 2]) -> Figure {
    let panel = |(k, title): (usize, &str)| {
        let line = |colour: usize, name: &str| Series {
            name: name.into(),
            colour,
            mark: Mark::LineDots,
            points: curves[colour].iter().map(|(states, errors)| (*states, 100.0 * errors[k][0])).collect(),
        };
        Panel {
            title: title.into(),
            x: Axis::linear("training states"),
            y: Axis::log("mean error %"),
            series: vec![line(0, "with derivatives"), line(1, "without")],
            map: None,
        }
    };
    let panels = ["Displacement", "Von Mises stress", "Contact force"].into_iter().enumerate().map(panel);
    Figure { title: "States against error".into(), panels: panels.collect(), columns: 3 }
}
