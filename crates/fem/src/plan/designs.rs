//! Lists of states: chosen one by one, or several of each of many designs, whose free states then cost once for all.

use super::PlanError;
use super::lists::{ListRegime, Parameter};
use crate::cases::{Case, rounded};
use crate::sample::{self, grid, latin_hypercube, onset_pressure_mpa, sequence};
use formats::database::bottom_nodes;
use rom::evaluation::Evaluation;
use rom::evaluator::{Evaluator, Query};
use rom::inputs::{Inputs, PARAMETERS};
use rom::snapshots::{Database, RegimeKind};
use train::config::TrainConfig;

/// Free states of a design, each in a part of the pressures given by shares of their range. Stress is small at low pressures and
/// its error counts by its largest value, hence a state at the lowest pressure and one a little above.
const FREE_SHARES: [[f64; 2]; 4] = [[0.0, 0.0], [0.03, 0.15], [0.15, 0.5], [0.55, 1.0]];
/// One of the states that touch has a pressure within this fraction of the range, for the same reason.
const LOW_SHARE: f64 = 0.17;
/// Offsets of the seeds of loads, of loads at low pressure and of free pressures from that of the designs.
const LOADS_SEED: u64 = 4;
const LOW_SEED: u64 = 5;
const FREE_SEED: u64 = 6;
/// Loads drawn for each that is wanted.
const DRAWS: usize = 20;
/// A state touches for sure above this multiple of the onset pressure: another design's onset may lie higher than the known one.
const SURELY: f64 = 1.3;
const SURELY_MPA: f64 = 1.5e-3;

/// States to list.
pub struct List<'a> {
    /// Parameters that vary.
    pub parameters: &'a [Parameter],
    /// Number of states or designs; of a grid: of pressures.
    pub count: usize,
    /// Pressures (MPa) and gaps (mm).
    pub loads: [[f64; 2]; 2],
    /// First part of all names.
    pub prefix: &'a str,
    /// `train` or `check`.
    pub split: &'a str,
    /// Seed of hypercubes and sequences.
    pub seed: u64,
}

/// How states are chosen.
pub enum Sampling {
    /// Latin hypercube.
    Hypercube,
    /// Low-discrepancy sequence.
    Sequence,
    /// Grid of pressures and so many gaps, of an actuator whose parameters do not vary.
    Grid {
        /// Number of gaps.
        gaps: usize,
    },
    /// Points on the onset of contact.
    Onset(Onset),
}

impl List<'_> {
    /// States of a regime, chosen one by one.
    ///
    /// # Errors
    /// An onset that does not know the parameters, or no gap of the list.
    pub fn cases(&self, regime: ListRegime, sampling: Sampling) -> Result<Vec<Case>, PlanError> {
        let loads = if regime == ListRegime::Free { &self.loads[..1] } else { &self.loads };
        let ranges: Vec<[f64; 2]> =
            loads.iter().copied().chain(self.parameters.iter().map(|p| p.range)).collect();
        let points = match sampling {
            Sampling::Hypercube => latin_hypercube(self.count, &ranges, self.seed),
            Sampling::Sequence => sequence(self.count, &ranges, self.seed),
            Sampling::Grid { gaps } => grid(&[self.count, gaps][..loads.len()], loads),
            Sampling::Onset(onset) => self.on_onset(onset, &ranges[1..])?,
        };
        let case = |(index, point): (usize, &Vec<f64>)| {
            let (load, values) = point.split_at(point.len() - self.parameters.len());
            let regime = regime.of(index);
            let gap_mm = load.get(1).copied().filter(|_| regime != ListRegime::Free);
            let settings = self.parameters.iter().zip(values);
            Case {
                settings: settings.map(|(p, value)| (p.name.clone(), rounded(*value, 1e9))).collect(),
                ..regime.case(format!("{}{:03}", self.prefix, index + 1), self.split, (load[0], gap_mm))
            }
        };
        Ok(points.iter().enumerate().map(case).collect())
    }

    /// Points on the onset over gaps and parameters.
    fn on_onset(&self, mut onset: Onset, ranges: &[[f64; 2]]) -> Result<Vec<Vec<f64>>, PlanError> {
        let points: Vec<Vec<f64>> = match &mut onset {
            Onset::OneDesign(_) if !self.parameters.is_empty() => {
                return Err(PlanError::Refused(
                    "--database: expected one over the parameters, found one without".into(),
                ));
            }
            Onset::OneDesign(clearances) => sample::onset(self.count, clearances, self.loads[1]),
            Onset::Model(..) => {
                let point = |at: Vec<f64>| Some([&[onset.pressure_mpa(at[0], &at[1..])?], &at[..]].concat());
                sequence(self.count, ranges, self.seed).into_iter().filter_map(point).collect()
            }
        };
        if points.is_empty() {
            let [low, high] = self.loads[1];
            return Err(PlanError::Database(format!(
                "its free states reach no gap of {low} to {high} mm; simulate free states at higher pressures"
            )));
        }
        Ok(points)
    }

    /// States of each design, design after design: a free one for each of [`FREE_SHARES`], then the rest with the obstacle, from the
    /// farthest to the nearest.
    ///
    /// # Errors
    /// Too few states touch.
    pub fn designs(&self, states: usize, mut onset: Option<Onset>) -> Result<Vec<Case>, PlanError> {
        let [pressures, gaps] = self.loads;
        let ranges: Vec<[f64; 2]> = self.parameters.iter().map(|p| p.range).collect();
        let pressure_at = |share: f64| pressures[0] + share * (pressures[1] - pressures[0]);
        let free = sequence(
            self.count,
            &FREE_SHARES.map(|part| part.map(pressure_at)),
            self.seed.wrapping_add(FREE_SEED),
        );
        let touching = states - FREE_SHARES.len();
        let draws = |states: usize, pressures: [f64; 2], seed: u64| {
            sequence(self.count * states * DRAWS, &[pressures, gaps], self.seed.wrapping_add(seed))
                .into_iter()
        };
        let mut low_draws = draws(1, [pressures[0], pressure_at(LOW_SHARE)], LOW_SEED);
        let mut draws = draws(touching, pressures, LOADS_SEED);
        let mut cases = Vec::new();
        for (design, (values, free)) in sequence(self.count, &ranges, self.seed).iter().zip(free).enumerate()
        {
            let mut touches =
                |load: &Vec<f64>| onset.as_mut().is_none_or(|onset| onset.is_surely_exceeded(load, values));
            let low = low_draws.by_ref().filter(&mut touches).take(1).collect::<Vec<_>>();
            let high = draws.by_ref().filter(&mut touches).take(touching - low.len());
            let mut loads: Vec<Vec<f64>> = low.into_iter().chain(high).collect();
            if loads.len() < touching {
                return Err(PlanError::Database(format!(
                    "too few states touch between {pressures:?} MPa and {gaps:?} mm; raise --pressure or lower --gap"
                )));
            }
            loads.sort_by(|a, b| b[1].total_cmp(&a[1]));
            let name = |kind: &str, k: usize| format!("{}{:02}{kind}{}", self.prefix, design + 1, k + 1);
            let free =
                free.iter().enumerate().map(|(k, p)| self.design_case(name("f", k), (*p, None), values));
            let loads = loads
                .iter()
                .enumerate()
                .map(|(k, l)| self.design_case(name("c", k), (l[0], Some(l[1])), values));
            cases.extend(free.chain(loads));
        }
        Ok(cases)
    }

    /// A design's case, rounded to 1e-6 of the units (gaps to 1e-4 mm) for shorter lists.
    fn design_case(&self, name: String, (pressure_mpa, gap_mm): (f64, Option<f64>), values: &[f64]) -> Case {
        let settings = self.parameters.iter().zip(values);
        Case {
            split: self.split.into(),
            settings: settings.map(|(p, value)| (p.name.clone(), rounded(*value, 1e6))).collect(),
            ..Case::new(name, rounded(pressure_mpa, 1e6), gap_mm.map(|gap| rounded(gap, 1e4)))
        }
    }
}

