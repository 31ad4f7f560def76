//! Memory between the measured pressure and the one that acts, identified beside the unknowns of a model.
//!
//! A first search takes polynomials as static map, because the unknowns fitted without memory are far off. The unknowns are fitted
//! behind what it finds; then the static map is that of the model, linear in the unknowns about their estimates: terms `1, h, dh/du_j`
//! of each measured quantity, over pressures on a grid. Fit and search are repeated until the estimates stay.

use super::map::ModelTerms;
use super::{Identified, identify, slopes};
use crate::measured::Run;
use estimate::{Fit, Measurement, Predicted, Setup};
use rom::inputs::{Inputs, PRESSURE};
use rom::memory::MemorySpec;
use rom::model::{BlockKind, Model, ModelFileError};
use rom::statistics::{ends, range};

/// Most searches: with polynomials, then about the estimates.
const ROUNDS: usize = 8;
/// Change of the estimates by a search, in standard deviations, below which there is no further one.
const SETTLED_SIGMAS: f64 = 0.5;
/// Pressures of the grid.
const GRID: usize = 65;
/// Step of an unknown in the difference quotients, in standard deviations of its prior.
const STEP_SIGMAS: f64 = 0.05;
/// Least number of measured values of a quantity that the search uses.
const MIN_VALUES: usize = 20;
/// Readings at which the slopes of the answers are taken.
const SLOPE_READINGS: usize = 50;

/// Unknowns fitted behind the memory of a model.
pub struct FittedUnknowns<S> {
    /// Unknowns, inputs, measured values.
    pub setup: Setup,
    /// The model's predictions of these values.
    pub sensors: S,
    /// Fit to the readings.
    pub fit: Fit,
}

/// Why no memory is identified.
#[derive(Debug, thiserror::Error)]
pub enum MemoryError {
    /// Too few readings.
    #[error(
        "expected at least {MIN_VALUES} readings with a pressure and a measured quantity, found {found}; record longer"
    )]
    FewReadings {
        /// Readings with a pressure.
        found: usize,
    },
    /// The pressure does not move.
    #[error("expected a recording in which the pressure moves, found one that identifies no memory")]
    Still,
    /// The model cannot hold the memory.
    #[error(transparent)]
    File(#[from] ModelFileError),
}

/// Identifies the memory and puts it into the model, in place of one that it has. `fit` fits the unknowns to readings behind the memory of
/// a model; its last call is for the model as it is left.
///
/// # Errors
/// [`MemoryError`], and those of `fit`.
pub fn identify_beside<S: estimate::Model, E: From<MemoryError>>(
    model: &mut Model,
    readings: &[Measurement],
    mut fit: impl FnMut(&Model, &[Measurement]) -> Result<FittedUnknowns<S>, E>,
) -> Result<Identified, E> {
    model.blocks.retain(|(kind, _)| *kind != BlockKind::Memory);
    let mut last_s = f64::NEG_INFINITY;
    let driven = readings.iter().filter(|reading| {
        let keeps = reading.inputs[PRESSURE].is_finite() && reading.t_s > last_s;
        last_s = if keeps { reading.t_s } else { last_s };
        keeps
    });
    let readings: &[Measurement] = &driven.copied().collect::<Vec<_>>();
    let mut fitted = fit(model, readings)?;
    let measured = |row: &usize| readings.iter().filter(|r| r.rows[*row].is_finite()).count() >= MIN_VALUES;
    let rows: Vec<usize> = (0..fitted.setup.rows.len()).filter(measured).collect();
    if rows.is_empty() {
        return Err(MemoryError::FewReadings { found: readings.len() }.into());
    }
    let run = Run {
        time_s: readings.iter().map(|reading| reading.t_s).collect(),
        inputs: vec![readings.iter().map(|reading| reading.inputs[PRESSURE]).collect()],
        outputs: rows.iter().map(|row| readings.iter().map(|reading| reading.rows[*row]).collect()).collect(),
    };
    let scales = scales(&fitted.setup, readings, &rows);
    let mut search = 0;
    loop {
        let estimates = values(&fitted.fit);
        let terms =
            (search > 0).then(|| UnknownTerms::new(&mut fitted, readings, &estimates, (&rows, &scales)));
        let terms = terms.as_ref().map(|terms| terms as &dyn ModelTerms);
        let found = identify(std::slice::from_ref(&run), true, &scales, terms).ok_or(MemoryError::Still)?;
        let memory = found.memory.as_ref().map(|memory| at_pressure(memory, model, &fitted, readings));
        model.blocks.retain(|(kind, _)| *kind != BlockKind::Memory);
        if let Some(memory) = memory {
            model.set_record(BlockKind::Memory, &memory).map_err(MemoryError::from)?;
        }
        fitted = fit(model, readings)?;
        let mut both = fitted.fit.estimates.iter().zip(&estimates);
        let stay = both.all(|(new, old)| (new.value - old).abs() < SETTLED_SIGMAS * new.sigma);
        search += 1;
        if search == ROUNDS || (stay && search > 1) {
            return Ok(found);
        }
    }
}

fn values(fit: &Fit) -> Vec<f64> {
    fit.estimates.iter().map(|estimate| estimate.value).collect()
}

