//! Asking a trained model, and measuring how wrong it is.

use super::case::{HardCase, Probe, Query};
use rom::evaluation::Evaluation;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::regime::Onset;
use rom::snapshots::{Database, FieldKind};
use train::config::TrainConfig;
use train::train;

/// The largest error, and whether every answer beyond the bound said that it should not be trusted.
pub(super) struct Found {
    pub error: f64,
    pub flagged: bool,
}

impl Found {
    /// A state that cannot be evaluated counts as an unbounded error.
    const NO_ANSWER: Self = Self { error: f64::INFINITY, flagged: false };
}

pub(super) fn ask(model: &Model, case: &HardCase, config: &TrainConfig) -> Found {
    match &case.probe {
        Probe::Queries(queries) => ask_queries(model, &case.database, queries, case.bound),
        Probe::Switch => Found { error: largest_jump(model), flagged: false },
        Probe::SameAs(reference) => match train(reference, config, &mut |_| {}) {
            Ok((other, _)) => {
                Found { error: largest_difference(model, &other, &case.database), flagged: false }
            }
            Err(_) => Found::NO_ANSWER,
        },
    }
}

fn ask_queries(model: &Model, database: &Database, queries: &[Query], bound: f64) -> Found {
    let Ok(mut state) = ModelState::new(model, &Selection::default()) else { return Found::NO_ANSWER };
    let largest_force = queries.iter().map(|q| q.force_n).fold(0.0, f64::max);
    let mut found = Found { error: 0.0, flagged: true };
    for query in queries {
        let (evaluation, out) = answer(&mut state, query.pressure, query.gap);
        let (mut error, mut covered) = (0.0_f64, true);
        for (f, spec) in database.fields.iter().enumerate() {
            let truth = query.truth.iter().skip(f).step_by(database.fields.len()).map(|v| f64::from(*v));
            let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
            for (t, p) in truth.zip(&out[f * database.node_count..]) {
                // NaN must not pass as small: `max` would drop it.
                let e = (f64::from(*p) - t).abs();
                worst = if e <= worst { worst } else { e };
                largest = largest.max(t.abs());
            }
            error = larger(error, if largest > 0.0 { worst / largest } else { worst });
            covered &= match spec.kind {
                FieldKind::Stress => worst <= evaluation.halfwidths.stress_mpa,
                _ => worst <= evaluation.halfwidths.displacement_mm,
            };
        }
        let force_error = (evaluation.contact_force_n - query.force_n).abs();
        if largest_force > 0.0 {
            error = larger(error, force_error / largest_force);
        }
        covered &= force_error <= evaluation.halfwidths.force_n;
        found.flagged &= error <= bound || covered || evaluation.domain != DomainStatus::Inside;
        found.error = larger(found.error, error);
    }
    found
}

/// The larger, where NaN is larger than anything.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

fn answer(state: &mut ModelState, pressure: f64, gap: f64) -> (Evaluation, Vec<f32>) {
    let found = state.update(Inputs::new(pressure, gap)).map(|_| state.fields().to_vec());
    // No fields, no answer.
    let fields = found.unwrap_or_else(|_| vec![f32::NAN; state.fields().len()]);
    (state.evaluation().clone(), fields)
}

/// Largest jump of any field value over the field's size, and of the force over the largest force, across the onset from
/// the sag to the reach.
fn largest_jump(model: &Model) -> f64 {
    let Some(table) = model.header.onset.as_ref() else { return f64::INFINITY };
    let Ok(mut state) = ModelState::new(model, &Selection::default()) else { return f64::INFINITY };
    let (sag, last) = (table.sag_mm(), table.reach_mm());
    let gaps = (0..=100).map(|i| sag + (last - sag) * f64::from(i) / 100.0);
    let fields = state.reconstructor().field_count();
    // By field: the largest jump, and the largest value at any gap (at P = 0 there is hardly a stress to compare with).
    let (mut jumps, mut sizes, mut force) = (vec![0.0; fields], vec![0.0_f32; fields], 0.0);
    for gap in gaps {
        let onset = match table.onset(gap) {
            Onset::At(pressure) => pressure,
            Onset::Always => 0.0,
            Onset::Never => continue,
        };
        // At the sag itself the weight already touches: a hair above it is the free side.
        let (free, below) = answer(&mut state, onset - 1e-9, gap * (1.0 + 1e-12));
        let (contact, above) = answer(&mut state, onset + 1e-9, gap);
        force = larger(force, (contact.contact_force_n - free.contact_force_n).abs());
        let rows = state.reconstructor().rows();
        for (f, (below, above)) in below.chunks(rows).zip(above.chunks(rows)).enumerate() {
            let jump = below.iter().zip(above).map(|(a, b)| f64::from((a - b).abs()));
            jumps[f] = larger(jumps[f], jump.fold(0.0, larger));
            sizes[f] = below.iter().fold(sizes[f], |m, v| m.max(v.abs()));
        }
    }
    jumps
        .iter()
        .zip(&sizes)
        .map(|(jump, size)| jump / f64::from(size.max(f32::MIN_POSITIVE)))
        .fold(force, larger)
}

/// Largest difference of two models' answers over the database's own states and the points half way between them.
fn largest_difference(a: &Model, b: &Model, database: &Database) -> f64 {
    let states = (ModelState::new(a, &Selection::default()), ModelState::new(b, &Selection::default()));
    let (Ok(mut a), Ok(mut b)) = states else { return f64::INFINITY };
    let mut worst = 0.0;
    let point =
        |i: usize| (database.cases[i].pressure_mpa, database.cases[i].gap_mm.unwrap_or(f64::INFINITY));
    for i in 1..database.cases.len() {
        let (p, q) = (point(i - 1), point(i));
        let middle = if p.1.is_finite() && q.1.is_finite() { 0.5 * (p.1 + q.1) } else { q.1 };
        let (one, x) = answer(&mut a, 0.5 * (p.0 + q.0), middle);
        let (two, y) = answer(&mut b, 0.5 * (p.0 + q.0), middle);
        let size = x.iter().fold(f32::MIN_POSITIVE, |m, v| m.max(v.abs()));
        let difference = x.iter().zip(&y).map(|(x, y)| f64::from((x - y).abs())).fold(0.0, larger);
        worst = larger(worst, difference / f64::from(size));
        worst = larger(worst, (one.contact_force_n - two.contact_force_n).abs());
    }
    worst
}
