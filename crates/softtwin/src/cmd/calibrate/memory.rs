//! Memory between the measured pressure and the one that acts, identified beside the unknowns of a model.
//!
//! A first search takes polynomials as static map, because the unknowns fitted without memory are far off. The unknowns are fitted behind what it
//! finds; then the static map is that of the model, linear in the unknowns about their estimates: terms `1, h, dh/du_j` of each measured
//! quantity, over pressures on a grid. Fit and search are repeated until the estimates stay.

use crate::failure::{configuration, unexplained};
use crate::files;
use crate::unknowns::{Unknowns, problems};
use estimate::{Fit, InputRole, Measurement, Model as _, Predicted, Setup};
use rom::inputs::{Inputs, PRESSURE};
use rom::memory::MemorySpec;
use rom::model::{BlockKind, Model};
use rom::statistics::{ends, range};
use runtime::estimation::{self, SensorModel};
use std::path::Path;
use train::measured::Run;
use train::memory::{Identified, ModelTerms, identify, slopes};

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

/// Unknowns fitted to readings behind the memory of their model.
pub struct Calibration {
    /// Unknowns with their model's sensors.
    pub unknowns: Unknowns,
    /// Readings behind the memory.
    pub readings: Vec<Measurement>,
    /// Fit to them.
    pub fit: Fit,
}

impl Calibration {
    /// Fits.
    pub fn of(mut unknowns: Unknowns, mut readings: Vec<Measurement>) -> anyhow::Result<Self> {
        if unknowns.session.filters_inputs() {
            estimation::filter(&mut unknowns.session, &unknowns.setup, &mut readings);
        }
        let fit = estimate::fit(&unknowns.setup, &readings, &mut unknowns.sensors)
            .map_err(|errors| problems(errors.iter().map(ToString::to_string).collect()))?;
        Ok(Self { unknowns, readings, fit })
    }
}

/// Identifies the memory, writes the model with it and fits the unknowns behind it.
///
/// # Errors
/// A pressure that does not move; a model without pressure; I/O errors.
pub fn calibrate(
    of: Unknowns,
    readings: &[Measurement],
    out: &Path,
) -> anyhow::Result<(Calibration, Identified)> {
    let mut model = files::model(&of.spec.model)?;
    model.blocks.retain(|(kind, _)| *kind != BlockKind::Memory);
    model.header.set_parameters(of.spec.given_inputs()).map_err(configuration)?;
    let spec = of.spec.clone();
    let mut last_s = f64::NEG_INFINITY;
    let driven = readings.iter().filter(|reading| {
        let keeps = reading.inputs[PRESSURE].is_finite() && reading.t_s > last_s;
        last_s = if keeps { reading.t_s } else { last_s };
        keeps
    });
    let readings: &[Measurement] = &driven.copied().collect::<Vec<_>>();
    let run = |at: &[usize]| Run {
        time_s: readings.iter().map(|reading| reading.t_s).collect(),
        inputs: vec![readings.iter().map(|reading| reading.inputs[PRESSURE]).collect()],
        outputs: at.iter().map(|row| readings.iter().map(|reading| reading.rows[*row]).collect()).collect(),
    };
    let measured = |row: &usize| readings.iter().filter(|r| r.rows[*row].is_finite()).count() >= MIN_VALUES;
    let rows: Vec<usize> = (0..of.setup.rows.len()).filter(measured).collect();
    if rows.is_empty() {
        return Err(unexplained(format!(
            "--memory: expected at least {MIN_VALUES} readings with a pressure and a measured quantity, found {}; record longer",
            readings.len()
        )));
    }
    let (run, scales) = (run(&rows), scales(&of.setup, readings, &rows));
    let mut calibration = Calibration::of(Unknowns::of(spec.clone(), &model)?, readings.to_vec())?;
    let mut found = None;
    for round in 0..ROUNDS {
        let estimates: Vec<f64> = calibration.fit.estimates.iter().map(|estimate| estimate.value).collect();
        let own = &calibration.unknowns;
        let terms = Terms::new(&own.setup, readings, &estimates, &mut own.sensors.clone(), (&rows, &scales));
        let model_terms: Option<&dyn ModelTerms> = if round > 0 { Some(&terms) } else { None };
        let identified = identify(std::slice::from_ref(&run), true, &scales, model_terms).ok_or_else(|| {
            unexplained(String::from(
                "--memory: expected a recording in which the pressure moves, found one that identifies no memory",
            ))
        })?;
        let placed = identified.memory.as_ref().map(|memory| placed(memory, &model, &calibration, readings));
        found = Some(identified);
        model.blocks.retain(|(kind, _)| *kind != BlockKind::Memory);
        if let Some(placed) = placed {
            model.set_record(BlockKind::Memory, &placed)?;
        }
        let next = Calibration::of(Unknowns::of(spec.clone(), &model)?, readings.to_vec())?;
        let mut both = next.fit.estimates.iter().zip(&estimates);
        let stay = both.all(|(new, old)| (new.value - old).abs() < SETTLED_SIGMAS * new.sigma);
        calibration = next;
        if stay && round > 0 {
            break;
        }
    }
    files::save(out, &model.to_bytes()?)?;
    found.map(|found| (calibration, found)).ok_or_else(|| anyhow::anyhow!("no search"))
}

