//! Inputs of a model: a vector of named values, of which pressure and gap are the two that every model has.
//!
//! A model declares its inputs once ([`InputSpec`]); a state is one value for each ([`Inputs`]); a regime is interpolated
//! over those that vary in it ([`InputMap`]), each scaled to [0, 1] over its training range.

use crate::statistics::ends;
use serde::{Deserialize, Serialize};

/// Largest number of inputs of a model.
pub const MAX_INPUTS: usize = 8;
/// Position of the cavity pressure (MPa) in the inputs of every model.
pub const PRESSURE: usize = 0;
/// Position of the gap (mm) in the inputs of every model.
pub const GAP: usize = 1;

/// Position of the first parameter, if a model has any.
pub const PARAMETERS: usize = 2;

/// Scaled inputs of a regime; entries beyond its dimensions are 0.
pub type Point = [f64; MAX_INPUTS];

/// Squared distance of two points, summed in the order of the inputs.
pub fn square_distance(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The name that an unknown one most likely stands for: one that ends with it (`mu_mpa`), or contains it, or differs by the
/// fewest letters.
pub fn nearest_name<'a>(name: &str, known: &'a [String]) -> Option<&'a String> {
    let differs =
        |known: &&String| (!known.ends_with(name), !known.contains(name), strsim::levenshtein(known, name));
    known.iter().min_by_key(differs)
}

/// A number without the digits of its rounding, for messages.
pub(crate) fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// A quantity of material or geometry that differs between the cases: an input in addition to pressure and gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Dotted key in the actuator's description (`elastomer.law.mu_mpa`).
    pub name: String,
    /// Unit (`MPa`).
    pub unit: String,
    /// Value of the actuator as described: the default of a state.
    pub nominal: f64,
}

/// Inputs that a model's answers depend on, of the two that every model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Any answer depends on the pressure.
    pub pressure: bool,
    /// Any answer depends on the gap.
    pub gap: bool,
}

/// An input as the model declares it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputSpec {
    /// Name (`pressure`).
    pub name: String,
    /// Unit (`MPa`).
    pub unit: String,
    /// Smallest and largest training value over all regimes; the same twice when all samples shared it, infinite when no
    /// regime was trained over it.
    pub range: [f64; 2],
    /// Default of a state: a parameter's nominal value or that of the scene; `None` for
    /// pressure and gap.
    pub value: Option<f64>,
}

impl InputSpec {
    /// Key in files and messages: name and unit (`pressure_mpa`); a parameter's name is its key already.
    pub fn key(&self) -> String {
        match self.value {
            None => format!("{}_{}", self.name, self.unit.to_lowercase()),
            Some(_) => self.name.clone(),
        }
    }

    /// Pressure, gap and the parameters of a database, without a range.
    pub fn without_range(parameters: &[Parameter]) -> Vec<Self> {
        let spec = |name: &str, unit: &str, value: Option<f64>| Self {
            name: name.into(),
            unit: unit.into(),
            range: [f64::NEG_INFINITY, f64::INFINITY],
            value,
        };
        let further = parameters.iter().map(|p| spec(&p.name, &p.unit, Some(p.nominal)));
        [spec("pressure", "MPa", None), spec("gap", "mm", None)].into_iter().chain(further).collect()
    }

    /// The same inputs with the ranges that the regimes were trained over.
    pub fn ranged<'a>(
        mut inputs: Vec<Self>,
        regimes: impl Iterator<Item = &'a InputMap> + Clone,
    ) -> Vec<Self> {
        for (index, input) in inputs.iter_mut().enumerate() {
            let ranges = regimes.clone().filter_map(|regime| regime.range(index));
            if let Some(range) = ranges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]) {
                input.range = range;
            }
        }
        inputs
    }
}

/// One value for each input of a model, in the order in which the model declares them. Inputs that were not set are NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs([f64; MAX_INPUTS]);

impl Inputs {
    /// Pressure in MPa and gap in mm; `f64::INFINITY` when there is no obstacle.
    pub fn new(pressure_mpa: f64, gap_mm: f64) -> Self {
        Self([f64::NAN; MAX_INPUTS]).with(PRESSURE, pressure_mpa).with(GAP, gap_mm)
    }

    /// The same with another value, in the unit that the model declares, at a position.
    ///
    /// # Panics
    /// If `input` is not below [`MAX_INPUTS`].
    pub fn with(mut self, input: usize, value: f64) -> Self {
        self.0[input] = value;
        self
    }

    /// Cavity pressure in MPa.
    pub fn pressure_mpa(&self) -> f64 {
        self.0[PRESSURE]
    }

    /// Gap in mm.
    pub fn gap_mm(&self) -> f64 {
        self.0[GAP]
    }

