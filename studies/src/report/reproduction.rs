//! How exactly the training cases come back, and what exactness costs on untouched states.

use super::study::{Study, percent, train};
use rom::model::Model;
use rom::snapshots::{FieldKind, RegimeKind, Split};
use std::fmt::Write as _;
use train::config::{ModeChoice, TrainConfig};
use train::evaluate::Report;

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = String::from(
        "\n## How exactly training cases come back\n\nContact states; largest over nodes and cases, by the field's largest value in \
         the case. *Truncation* is what the modes cannot represent, *missed* what smoothing leaves beyond it. The last \
         columns show what the same setting does on untouched contact states inside the domain (mean / 95th percentile).\n\n\
         | setting | modes x, y, z, stress | coordinates: truncation %, missed % | stress: truncation %, missed % | untouched: \
         displacement % | untouched: stress % |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    let untouched = study.untouched()?;
    for (name, config) in settings(&study.config) {
        let model = match &config {
            Some(config) => &train(&study.database, config)?,
            None => &study.ours,
        };
        let _ = writeln!(text, "| {name} | {} |", row(study, model, &untouched)?);
    }
    Ok(text)
}

/// Settings of `config/train.toml` around those of our model: smoothing, and all modes.
fn settings(ours: &TrainConfig) -> [(&'static str, Option<TrainConfig>); 3] {
    let contact = |change: fn(&mut TrainConfig)| {
        let mut config = ours.clone();
        change(&mut config);
        Some(config)
    };
    [
        ("ours", None),
        ("`contact.smoothing = [3e-8]`", contact(|c| c.contact.smoothing = vec![3e-8])),
        (
            "`contact.max_modes = 120`, `contact.modes = { fixed = 120 }`: nearly all",
            contact(|c| {
                c.contact.max_modes = 120;
                c.contact.modes = ModeChoice::Fixed(120);
            }),
        ),
    ]
}

fn row(study: &Study, model: &Model, untouched: &[usize]) -> anyhow::Result<String> {
    let contact = |i: &usize| study.database.cases[*i].contact_force_n > 0.0;
    let training: Vec<usize> = study.database.of_split(Split::Train).filter(contact).collect();
    let report = study.evaluate(model, &training)?;
    let (coordinates, stress) = (missed(study, &report, false), missed(study, &report, true));
    let untouched: Vec<usize> = untouched.iter().copied().filter(contact).collect();
    let held_out = study.evaluate(model, &untouched)?;
    let column = |kind: FieldKind| -> String {
        let at = study.database.fields.iter().position(|f| f.kind == kind);
        let summary = held_out.regimes.iter().find(|r| r.regime == RegimeKind::Contact).zip(at);
        summary.map_or("-".into(), |(s, at)| {
            let [mean, p95, _] = s.fields[at].normalised;
            format!("{} / {}", percent(mean), percent(p95))
        })
    };
    let regime = model.regime(RegimeKind::Contact);
    let modes: Vec<String> =
        regime.iter().flat_map(|r| &r.groups).map(|g| g.coefficients.len().to_string()).collect();
    Ok(format!(
        "{} | {coordinates} | {stress} | {} | {}",
        modes.join(", "),
        column(FieldKind::Magnitude),
        column(FieldKind::Stress)
    ))
}

/// Truncation and what is missed beyond it, in percent of the field's largest value.
fn missed(study: &Study, report: &Report, stress: bool) -> String {
    let (mut truncation, mut beyond) = (0.0_f64, 0.0_f64);
    for errors in report.cases.iter().flat_map(|c| &c.fields) {
        let kind = study.database.fields.iter().find(|f| f.name == errors.field).map(|f| f.kind);
        if (kind == Some(FieldKind::Stress)) != stress {
            continue;
        }
        let (Some(cut), Some(smoothed)) = (errors.truncation_max, errors.interpolation_max) else { continue };
        let share = errors.normalised / errors.max.max(f64::MIN_POSITIVE);
        truncation = truncation.max(cut * share);
        beyond = beyond.max(smoothed * share);
    }
    format!("{}, {}", percent(truncation), percent(beyond))
}
