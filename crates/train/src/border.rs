//! What decides between named regimes: one score a regime, 1 at its own training states and -1 at those of the others,
//! interpolated over all training states as coefficients are. Leave-one-out says how often the largest score is the wrong one.

use crate::config::{ModeChoice, TrainConfig};
use crate::datasheet::{BorderSheet, WrongState};
use crate::error::TrainError;
use crate::regime::named_inputs;
use crate::select::{States, Task, choose};
use crate::sort::{Sorted, varying};
use rom::border::largest;
use rom::inputs::{InputMap, Inputs, Point, square_distance};
use rom::model::{Border, NamedRegimes};
use rom::snapshots::{Database, RegimeKind};

/// A state whose best two scores are closer than this is near another regime, whatever leave-one-out says: at a training state
/// they are 2 apart.
const MIN_MARGIN: f64 = 0.2;
/// Beyond this a state is not doubted, whatever leave-one-out says.
const MAX_MARGIN: f64 = 1.0;
/// A regime needs so many more states than inputs vary in it, to be predicted with one state left out.
const SPARE_STATES: usize = 2;

/// Refuses regimes with too few states to train them on.
///
/// # Errors
/// [`TrainError::Database`] with each regime's name and what would do.
pub(crate) fn check_counts(database: &Database, sorted: &Sorted) -> Result<(), TrainError> {
    let mut problems = Vec::new();
    for (at, cases) in sorted.named.iter().enumerate() {
        let kind = RegimeKind::Named(at as u8);
        let states: Vec<Inputs> = cases.iter().map(|&i| named_inputs(database, i)).collect();
        let inputs = match cases.is_empty() {
            true => 1,
            false => InputMap::of_states(&states, &varying(database, kind)).dimensions(),
        };
        let needed = inputs + SPARE_STATES;
        if cases.len() < needed {
            problems.push(format!(
                "regime {}: expected at least {needed} training states (one for each input that varies in it, {inputs}, and \
                 {SPARE_STATES} more), found {}; add states, give them the name of another regime, or leave them out",
                database.regime_name(kind),
                cases.len()
            ));
        }
    }
    if problems.is_empty() { Ok(()) } else { Err(TrainError::Database(problems)) }
}

/// Names and boundary of the database's regimes, and what the data sheet says of it.
pub(crate) fn learn(
    database: &Database,
    config: &TrainConfig,
    sorted: &Sorted,
) -> Result<(NamedRegimes, Option<BorderSheet>), TrainError> {
    let names = database.regime_names.clone();
    if names.len() < 2 {
        return Ok((NamedRegimes { names, border: None }, None));
    }
    let cases: Vec<usize> = sorted.named.iter().flatten().copied().collect();
    let places: Vec<usize> =
        sorted.named.iter().enumerate().flat_map(|(at, own)| vec![at; own.len()]).collect();
    let points: Vec<Inputs> = cases.iter().map(|&i| named_inputs(database, i)).collect();
    let inputs = InputMap::of_states(&points, &varying(database, RegimeKind::Named(0)));
    let scaled: Vec<Point> = points.iter().map(|point| inputs.scale(point)).collect();
    refuse_twins(database, config, &cases, &places, &scaled)?;
    let count = names.len();
    let labels =
        |place: &usize| (0..count).map(|at| if at == *place { 1.0 } else { -1.0 }).collect::<Vec<f64>>();
    let values: Vec<f64> = places.iter().flat_map(labels).collect();
    let task = Task {
        values: values.clone(),
        outputs: count,
        slope_values: Vec::new(),
        dropped: vec![0.0; cases.len()],
        modes: ModeChoice::Fixed(count),
        modes_for_energy: count,
    };
    let score = vec![1.0; cases.len()];
    let (operating, dimensions) = (inputs.operating(), inputs.dimensions());
    let states = States { operating, dimensions, inputs: &scaled, score: &score, slopes: &[] };
    let refused = |source| {
        let what = "the boundary between the regimes".to_owned();
        TrainError::Fit { what, regime: names.join(", "), source }
    };
    let choice = choose(states, &[task], &config.free).map_err(refused)?.swap_remove(0); // one task, one choice
    let left_out: Vec<f64> =
        values.iter().zip(&choice.fit.residuals).map(|(label, error)| label - error).collect();
    let found: Vec<(usize, f64)> = left_out.chunks_exact(count).map(largest).collect();
    let wrong: Vec<usize> = (0..cases.len()).filter(|&i| found[i].0 != places[i]).collect();
    let doubt = doubt(wrong.iter().map(|&i| found[i].1).collect(), config.coverage);
    let state = |&i: &usize| WrongState {
        case: database.cases[cases[i]].name.clone(),
        regime: names[places[i]].clone(),
        assigned: names[found[i].0].clone(),
    };
    let sheet = BorderSheet {
        kernel: choice.candidates.first().map_or_else(String::new, |candidate| candidate.kernel.clone()),
        states: cases.len(),
        wrong_share: wrong.len() as f64 / cases.len() as f64,
        wrong: wrong.iter().map(state).collect(),
        doubt,
    };
    let border = Border { inputs, scores: choice.fit.interpolant, doubt };
    Ok((NamedRegimes { names, border: Some(border) }, Some(sheet)))
}

/// How close the best two scores are for a state to be doubted: closer than in `coverage` of the wrongly assigned states.
fn doubt(mut margins: Vec<f64>, coverage: f64) -> f64 {
    margins.sort_by(f64::total_cmp);
    let rank = (margins.len() as f64 * coverage).ceil() as usize;
    let margin = rank.checked_sub(1).and_then(|at| margins.get(at)).copied().unwrap_or(0.0);
    margin.clamp(MIN_MARGIN, MAX_MARGIN)
}

/// Refuses states at the same inputs in different regimes: inputs alone cannot tell which one holds.
fn refuse_twins(
    database: &Database,
    config: &TrainConfig,
    cases: &[usize],
    places: &[usize],
    scaled: &[Point],
) -> Result<(), TrainError> {
    let mut problems = Vec::new();
    for i in 0..cases.len() {
        let same = |&j: &usize| square_distance(&scaled[i], &scaled[j]).sqrt() <= config.duplicate_distance;
        let Some(j) = (0..i).filter(|j| places[*j] != places[i]).find(same) else { continue };
        let (a, b) = (&database.cases[cases[j]], &database.cases[cases[i]]);
        problems.push(format!(
            "cases {} ({}) and {} ({}) have the same inputs, which alone decide the regime; add an input that tells them apart \
             (an imperfection, the way the load came), or leave one out",
            a.name,
            database.regime_name(a.regime),
            b.name,
            database.regime_name(b.regime)
        ));
    }
    if problems.is_empty() { Ok(()) } else { Err(TrainError::Database(problems)) }
}