/// The blocks at the model's pressure, with the slopes of its answers at readings.
fn at_pressure<S>(
    found: &MemorySpec,
    model: &Model,
    fitted: &FittedUnknowns<S>,
    readings: &[Measurement],
) -> MemorySpec {
    let estimates = values(&fitted.fit);
    let step = readings.len().div_ceil(SLOPE_READINGS).max(1);
    let state = |reading: &Measurement| Inputs::from(fitted.setup.inputs(reading, &estimates));
    let states: Vec<Inputs> = readings.iter().step_by(step).map(state).collect();
    let mut memory = found.clone();
    for input in &mut memory.inputs {
        input.input = PRESSURE;
        input.slopes = slopes(model, &states, PRESSURE, input.range);
    }
    memory
}

/// Unit of each quantity's error: the length of the ranges of its block.
fn scales(setup: &Setup, readings: &[Measurement], rows: &[usize]) -> Vec<f64> {
    let range = |row: usize| range(readings.iter().map(|reading| reading.rows[row]));
    let block = |row: &usize| {
        let alike = rows.iter().filter(|other| setup.rows[**other].block == setup.rows[*row].block);
        alike.map(|other| range(*other).powi(2)).sum::<f64>().sqrt().max(setup.rows[*row].sigma)
    };
    rows.iter().map(block).collect()
}

/// Terms of the measured quantities over the pressure, for each set of the other inputs.
struct UnknownTerms {
    count: usize,
    low: f64,
    high: f64,
    /// Table of each reading.
    of_reading: Vec<usize>,
    /// Terms of all quantities at each pressure of the grid.
    tables: Vec<Vec<Vec<f64>>>,
}

impl UnknownTerms {
    fn new<S: estimate::Model>(
        fitted: &mut FittedUnknowns<S>,
        readings: &[Measurement],
        estimates: &[f64],
        (rows, scales): (&[usize], &[f64]),
    ) -> Self {
        let FittedUnknowns { setup, sensors, .. } = fitted;
        let [low, high] = ends(readings.iter().map(|reading| reading.inputs[PRESSURE]));
        let mut known: Vec<Vec<i64>> = Vec::new();
        let (mut of_reading, mut tables) = (Vec::new(), Vec::new());
        for reading in readings {
            // Other inputs within their noise share a table.
            let others = setup.measured_inputs().filter(|(input, _)| *input != PRESSURE);
            let key: Vec<i64> =
                others.map(|(input, sigma)| (reading.inputs[input] / sigma).round() as i64).collect();
            let at = known.iter().position(|other| *other == key).unwrap_or_else(|| {
                known.push(key);
                let at_pressure = |k: usize| {
                    let mut at = *reading;
                    at.inputs[PRESSURE] = low + (high - low) * k as f64 / (GRID - 1) as f64;
                    terms(setup, &at, estimates, sensors, (rows, scales))
                };
                tables.push((0..GRID).map(at_pressure).collect());
                tables.len() - 1
            });
            of_reading.push(at);
        }
        Self { count: 2 + setup.unknowns.len(), low, high, of_reading, tables }
    }
}

/// Terms of all quantities at the inputs of a reading.
fn terms(
    setup: &Setup,
    reading: &Measurement,
    estimates: &[f64],
    sensors: &mut impl estimate::Model,
    (rows, scales): (&[usize], &[f64]),
) -> Vec<f64> {
    let mut predict = |unknowns: &[f64]| -> Vec<f64> {
        let mut predicted = vec![Predicted::default(); setup.rows.len()];
        sensors.predict(&setup.inputs(reading, unknowns), &mut predicted);
        let scaled = rows.iter().zip(scales).map(|(row, scale)| predicted[*row].value / scale);
        // Where the model has no prediction, the row tells nothing.
        scaled.map(|v| if v.is_finite() { v } else { 0.0 }).collect()
    };
    let estimated = predict(estimates);
    let by_unknown = setup.unknowns.iter().enumerate().map(|(k, unknown)| {
        let mut moved = estimates.to_vec();
        let step = STEP_SIGMAS * unknown.sigma;
        moved[k] += if moved[k] + step > unknown.range[1] { -step } else { step };
        let there = predict(&moved);
        there
            .iter()
            .zip(&estimated)
            .map(|(there, estimated)| (there - estimated) / STEP_SIGMAS)
            .collect::<Vec<f64>>()
    });
    let by_unknown: Vec<Vec<f64>> = by_unknown.collect();
    let of_row =
        |row: usize| [1.0, estimated[row]].into_iter().chain(by_unknown.iter().map(move |by| by[row]));
    (0..rows.len()).flat_map(of_row).collect()
}

impl ModelTerms for UnknownTerms {
    fn count(&self) -> usize {
        self.count
    }

    fn push(&self, (_, row): (usize, usize), inputs: &[f64], to: &mut Vec<f64>) {
        let table = &self.tables[self.of_reading[row]];
        let place = (inputs[0] - self.low) / (self.high - self.low) * (GRID - 1) as f64;
        let before = (place.floor().max(0.0) as usize).min(GRID - 2);
        let part = place - before as f64;
        to.extend(table[before].iter().zip(&table[before + 1]).map(|(a, b)| a + part * (b - a)));
    }
}
