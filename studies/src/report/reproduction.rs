//! Errors at the training cases, and the effect of smoothing and modes on held-out states.

use super::study::{Study, percent, train};
use rom::model::Model;
use rom::snapshots::{FieldKind, RegimeKind, Split};
use std::fmt::Write as _;
use train::config::{ModeChoice, TrainConfig};
use train::evaluate::EvaluationReport;

pub fn section(study: &Study) -> anyhow::Result<String> {
    let mut text = String::from(
        "\n## Errors at training cases\n\nContact states; largest over nodes and cases, per largest value of the field in the case. Truncation: error of the \
         modes; rest: beyond it, from smoothing. Held-out: contact states inside the training range (mean / 95th percentile).\n\n\
         | setting | modes x, y, z, stress | coordinates: truncation %, rest % | stress: truncation %, rest % | held-out: \
         displacement % | held-out: stress % |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    let held_out = study.held_out()?;
    for (name, config) in settings(&study.config) {
        let model = match &config {
            Some(config) => &train(&study.database, config)?,
            None => &study.ours,
        };
        let _ = writeln!(text, "| {name} | {} |", row(study, model, &held_out)?);
    }
    Ok(text)
}

/// Our settings, with smoothing, and with 120 modes.
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
            "`contact.max_modes = 120`, `contact.modes = { fixed = 120 }`",
            contact(|c| {
                c.contact.max_modes = 120;
                c.contact.modes = ModeChoice::Fixed(120);
            }),
        ),
    ]
}

fn row(study: &Study, model: &Model, held_out: &[usize]) -> anyhow::Result<String> {
    let contact = |i: &usize| study.database.cases[*i].contact_force_n > 0.0;
    let training: Vec<usize> = study.database.of_split(Split::Train).filter(contact).collect();
    let report = study.evaluate(model, &training)?;
    let (coordinates, stress) = (parts(study, &report, false), parts(study, &report, true));
    let held_out: Vec<usize> = held_out.iter().copied().filter(contact).collect();
    let held_out = study.evaluate(model, &held_out)?;
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

/// Truncation error and the rest, in percent of the field's largest value.
fn parts(study: &Study, report: &EvaluationReport, stress: bool) -> String {
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