/// The blocks at the model's pressure, with the slopes of its answers at readings.
fn placed(found: &MemorySpec, model: &Model, of: &Calibration, readings: &[Measurement]) -> MemorySpec {
    let estimates: Vec<f64> = of.fit.estimates.iter().map(|estimate| estimate.value).collect();
    let step = readings.len().div_ceil(SLOPE_READINGS).max(1);
    let state = |reading: &Measurement| Inputs::from(of.unknowns.setup.inputs(reading, &estimates));
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
struct Terms {
    count: usize,
    low: f64,
    high: f64,
    /// Table of each reading.
    of_reading: Vec<usize>,
    /// Terms of all quantities at each pressure of the grid.
    tables: Vec<Vec<Vec<f64>>>,
}

impl Terms {
    fn new(
        setup: &Setup,
        readings: &[Measurement],
        estimates: &[f64],
        sensors: &mut SensorModel,
        (rows, scales): (&[usize], &[f64]),
    ) -> Self {
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
    sensors: &mut SensorModel,
    (rows, scales): (&[usize], &[f64]),
) -> Vec<f64> {
    let mut predict = |unknowns: &[f64]| -> Vec<f64> {
        let mut predicted = vec![Predicted::default(); setup.rows.len()];
        sensors.predict(&setup.inputs(reading, unknowns), &mut predicted);
        let scaled = rows.iter().zip(scales).map(|(row, scale)| predicted[*row].value / scale);
        // Where the model has no prediction, the row tells nothing.
        scaled.map(|v| if v.is_finite() { v } else { 0.0 }).collect()
    };
    let at = predict(estimates);
    let by_unknown = setup.unknowns.iter().enumerate().map(|(k, unknown)| {
        let mut moved = estimates.to_vec();
        let step = STEP_SIGMAS * unknown.sigma;
        moved[k] += if moved[k] + step > unknown.range[1] { -step } else { step };
        let there = predict(&moved);
        there.iter().zip(&at).map(|(there, at)| (there - at) / STEP_SIGMAS).collect::<Vec<f64>>()
    });
    let by_unknown: Vec<Vec<f64>> = by_unknown.collect();
    let of_row = |row: usize| [1.0, at[row]].into_iter().chain(by_unknown.iter().map(move |by| by[row]));
    (0..rows.len()).flat_map(of_row).collect()
}

impl ModelTerms for Terms {
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

/// True if the pressure is measured: memory acts on it.
pub fn is_pressure_measured(setup: &Setup) -> bool {
    matches!(setup.inputs.get(PRESSURE), Some(InputRole::Measured { .. }))
}
