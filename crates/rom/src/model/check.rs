//! Checks of a header before it is used for indexing, and resolution of selections.

use super::header::{Clearance, ModelHeader, RegimeModel};
use super::selection::{ModelError, Nodes};
use crate::inertia::data::{InertiaModel, MotionWidths, RegimeInertia, StoredLoad, StoredMode};
use crate::inertia::manifold::{MAX_COORDINATES, MAX_LINEAR_MODES, MAX_LOADS};
use crate::inputs::{InputMap, MAX_INPUTS, PARAMETERS};
use crate::interpolant::{Interpolant, Slope};
use crate::memory::PronyTerm;
use crate::snapshots::RegimeKind;

/// Largest number in an interpolant; sums over it stay finite as f32 fields.
const LARGEST: f64 = 1e25;

/// True if a clearance's lengths fit the free regime.
fn fits(clearance: &Clearance, free: &RegimeModel) -> bool {
    let modes = free.groups.get(clearance.group).map(|group| group.surrogate.outputs);
    let sound = clearance.max_pressure_mpa > 0.0 && clearance.bend_per_mm.is_finite();
    let nodes = clearance.mean_mm.len();
    sound && nodes > 0 && modes.is_some_and(|modes| clearance.modes.len() == modes * nodes)
}

/// Refuses with a sentence what is not sound.
pub(super) type Require<'a> = &'a dyn Fn(bool, &str) -> Result<(), String>;

impl InputMap {
    /// Checks the map for a model with this number of inputs.
    pub(super) fn check(&self, inputs: usize, require: Require) -> Result<(), String> {
        let (axes, constants) = (&self.axes, &self.constants);
        require((1..=MAX_INPUTS).contains(&axes.len()), "a regime needs one to eight inputs")?;
        require(axes.iter().all(|a| a.max > a.min), "an input has an empty range")?;
        let positions = axes.iter().map(|a| a.input).chain(constants.iter().map(|c| c.input));
        require(positions.max() < Some(inputs), "a regime names a missing input")?;
        require(axes.windows(2).all(|a| a[0].input < a[1].input), "a regime's inputs are out of order")
    }
}

impl Interpolant {
    /// Checks the lengths for a regime of `dimensions` inputs.
    pub(super) fn check(&self, dimensions: usize, require: Require) -> Result<(), String> {
        require(self.dimensions == dimensions, "an interpolant has other inputs than its regime")?;
        require(self.centres.len().is_multiple_of(dimensions), "an interpolant's centres are cut")?;
        let (weights, tail) = (self.terms() * self.outputs, self.tail.terms(dimensions) * self.outputs);
        let placed = |s: &Slope| (s.centre as usize) < self.centre_count() && (s.axis as usize) < dimensions;
        require(self.slopes.iter().all(placed), "an interpolant's derivatives name a missing centre")?;
        require(
            self.weights.len() == weights && self.tail_weights.len() == tail,
            "an interpolant's weights are cut",
        )?;
        let numbers =
            [&self.weights[..], &self.tail_weights, &self.centres, &self.metric.scale, &[self.metric.shear]];
        let sane = |number: &f64| number.abs() <= LARGEST;
        require(numbers.into_iter().flatten().all(sane), "an interpolant has numbers that no training gives")
    }
}