/// When contact begins, as a database knows it.
pub enum Onset {
    /// Onset from free states of one design: pressure in MPa and depth in mm of the lowest point, by rising pressure.
    OneDesign(Vec<(f64, f64)>),
    /// Onset from a model trained over parameters: scratch, model, and the index of each listed parameter among its inputs.
    Model(Box<Evaluation>, Box<Evaluator>, Vec<usize>),
}

impl Onset {
    /// Reads it off a database; `names` are the parameters of the states it is wanted for.
    pub fn of(database: &Database, names: &[&str]) -> Result<Self, PlanError> {
        if database.parameters.is_empty() {
            let needs = || PlanError::Database("the onset needs the undeformed mesh and a field y".into());
            let mut table = clearances(database).ok_or_else(needs)?;
            table.sort_by(|a, b| a.0.total_cmp(&b.0));
            return Ok(Self::OneDesign(table));
        }
        let known: Vec<&str> = database.parameters.iter().map(|p| p.name.as_str()).collect();
        let place = |name: &&str| {
            let place = known.iter().position(|known| known == name).map(|at| PARAMETERS + at);
            let known = known.join(", ");
            place.ok_or_else(|| {
                PlanError::Database(format!("the database has no parameter {name}, only {known}"))
            })
        };
        let places = names.iter().map(place).collect::<Result<_, PlanError>>()?;
        let trained = train::train(database, &TrainConfig::default(), &mut |_| ())?;
        let evaluator = Evaluator::new(&trained.0.header)?;
        Ok(Self::Model(evaluator.evaluation().into(), evaluator.into(), places))
    }

    /// Onset pressure (MPa) of a gap at a design: 0 where gravity alone touches, none beyond reach.
    pub fn pressure_mpa(&mut self, gap_mm: f64, values: &[f64]) -> Option<f64> {
        match self {
            Self::OneDesign(table) if table.first().is_some_and(|rest| gap_mm <= rest.1) => Some(0.0),
            Self::OneDesign(table) => onset_pressure_mpa(table, gap_mm),
            Self::Model(out, evaluator, places) => {
                let with_value = |inputs: Inputs, (place, value): (&usize, &f64)| inputs.with(*place, *value);
                let inputs = places.iter().zip(values).fold(Inputs::new(0.0, gap_mm), with_value);
                evaluator.answer(inputs, Query::REGIME, out);
                out.onset_pressure_mpa
            }
        }
    }

    fn is_surely_exceeded(&mut self, load: &[f64], values: &[f64]) -> bool {
        self.pressure_mpa(load[1], values).is_some_and(|onset| load[0] > SURELY * onset + SURELY_MPA)
    }
}

/// Pressure and depth of the lowest point of the base's underside for each free state.
fn clearances(database: &Database) -> Option<Vec<(f64, f64)>> {
    let y = database.coordinate(1)?;
    let bottom = bottom_nodes(database.undeformed_mm.as_ref()?);
    let free = (0..database.cases.len()).filter(|i| database.cases[*i].regime == RegimeKind::Free);
    let depth = |case: usize| {
        let values: Vec<f32> = database.field(case, y).collect();
        bottom.iter().map(|n| -f64::from(values[*n as usize])).fold(f64::NEG_INFINITY, f64::max)
    };
    Some(free.map(|case| (database.cases[case].pressure_mpa, depth(case))).collect())
}