    /// The same with `values` wherever nothing was set (NaN).
    pub fn or(mut self, values: &[f64; MAX_INPUTS]) -> Self {
        self.0.iter_mut().zip(values).filter(|(own, _)| own.is_nan()).for_each(|(own, v)| *own = *v);
        self
    }

    /// The values by position.
    pub fn values(&self) -> &[f64; MAX_INPUTS] {
        &self.0
    }

    /// Point of the straight line to other inputs; entries whose difference is not finite, such as infinite gaps, are those of `to`.
    pub fn between(&self, to: &Self, fraction: f64) -> Self {
        let mut values = to.0;
        for (value, from) in values.iter_mut().zip(self.0) {
            let change = *value - from;
            if change.is_finite() {
                *value = from + fraction * change;
            }
        }
        Self(values)
    }
}

impl From<[f64; MAX_INPUTS]> for Inputs {
    /// Values by position, NaN where none is set.
    fn from(values: [f64; MAX_INPUTS]) -> Self {
        Self(values)
    }
}

/// The inputs that a regime is interpolated over, and those that all of its samples shared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InputMap {
    /// Interpolated over, by increasing position.
    pub axes: Vec<InputAxis>,
    /// Inputs that did not vary.
    pub constants: Vec<InputConstant>,
}

/// Value of an input that did not vary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputConstant {
    /// Position in the model's inputs.
    pub input: usize,
    /// Value in all samples.
    pub value: f64,
}

/// One input of a regime and the range it was sampled over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputAxis {
    /// Position in the model's inputs.
    pub input: usize,
    /// Smallest training value.
    pub min: f64,
    /// Largest training value.
    pub max: f64,
}

impl InputMap {
    /// Axes for those of `inputs` that vary over the states; when none does the first one, a unit wide.
    pub fn of_states(states: &[Inputs], inputs: &[usize]) -> Self {
        let axis = |&input: &usize| {
            let [min, max] = ends(states.iter().map(|state| state.0[input]));
            InputAxis { input, min, max }
        };
        let varies = |a: &InputAxis| a.max - a.min > 1e-9 * a.max.abs().max(a.min.abs());
        let (mut axes, mut constant): (Vec<InputAxis>, Vec<InputAxis>) =
            inputs.iter().map(axis).partition(varies);
        if axes.is_empty() && !constant.is_empty() {
            let first = constant.remove(0);
            axes.push(InputAxis { max: first.min + 1.0, ..first });
        }
        // A pressure that all samples shared is not kept: states at other pressures stay inside the training range.
        let kept = constant.iter().filter(|a| a.input != PRESSURE);
        Self { axes, constants: kept.map(|a| InputConstant { input: a.input, value: a.min }).collect() }
    }

    /// Number of axes, at least 1 and at most [`MAX_INPUTS`].
    pub fn dimensions(&self) -> usize {
        self.axes.len()
    }

    /// Number of leading axes that are pressure or gap; the others are parameters.
    pub fn operating(&self) -> usize {
        self.axes.iter().filter(|axis| axis.input < PARAMETERS).count()
    }

    /// The sampled range of an input; the same value twice when all samples shared it; none when it is no input here.
    pub fn range(&self, input: usize) -> Option<[f64; 2]> {
        let axis = self.axes.iter().find(|axis| axis.input == input).map(|axis| [axis.min, axis.max]);
        axis.or_else(|| self.constants.iter().find(|c| c.input == input).map(|c| [c.value; 2]))
    }

    /// Scales a state to [0, 1] over the training range, by axis; entries beyond the axes are 0.
    pub fn scale(&self, inputs: &Inputs) -> [f64; MAX_INPUTS] {
        let mut x = Point::default();
        for (x, axis) in x.iter_mut().zip(&self.axes) {
            *x = (inputs.0[axis.input] - axis.min) / (axis.max - axis.min);
        }
        x
    }

    /// Largest relative distance of a state from the inputs that did not vary; 0 if all varied.
    pub(crate) fn off_constants(&self, inputs: &Inputs) -> f64 {
        let off = |c: &InputConstant| (inputs.0[c.input] - c.value).abs() / c.value.abs().max(1.0);
        self.constants.iter().map(off).fold(0.0, f64::max)
    }
}

/// What a reading did to a state that remembers the inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advance {
    /// The first reading: the state is in equilibrium with it, the past unknown.
    Started,
    /// Advanced to the reading's time.
    Advanced,
    /// Advanced over more than the longest gap that is bridged: the last input was held, the past is less known.
    Gap,
    /// Stamp not after the last one: nothing changed.
    Late,
    /// An input that is remembered is not finite: nothing changed. The next reading spans the time.
    NotFinite,
}