impl InertiaModel {
    /// Checks that the data fit the model's header.
    ///
    /// # Errors
    /// A sentence on the first contradiction.
    pub fn check(&self, header: &ModelHeader) -> Result<(), String> {
        let require = |sound: bool, what: &str| if sound { Ok(()) } else { Err(format!("inertia: {what}")) };
        let count = self.coordinates();
        require((1..=MAX_LOADS).contains(&self.loads.len()), "expected 1 to 3 loads")?;
        for (i, StoredLoad { input, unit }) in self.loads.iter().enumerate() {
            let is_parameter = (PARAMETERS..header.inputs.len()).contains(&(*input as usize));
            require(is_parameter, "a load is no parameter of the model")?;
            require(self.loads[..i].iter().all(|other| other.input != *input), "a load is there twice")?;
            require(unit.len() == count, "a load is cut")?;
        }
        require((1..=MAX_COORDINATES).contains(&count), "expected 1 to 16 coordinates")?;
        let sane = self.step_ns > 0 && self.damping_s >= 0.0 && self.damping_s.is_finite();
        require(sane, "expected a step above 0 and a damping of at least 0")?;
        PronyTerm::check(&self.prony).map_err(|reason| format!("inertia: {reason}"))?;
        let MotionWidths { swing, impact, past } = self.widths;
        let widths = [swing, impact, past].concat();
        require(
            widths.iter().all(|v| *v >= 0.0 && v.is_finite()),
            "a half-width of the motion is not valid",
        )?;
        let kinds = header.regimes.iter().map(|regime| regime.kind);
        require(kinds.eq(self.regimes.iter().map(|regime| regime.kind)), "it has other regimes")?;
        require(self.regimes.first().is_some_and(|r| r.kind == RegimeKind::Free), "it has no free regime")?;
        let nodes = header.clearance.as_ref().map_or(0, |clearance| clearance.mean_mm.len());
        for (regime, described) in self.regimes.iter().zip(&header.regimes) {
            let coefficients = described.coefficient_count();
            let varies = |load: &StoredLoad| {
                described.inputs.axes.iter().any(|axis| axis.input == load.input as usize)
            };
            require(self.loads.iter().all(varies), "a load does not vary in a regime")?;
            let sizes = [regime.mean.len(), regime.by_coefficient.len()];
            require(sizes == [count, count * coefficients], "coordinates are cut")?;
            require(regime.modes.len() <= MAX_LINEAR_MODES, "expected at most 4 linear modes")?;
            for mode in &regime.modes {
                let heights = if regime.kind == RegimeKind::Free { nodes } else { 0 };
                let sizes = [mode.shape.len(), mode.coefficients.len(), mode.heights_mm.len()];
                require(sizes == [count, coefficients, heights], "a linear mode is cut")?;
                let rate = mode.rate_rad_s;
                require(rate > 0.0 && rate.is_finite(), "a frequency is not above 0")?;
            }
        }
        let of_modes = |mode: &StoredMode| {
            let all = [&mode.shape, &mode.coefficients, &mode.heights_mm].into_iter().flatten();
            all.chain([&mode.reaction_n]).all(|v| v.abs() <= LARGEST)
        };
        let of_regime = |regime: &RegimeInertia| {
            let all = regime.mean.iter().chain(&regime.by_coefficient);
            all.into_iter().all(|v| v.abs() <= LARGEST) && regime.modes.iter().all(of_modes)
        };
        let units = self.loads.iter().flat_map(|load| &load.unit);
        let sane = units.into_iter().all(|v| v.abs() <= LARGEST) && self.regimes.iter().all(of_regime);
        require(sane, "it has numbers that no training gives")
    }
}

impl RegimeModel {
    /// Length of the coefficient vector.
    pub fn coefficient_count(&self) -> usize {
        self.groups.iter().map(|g| g.coefficients.end).max().unwrap_or(0)
    }

    /// All interpolants: groups', then the force's.
    pub fn interpolants(&self) -> impl Iterator<Item = &Interpolant> {
        self.groups.iter().map(|g| &g.surrogate).chain(self.force.as_ref().map(|f| &f.surrogate))
    }
}

impl ModelHeader {
    /// Says what contradicts itself, so that a damaged or hand-made header is refused instead of trusted.
    ///
    /// # Errors
    /// A sentence on the first contradiction.
    pub fn check(&self) -> Result<(), String> {
        let require = |sound: bool, what: &str| if sound { Ok(()) } else { Err(what.to_owned()) };
        require(self.node_count > 0 && !self.fields.is_empty(), "no nodes or no fields")?;
        require(!self.regimes.is_empty(), "no regime")?;
        require(
            (2..=MAX_INPUTS).contains(&self.inputs.len()),
            "expected pressure, gap and at most six more inputs",
        )?;
        for field in &self.fields {
            let axes = field.magnitude_of.unwrap_or_default();
            let plain = |axis: &usize| self.fields.get(*axis).is_some_and(|f| f.magnitude_of.is_none());
            require(
                field.magnitude_of.is_none() || axes.iter().all(plain),
                "a magnitude names a missing coordinate",
            )?;
        }
        if let Some(table) = &self.onset {
            let n = table.gap_mm.len();
            require(
                n >= 2 && table.pressure_mpa.len() == n && table.slope.len() == n,
                "onset table: lengths differ",
            )?;
            require(table.gap_mm.windows(2).all(|w| w[0] < w[1]), "onset table: gaps do not increase")?;
        }
        if let Some(clearance) = &self.clearance {
            let free = self.regimes.iter().find(|r| r.kind == RegimeKind::Free);
            require(free.is_some_and(|free| fits(clearance, free)), "the clearance has other modes")?;
            require(self.onset.is_some(), "a clearance without an onset table")?;
        }
        let declared = self.inputs.iter().skip(PARAMETERS).all(|i| i.value.is_some_and(f64::is_finite));
        require(declared, "a parameter has no value")?;
        for set in &self.node_sets {
            let inside = set.nodes.iter().all(|n| (*n as usize) < self.node_count);
            require(inside, "a node set names a node beyond the mesh")?;
        }
        if let Some(learned) = &self.learned {
            learned.check(self.inputs.len(), self.regimes[0].coefficient_count())?;
        }
        self.regimes.iter().try_for_each(|regime| self.check_regime(regime, &require))
    }

    /// The names of its regimes, in order.
    pub fn regime_names(&self) -> Vec<&'static str> {
        self.regimes.iter().map(|regime| regime.kind.name()).collect()
    }

    fn check_regime(&self, regime: &RegimeModel, require: Require) -> Result<(), String> {
        let dimensions = regime.inputs.dimensions();
        regime.inputs.check(self.inputs.len(), require)?;
        require(regime.domain.fits(dimensions), "the training range has other inputs than its regime")?;
        let mut next = 0;
        for group in &regime.groups {
            require(
                group.coefficients.start == next && group.coefficients.end >= next,
                "coefficients do not follow on",
            )?;
            next = group.coefficients.end;
            require(
                group.surrogate.outputs == group.coefficients.len(),
                "a group's interpolant has other outputs",
            )?;
            require(group.fields.iter().all(|f| *f < self.fields.len()), "a group names a missing field")?;
        }
        for field in (0..self.fields.len()).filter(|f| self.fields[*f].magnitude_of.is_none()) {
            require(regime.groups.iter().any(|g| g.fields.contains(&field)), "a field belongs to no group")?;
        }
        require(
            regime.force.as_ref().is_none_or(|f| f.surrogate.outputs == 1),
            "the force needs one output",
        )?;
        if let Some(far) = &regime.far_onset {
            require(
                far.gap_mm.len() >= 2 && far.gap_mm.windows(2).all(|w| w[0] < w[1]),
                "far onset: gaps do not increase",
            )?;
            require(
                far.corrections.len() == far.gap_mm.len() * regime.coefficient_count(),
                "far onset: corrections are cut",
            )?;
        }
        let sound = regime
            .difference
            .as_ref()
            .is_none_or(|difference| difference.is_sound(regime.coefficient_count()));
        require(sound, "the measured difference does not fit its regime")?;
        let local = regime.local_halfwidths.as_ref();
        require(local.is_none_or(|local| local.fits(dimensions)), "the local half-widths are cut")?;
        regime.interpolants().try_for_each(|fit| fit.check(dimensions, require))
    }

    /// Indices of the named fields, or all; unknown names are refused.
    ///
    /// # Errors
    /// [`ModelError::UnknownField`].
    pub fn resolve_fields(&self, names: Option<&[String]>) -> Result<Vec<usize>, ModelError> {
        let Some(names) = names else { return Ok((0..self.fields.len()).collect()) };
        let known = || self.fields.iter().map(|f| f.spec.name.clone()).collect();
        let find = |name: &String| {
            let found = self.fields.iter().position(|f| f.spec.name == *name);
            found.ok_or_else(|| ModelError::UnknownField { found: name.clone(), known: known() })
        };
        names.iter().map(find).collect()
    }

    /// Node indices of a selection, `None` for all; unknown sets and nodes beyond the mesh are refused.
    ///
    /// # Errors
    /// [`ModelError::UnknownNodeSet`], [`ModelError::NodeOutOfRange`].
    pub fn resolve_nodes(&self, nodes: &Nodes) -> Result<Option<Vec<u32>>, ModelError> {
        let list = match nodes {
            Nodes::All => return Ok(None),
            Nodes::List(list) => list.clone(),
            Nodes::Set(name) => match self.node_sets.iter().find(|s| s.name == *name) {
                Some(set) => set.nodes.clone(),
                None => {
                    let known = self.node_sets.iter().map(|s| s.name.clone()).collect();
                    return Err(ModelError::UnknownNodeSet { found: name.clone(), known });
                }
            },
        };
        match list.iter().find(|n| **n as usize >= self.node_count) {
            Some(&node) => Err(ModelError::NodeOutOfRange { node, node_count: self.node_count }),
            None => Ok(Some(list)),
        }
    }
}
