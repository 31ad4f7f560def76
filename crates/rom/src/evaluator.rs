//! The small half of a model: inputs in; regime, contact force and modal coefficients out.
//!
//! When a finger meets a plate, its tip stops and a force begins. No smooth interpolant follows that kink, so a model has two *regimes* with
//! modes and interpolants of their own. The free regime depends on the pressure, the contact regime on pressure and gap; either may depend
//! on parameters as well. The *onset* `P_c(gap)` separates them: the pressure at which the lowest point of the free finger reaches the
//! plate. It is a table over the gap ([`crate::regime`]) or, where it depends on parameters, solved from the free regime for each state
//! ([`crate::clearance`]). The contact force is interpolated as `F = (P - P_c) h(P, gap)` and is therefore exactly zero at the onset.
//!
//! A [`Query`] says how far an [`Evaluation`] is filled: onset and regime, force and half-widths, modal coefficients (of which
//! [`crate::reconstructor`] makes the fields), their derivatives. The evaluation has room for all results and for the scratch values in
//! between, so that an answer allocates nothing: the twin's loop has to answer in a bounded time. Nothing is written into the evaluator, so
//! threads can share it if each brings its own evaluation.

use crate::body::ShapeLimits;
use crate::clearance::OnsetSolver;
use crate::evaluation::{Evaluation, Flags, Refusal};
use crate::halfwidths::HalfWidths;
use crate::hull::{DomainStatus, TrainingRange};
use crate::inputs::{GAP, InputSpec, Inputs, MAX_INPUTS, Needs, PARAMETERS, PRESSURE, Point, rounded};
use crate::interpolant::Interpolant;
use crate::kernel::sums::{Scratch, Sums};
use crate::learned::{LearnedMap, LearnedState, OffsetFilter};
use crate::model::{GroupModel, ModelError, ModelHeader, PressureLimit, RegimeModel};
use crate::regime::{LastOnset, Onset, OnsetAt, OnsetTable};
use crate::snapshots::RegimeKind;
use std::ops::Range;
use std::sync::Arc;

/// Step of the difference quotients of a learned map, as a fraction of an input's range.
const SLOPE_STEP: f64 = 1e-3;

/// One regime, ready to run.
#[derive(Clone, Debug)]
struct RegimePart {
    model: RegimeModel,
    coefficient_count: usize,
    /// Consecutive groups with one kernel, with the range of their coefficients.
    groups: Vec<(Sums, Range<usize>)>,
    /// After [`Evaluator::restrict`]: the others that the body's shape depends on.
    of_shape: Vec<(Sums, Range<usize>)>,
    force: Option<Sums>,
}

impl RegimePart {
    fn new(model: RegimeModel) -> Self {
        let groups = sums(model.groups.iter());
        let force = model.force.as_ref().map(|force| Sums::new(&[&force.surrogate]));
        Self { coefficient_count: model.coefficient_count(), groups, of_shape: Vec::new(), force, model }
    }

    fn all(&self) -> impl Iterator<Item = &Sums> {
        self.groups.iter().map(|group| &group.0).chain(&self.force)
    }
}

/// Consecutive groups with one kernel, summed in one pass, with the range of their coefficients.
fn sums<'a>(groups: impl Iterator<Item = &'a GroupModel>) -> Vec<(Sums, Range<usize>)> {
    let groups: Vec<&GroupModel> = groups.collect();
    let can_be_merged = |a: &&GroupModel, b: &&GroupModel| {
        a.coefficients.end == b.coefficients.start && a.surrogate.shares_kernel_with(&b.surrogate)
    };
    let merged_sums = |groups: &[&GroupModel]| {
        let interpolants: Vec<&Interpolant> = groups.iter().map(|group| &group.surrogate).collect();
        (Sums::new(&interpolants), groups[0].coefficients.start..groups[groups.len() - 1].coefficients.end)
    };
    groups.chunk_by(can_be_merged).map(merged_sums).collect()
}

/// How far an answer goes; each step contains the ones before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Until {
    /// Regime and onset. Force and gradient are then 0 (NaN for a model without forces), also in contact; coefficients are those of the
    /// answer before. Less than 1 us for a model without parameters.
    Regime,
    /// With the force, its gradient and the half-widths: some 10 % of the cost of the coefficients (outside the training range the cost of
    /// those of the positions, because the shape is checked there).
    State,
    /// With the coefficients.
    Coefficients,
    /// With the derivatives of the coefficients, at about twice the cost.
    Gradients,
}

/// What is asked of a state besides its inputs. Begin with a constant and change what differs:
/// `Query { range: false, ..Query::GRADIENTS }`.
#[derive(Debug)]
pub struct Query<'a> {
    /// How far to go.
    pub until: Until,
    /// Whether the distance to the training range is wanted, and with it half-widths and refusals. Without it the state counts as
    /// outside, at a distance of NaN.
    pub range: bool,
    /// A regime that answers whatever the onset says: the free one where nothing is there to touch, that of a body in motion. Without
    /// `near` no onset is searched for, and there is no force that depends on one.
    pub regime: Option<RegimeKind>,
    /// Where the search for the onset begins; it becomes that of this state. For states one near the other: faster, and accurate to some
    /// 1e-4 mm of gap.
    pub near: Option<&'a mut LastOnset>,
}

impl Query<'_> {
    /// Asks for [`Until::Regime`].
    pub const REGIME: Self = Self { until: Until::Regime, range: true, regime: None, near: None };
    /// Asks for [`Until::State`].
    pub const STATE: Self = Self { until: Until::State, ..Self::REGIME };
    /// Asks for [`Until::Coefficients`].
    pub const COEFFICIENTS: Self = Self { until: Until::Coefficients, ..Self::REGIME };
    /// Asks for [`Until::Gradients`].
    pub const GRADIENTS: Self = Self { until: Until::Gradients, ..Self::REGIME };
}

/// The small part of a model, made ready to answer. It has no memory: the same inputs always give the same evaluation.
#[derive(Clone, Debug)]
pub struct Evaluator {
    inputs: Vec<InputSpec>,
    /// Positions of the inputs that the answers depend on.
    is_taken: [bool; MAX_INPUTS],
    parts: Vec<RegimePart>,
    onset: Option<OnsetTable>,
    /// Solver of the onset if it depends on parameters; the table is then that of their default values.
    solver: Option<OnsetSolver>,
    /// Value that an input has where a state gives NaN; NaN for pressure and gap.
    defaults: [f64; MAX_INPUTS],
    hysteresis_mpa: f64,
    /// See [`Flags::no_force`].
    no_force: bool,
    no_stress: bool,
    /// What stopped the search for the largest pressure when the actuator was built.
    limit: Option<PressureLimit>,
    body: Option<Arc<ShapeLimits>>,
    /// Map of a model learned from measurements: the interpolants are not asked.
    learned: Option<Arc<LearnedMap>>,
    /// States at any distance have numbers: for searches, whose steps may lie far outside.
    has_no_end: bool,
    /// Largest number of coefficients of a regime, and memory for any interpolant.
    coefficients: usize,
    scratch: Scratch,
}

impl Evaluator {
    /// Takes what it needs from a model's header.
    ///
    /// # Errors
    /// [`ModelError::Inconsistent`] when the header contradicts itself.
    pub fn new(header: &ModelHeader) -> Result<Self, ModelError> {
        header.check().map_err(ModelError::Inconsistent)?;
        let mut defaults = [f64::NAN; MAX_INPUTS];
        defaults
            .iter_mut()
            .zip(&header.inputs)
            .for_each(|(default, input)| *default = input.value.unwrap_or(f64::NAN));
        let mut is_taken = [false; MAX_INPUTS];
        header.taken_inputs().for_each(|(index, _)| is_taken[index] = true);
        let parts: Vec<RegimePart> = header.regimes.iter().cloned().map(RegimePart::new).collect();
        let free = header.regimes.iter().find(|regime| regime.kind == RegimeKind::Free);
        let solver =
            header.clearance.clone().zip(free).map(|(clearance, free)| OnsetSolver::new(clearance, free));
        let mut scratch = Scratch::of(parts.iter().flat_map(RegimePart::all));
        solver.iter().for_each(|solver| scratch.reserve(&solver.memory()));
        let mut evaluator = Self {
            inputs: header.inputs.clone(),
            is_taken,
            coefficients: parts.iter().map(|part| part.coefficient_count).max().unwrap_or(0),
            scratch,
            parts,
            onset: header.onset.clone(),
            solver,
            defaults,
            hysteresis_mpa: header.hysteresis_mpa,
            no_force: !header.has_forces(),
            no_stress: !header.has_stress(),
            limit: header.limit.clone(),
            body: header.body.clone(),
            learned: header.learned.clone(),
            has_no_end: false,
        };
        let mut scratch = evaluator.evaluation();
        evaluator.tabulate(&mut scratch)?;
        Ok(evaluator)
    }

    /// A copy without a limit on the distance from the training range, for searches. Evaluate a search's result with the ordinary
    /// evaluator before you use it.
    #[must_use]
    pub fn for_search(self) -> Self {
        Self { has_no_end: true, ..self }
    }

    /// Why an evaluated state has no answer, with the inputs that are outside the training range; `None` where it has one.
    pub fn refusal(&self, evaluation: &Evaluation) -> Option<String> {
        let refusal = evaluation.flags.refusal?;
        Some(self.outside(evaluation).map_or(refusal.to_string(), |why| format!("{refusal}. {why}")))
    }

    /// The input of an evaluated state that is farthest outside its trained values, and by how much: below 0 under the smallest. `None` if
    /// none is by itself. Allocates nothing.
    pub fn farthest_outside(&self, evaluation: &Evaluation) -> Option<(usize, f64)> {
        let part = self.parts.iter().find(|part| part.model.kind == evaluation.regime)?;
        let mut farthest: Option<(usize, f64, f64)> = None;
        for (index, by) in evaluation.outside_by.into_iter().enumerate() {
            let Some([low, high]) = part.model.inputs.range(index) else { continue };
            let share = by.abs() / (high - low).max(f64::MIN_POSITIVE);
            if share > farthest.map_or(0.0, |(_, _, share)| share) {
                farthest = Some((index, by, share));
            }
        }
        farthest.map(|(index, by, _)| (index, by))
    }

    /// Which inputs of an evaluated state are outside the training range and by how much, as a sentence; `None` inside.
    pub fn outside(&self, evaluation: &Evaluation) -> Option<String> {
        if evaluation.domain == DomainStatus::Inside {
            return None;
        }
        let part = self.parts.iter().find(|part| part.model.kind == evaluation.regime)?;
        let map = &part.model.inputs;
        let value = |input: usize| rounded(evaluation.inputs.values()[input]);
        let mut found = Vec::new();
        for (input, spec) in self.taken_inputs() {
            let Some([low, high]) = map.range(input).map(|range| range.map(rounded)) else { continue };
            let (key, unit, value) = (spec.key(), &spec.unit, value(input));
            if value.is_nan() {
                found.push(format!("{key} has no value"));
            } else if value > high {
                let limit = self.limit.as_ref().filter(|_| input == PRESSURE);
                let reason =
                    limit.map_or(String::new(), |limit| format!("; build went no further: {}", limit.reason));
                let by = rounded(value - high);
                found.push(format!(
                    "{key} = {value} is {by} {unit} above the largest trained value, {high} {unit}{reason}"
                ));
            } else if value < low {
                let by = rounded(low - value);
                found.push(format!(
                    "{key} = {value} is {by} {unit} below the smallest trained value, {low} {unit}"
                ));
            }
        }
        if found.is_empty() {
            let named = map
                .axes
                .iter()
                .filter_map(|axis| Some((self.inputs.get(axis.input)?.key(), value(axis.input))));
            let named: Vec<String> = named.map(|(key, value)| format!("{key} = {value}")).collect();
            found.push(format!("no trained state is near {}", named.join(", ")));
        }
        let distance = match evaluation.domain_distance {
            distance if distance.is_finite() => {
                format!(" ({:.1} % of the trained range away)", 100.0 * distance)
            }
            _ => String::new(),
        };
        Some(found.join("; ") + &distance)
    }

    /// Sets the default values of the parameters to those of a state; NaN leaves a default unchanged. States with these values then
    /// read their onset from a table, bit-identical to that of [`ModelHeader::set_parameters`]. Cost: one table unless the values are in use.
    ///
    /// # Errors
    /// [`ModelError::Inconsistent`] when the free model moves down at no pressure at these parameters; the defaults are then unchanged.
    pub fn set_parameters(&mut self, inputs: &Inputs, scratch: &mut Evaluation) -> Result<(), ModelError> {
        let inputs = inputs.or(&self.defaults);
        if self.has_default_parameters(&inputs) {
            return Ok(());
        }
        let defaults = *inputs.with(PRESSURE, f64::NAN).with(GAP, f64::NAN).values();
        let before = std::mem::replace(&mut self.defaults, defaults);
        self.tabulate(scratch).inspect_err(|_| self.defaults = before)
    }

    /// True if the parameters of a state have the default values.
    pub fn has_default_parameters(&self, inputs: &Inputs) -> bool {
        inputs.values()[PARAMETERS..self.inputs.len()] == self.defaults[PARAMETERS..self.inputs.len()]
    }

    /// Tabulates the onset at the default values if it depends on parameters.
    fn tabulate(&mut self, scratch: &mut Evaluation) -> Result<(), ModelError> {
        if let Some(solver) = &self.solver {
            scratch.scratch.reserve(&self.scratch);
            let table = solver.table(&Inputs::new(0.0, 0.0).or(&self.defaults), scratch);
            let reason = || "the free model sinks at no pressure at these parameters".to_owned();
            self.onset = Some(table.ok_or_else(|| ModelError::Inconsistent(reason()))?);
        }
        Ok(())
    }

    /// The model's inputs in order: pressure, gap, then any others.
    pub fn inputs(&self) -> &[InputSpec] {
        &self.inputs
    }

    /// The state at one value for each of [`Self::inputs`]; NaN is the model's value of a parameter.
    ///
    /// # Errors
    /// The input that is no number, or that the model does not have, in words.
    pub fn state(&self, values: &[f64]) -> Result<Inputs, String> {
        let needs = self.needs();
        let mut inputs = Inputs::new(f64::NAN, f64::NAN);
        for (position, (value, spec)) in values.iter().zip(self.inputs()).enumerate() {
            let (fits, expected) = match position {
                PRESSURE if !needs.pressure => (value.is_nan(), "NaN (the model does not have it)"),
                GAP if !needs.gap => (value.is_nan(), "NaN (the model does not have it)"),
                PRESSURE => (value.is_finite(), "a number"),
                GAP => (!value.is_nan(), "a number"),
                _ => (!value.is_infinite(), "a number"),
            };
            if !fits {
                return Err(format!("expected {expected} for {}, found {value}", spec.key()));
            }
            inputs = inputs.with(position, *value);
        }
        Ok(inputs)
    }

    /// The inputs that the answers depend on, with their position.
    pub fn taken_inputs(&self) -> impl Iterator<Item = (usize, &InputSpec)> {
        self.inputs.iter().enumerate().filter(|(index, _)| self.is_taken[*index])
    }

    /// As [`ModelHeader::needs`].
    pub fn needs(&self) -> Needs {
        Needs { pressure: self.is_taken[PRESSURE], gap: self.is_taken[GAP] }
    }

    /// As [`ModelHeader::has_forces`].
    pub fn has_forces(&self) -> bool {
        !self.no_force
    }

    /// A state with the defaults of its parameters, and NaN for an input that the model does not have.
    fn taken_with_defaults(&self, inputs: Inputs) -> Inputs {
        let inputs = inputs.or(&self.defaults);
        let ignored = (0..self.inputs.len()).filter(|at| !self.is_taken[*at]);
        ignored.fold(inputs, |inputs, at| inputs.with(at, f64::NAN))
    }

    /// Onset pressure over gap, with parameters at their default values; `None` for a model of one regime.
    pub fn onset(&self) -> Option<&OnsetTable> {
        self.onset.as_ref()
    }

    /// True if the model was trained in a regime.
    pub fn has_regime(&self, kind: RegimeKind) -> bool {
        self.parts.iter().any(|part| part.model.kind == kind)
    }

    /// Evaluation with capacity for any state.
    pub fn evaluation(&self) -> Evaluation {
        let settled = self.learned.as_ref().map(|map| Box::new(map.initial_state()));
        Evaluation { settled, ..Evaluation::with_scratch(self.coefficients, self.scratch.clone()) }
    }

    /// The onset at a state.
    fn onset_at(&self, inputs: &Inputs, scratch: &mut Evaluation) -> OnsetAt {
        let fixed_onset = |onset| OnsetAt { onset, pressure_mpa: 0.0, gradient: [0.0; MAX_INPUTS] };
        match (&self.solver, &self.onset, self.parts.first()) {
            (Some(solver), table, _) => solver.onset(
                inputs,
                table.as_ref().map(|table| (table, self.has_default_parameters(inputs))),
                scratch,
            ),
            (None, Some(table), _) => table.at(inputs.gap_mm()),
            (None, None, Some(part)) if part.model.kind == RegimeKind::Contact => fixed_onset(Onset::Always),
            (None, None, _) => fixed_onset(Onset::Never),
        }
    }

    /// Largest gap that a state's pressure and parameters close, in mm. `None` for a model
    /// of one regime or if the free model has no finite answer. Cost: at most one evaluation of the free model.
    pub fn closed_gap_mm(&self, inputs: Inputs, scratch: &mut Evaluation) -> Option<f64> {
        let inputs = inputs.or(&self.defaults);
        scratch.scratch.reserve(&self.scratch);
        let gap_mm = match (&self.solver, &self.onset) {
            (Some(solver), _) => solver.depth_mm(&inputs, scratch),
            (None, table) => table.as_ref()?.closed_gap_mm(inputs.pressure_mpa()),
        };
        gap_mm.is_finite().then_some(gap_mm)
    }

    /// Answers everything but the derivatives of the coefficients: [`Self::answer`] to [`Query::COEFFICIENTS`].
    ///
    /// Across the onset the value is continuous at every gap up to the reach (fields to truncation and smoothing, force
    /// exactly); slopes are not: the tip stops and the force starts, so gradients are those of the side the state is on.
    pub fn evaluate(&self, inputs: Inputs, out: &mut Evaluation) {
        self.answer(inputs, Query::COEFFICIENTS, out);
    }

    /// Answers a query about a state. A parameter that the state leaves at NaN takes the model's value; an input that the model does not
    /// have is NaN in `out`. Any state is answered without panic: one that is not a number, or lies outside the samples, is flagged as
    /// extrapolated. In a regime that was not trained there are no coefficients. Allocates nothing when [`Self::evaluation`] made `out`.
    pub fn answer(&self, inputs: Inputs, query: Query<'_>, out: &mut Evaluation) {
        let inputs = self.taken_with_defaults(inputs);
        out.scratch.reserve(&self.scratch);
        let onset = match (query.near, query.regime) {
            (Some(last), _) => Some(self.onset_near(inputs, last, out)),
            (None, None) => Some(self.onset_at(&inputs, out)),
            (None, Some(_)) => None,
        };
        let has_onset = onset.is_some();
        let onset = onset.unwrap_or(OnsetAt::NEVER);
        out.inputs = inputs;
        out.regime = query.regime.unwrap_or_else(|| onset.onset.regime(inputs.pressure_mpa()));
        out.onset_pressure_mpa = self.onset.as_ref().and_then(|_| onset.onset.pressure_mpa());
        out.flags = Flags { no_force: self.no_force, no_onset: self.onset.is_none(), ..Flags::default() };
        let without_contact = if self.no_force { f64::NAN } else { 0.0 };
        (out.contact_force_n, out.force_gradient) = (without_contact, [without_contact; MAX_INPUTS]);
        let part = self.parts.iter().find(|part| part.model.kind == out.regime);
        out.halfwidths = HalfWidths::UNKNOWN; // until they are known, also inside
        if query.range {
            self.set_range_distance(
                part,
                query.regime.is_some(),
                self.onset.is_some() && onset.pressure_mpa.is_nan(),
                out,
            );
        } else {
            out.set_distance(f64::NAN);
            out.outside_by = [0.0; MAX_INPUTS];
        }
        if query.until == Until::Regime {
            return;
        }
        if let Some(map) = &self.learned {
            clear(out);
            if query.until == Until::Gradients {
                self.settled_slopes(map, out);
            }
            return self.answer_settled(out);
        }
        if let Some(part) = part {
            let x = part.model.inputs.scale(&inputs);
            let takes_onset = part.model.force.as_ref().is_some_and(|force| force.times_excess_pressure);
            if has_onset || !takes_onset {
                force(part, &onset, &x, out);
            }
            refuse(out);
            self.halfwidths(part, &x, out);
        }
        if query.until > Until::State || self.must_check(out) {
            self.coefficients(out, query.until);
        }
        if query.until == Until::State {
            clear(out);
        }
    }

    /// Answers of a model learned from measurements under inputs that have been there for long, with all its numbers.
    fn answer_settled(&self, out: &mut Evaluation) {
        let Some(map) = self.learned.as_ref().filter(|map| map.takes(&out.inputs)) else {
            out.flags.refusal = Some(Refusal::TooFar);
            return self.fill_refused(out);
        };
        let mut settled = out.settled.take().unwrap_or_else(|| Box::new(map.initial_state()));
        settled.settle(map, &out.inputs);
        self.answer_learned(map, &mut settled, None, out);
        out.settled = Some(settled);
    }

    /// Answer of a learned map; refused where it is farther outside than the training is wide.
    fn answer_learned(
        &self,
        map: &LearnedMap,
        past: &mut LearnedState,
        following: Option<(&OffsetFilter, u64)>,
        out: &mut Evaluation,
    ) {
        let reach = map.answer(past, following, &mut out.coefficients, &mut out.output_half_widths);
        out.set_distance(reach.distance);
        out.halfwidths = HalfWidths { displacement_mm: reach.marker_half_width_mm, ..HalfWidths::UNKNOWN };
        out.flags.refusal = self.too_far(out.domain_distance);
        if out.flags.refusal.is_some() {
            self.fill_refused(out);
        }
    }

    fn fill_refused(&self, out: &mut Evaluation) {
        out.coefficients.clear();
        out.coefficients.resize(self.coefficients, f64::NAN);
        out.output_half_widths.clear();
        out.output_half_widths.resize(self.coefficients, f64::NAN);
        out.halfwidths = HalfWidths::UNKNOWN;
        refuse(out);
    }

    /// Map of a model learned from measurements.
    pub fn learned(&self) -> Option<&Arc<LearnedMap>> {
        self.learned.as_ref()
    }

    /// Answers of a model learned from measurements after a past, whose last reading had these inputs, with the offsets that are followed at a
    /// time, ns.
    pub(crate) fn answer_after(
        &self,
        inputs: Inputs,
        past: &mut LearnedState,
        following: Option<(&OffsetFilter, u64)>,
        out: &mut Evaluation,
    ) {
        self.answer(inputs, Query::REGIME, out);
        clear(out);
        match &self.learned {
            Some(map) if map.takes(&out.inputs) => self.answer_learned(map, past, following, out),
            _ => self.fill_refused(out),
        }
    }

    /// Derivatives of the settled answers by central differences, for searches.
    fn settled_slopes(&self, map: &LearnedMap, out: &mut Evaluation) {
        out.gradients.iter_mut().for_each(|row| row.resize(map.outputs(), 0.0)); // within the capacity reserved
        let centre = out.inputs;
        for map_input in &map.inputs {
            let (input, step) =
                (map_input.input as usize, SLOPE_STEP * map_input.range * map_input.deviation);
            for sign in [1.0, -1.0] {
                out.inputs = centre.with(input, centre.values()[input] + sign * step);
                self.answer_settled(out);
                let (values, rows) = (&out.coefficients, &mut out.gradients);
                rows[input].iter_mut().zip(values).for_each(|(slope, v)| *slope += sign * v / (2.0 * step));
            }
        }
        out.inputs = centre;
    }

    /// Half-widths at a state over scaled inputs; NaN for a quantity that the model does not have, and for all outside the training range.
    fn halfwidths(&self, part: &RegimePart, x: &Point, out: &mut Evaluation) {
        if out.domain != DomainStatus::Inside {
            return;
        }
        let local = part.model.local_halfwidths.as_ref();
        let mut widths = local.map_or(part.model.halfwidths, |local| local.at(x));
        out.difference_mm =
            part.model.difference.as_ref().map_or(0.0, |difference| difference.half_width_mm(x));
        if out.difference_mm > 0.0 {
            widths.displacement_mm = widths.displacement_mm.hypot(out.difference_mm);
        }
        if self.no_force {
            widths.force_n = f64::NAN;
        }
        if self.no_stress {
            widths.stress_mpa = f64::NAN;
        }
        out.halfwidths = widths;
    }

    /// Adds the coefficients to an answer to [`Query::STATE`], for those who decide by the state whether they need fields.
    pub fn complete(&self, out: &mut Evaluation) {
        if out.coefficients.is_empty() {
            self.coefficients(out, Until::Coefficients);
        }
    }

    /// From now on the coefficients of fields other than these (indices into [`ModelHeader::fields`]) are not interpolated and
    /// are undefined, unless they are in a group with one of these. The others stay bit-identical.
    pub fn restrict(&mut self, fields: &[usize]) {
        for part in &mut self.parts {
            let is_used = |group: &&GroupModel| group.fields.iter().any(|field| fields.contains(field));
            let used = sums(part.model.groups.iter().filter(is_used));
            // A single coefficient is summed in another order than several.
            let all = sums(part.model.groups.iter());
            let is_alone = |(sums, range): &(Sums, Range<usize>)| {
                sums.outputs() == 1 && all.iter().all(|(_, joined)| joined != range)
            };
            let is_used = |group: &&GroupModel| {
                used.iter().any(|(_, range)| {
                    range.start <= group.coefficients.start && group.coefficients.end <= range.end
                })
            };
            let is_of_shape = |group: &&GroupModel| {
                let body = self.body.as_ref();
                body.is_some_and(|body| body.depends_on(part.model.kind, &group.coefficients))
            };
            let others = part.model.groups.iter().filter(|group| !is_used(group) && is_of_shape(group));
            (part.groups, part.of_shape) = if used.iter().any(is_alone) {
                (all, Vec::new())
            } else {
                let others = sums(others);
                (used, others)
            };
        }
    }

    /// Inputs with the model's values for parameters that are not set.
    pub(crate) fn with_defaults(&self, inputs: Inputs) -> Inputs {
        inputs.or(&self.defaults)
    }

    /// Contact force of the contact regime and its gradient, negative below the onset; the onset is searched for near the last one.
    pub(crate) fn signed_force(
        &self,
        inputs: Inputs,
        last: &mut LastOnset,
        out: &mut Evaluation,
    ) -> Option<(f64, [f64; MAX_INPUTS])> {
        let inputs = inputs.or(&self.defaults);
        out.scratch.reserve(&self.scratch);
        let onset = self.onset_near(inputs, last, out);
        let part = self.parts.iter().find(|part| part.model.kind == RegimeKind::Contact)?;
        signed_force(part, &onset, &part.model.inputs.scale(&inputs), inputs, out)
    }

    /// Onset at a state, sought near the last one.
    fn onset_near(&self, inputs: Inputs, last: &mut LastOnset, out: &mut Evaluation) -> OnsetAt {
        let near = self.solver.as_ref().and_then(|solver| solver.onset_near(&inputs, last, out));
        let at = near.unwrap_or_else(|| self.onset_at(&inputs, out));
        last.0 = Some((inputs, at));
        at
    }

    /// Coefficients of the regime of `out`; none of a regime that was not trained. Up to [`Until::State`] only those that the body's shape
    /// depends on.
    fn coefficients(&self, out: &mut Evaluation, until: Until) {
        if self.learned.is_some() {
            return self.answer_settled(out);
        }
        match self.parts.iter().find(|part| part.model.kind == out.regime) {
            Some(part) => {
                let of_shape = if self.must_check(out) { &part.of_shape[..] } else { &[] };
                let body = self.body.as_ref().filter(|_| until <= Until::State);
                let is_asked = |(_, range): &&(Sums, Range<usize>)| {
                    body.is_none_or(|body| body.depends_on(part.model.kind, range))
                };
                let groups = part.groups.iter().chain(of_shape).filter(is_asked);
                coefficients(part, groups, out, until == Until::Gradients);
            }
            None => clear(out),
        }
        self.check_shape(out);
    }

    /// Whether the shape of a state is to be checked: outside the training range, where an interpolant gives any number.
    fn must_check(&self, out: &Evaluation) -> bool {
        !self.has_no_end && self.body.is_some() && out.flags.extrapolated && out.flags.refusal.is_none()
    }

    /// Refuses a state outside the training range whose coefficients give a shape that the body cannot have.
    pub(crate) fn check_shape(&self, out: &mut Evaluation) {
        let must_check = self.must_check(out);
        if self.body.as_ref().is_some_and(|body| must_check && !body.is_possible(out)) {
            out.flags.refusal = Some(Refusal::Impossible);
        }
        refuse(out);
    }

    fn too_far(&self, distance: f64) -> Option<Refusal> {
        (!self.has_no_end && distance > TrainingRange::ANSWERED).then_some(Refusal::TooFar)
    }

    /// Distance of the inputs of `out` from the training range of their regime, infinite where one of them or the onset is missing, and
    /// whether there is no answer so far outside.
    fn set_range_distance(
        &self,
        part: Option<&RegimePart>,
        is_given: bool,
        has_no_onset: bool,
        out: &mut Evaluation,
    ) {
        let inputs = out.inputs;
        let mut taken = inputs.values().iter().zip(self.is_taken);
        let is_missing = has_no_onset || taken.any(|(value, taken)| taken && value.is_nan());
        out.set_distance(match part {
            Some(part) if !is_missing => distance(part, &inputs),
            _ => f64::INFINITY,
        });
        out.outside_by = part.filter(|_| out.flags.extrapolated).map_or([0.0; MAX_INPUTS], |part| {
            let outside_by = |input: usize| {
                let range = part.model.inputs.range(input).filter(|_| self.is_taken[input]);
                let value = inputs.values()[input];
                // NaN, a value that is missing, is not outside by any number.
                range.map_or(0.0, |[low, high]| (value - high).max(0.0) + (value - low).min(0.0))
            };
            std::array::from_fn(outside_by)
        });
        out.flags.refusal = self.too_far(out.domain_distance);
        if let Some(part) = part.filter(|_| is_given && out.flags.refusal.is_some()) {
            // A jump of the pressure throws a moving body beyond any load for a moment: what is refused is a place where it is not at rest
            // either.
            let rest: [f64; MAX_INPUTS] = std::array::from_fn(|input| {
                if input < PARAMETERS { inputs.values()[input] } else { self.defaults[input] }
            });
            out.flags.refusal = self.too_far(distance(part, &Inputs::from(rest)));
        }
    }
}

/// The regime to show for a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegimeLabel {
    /// Contact as soon as the onset is reached, free only when it is undercut by the model's margin.
    pub regime: RegimeKind,
    /// The label still says contact although the pressure is just below the onset.
    pub held: bool,
}

/// Remembers the last label, so that noise at the onset does not make it flicker. Only the label depends on the past: the numbers of a
/// state follow its inputs.
#[derive(Clone, Debug)]
pub struct RegimeLabels {
    /// How far the pressure falls below the onset before the label says free, MPa.
    margin_mpa: f64,
    last: Option<RegimeKind>,
}

impl RegimeLabels {
    /// For states of an evaluator. The first label is the regime of the first state.
    pub fn new(evaluator: &Evaluator) -> Self {
        Self { margin_mpa: evaluator.hysteresis_mpa, last: None }
    }

    /// Label of the next evaluated state.
    pub fn next(&mut self, state: &Evaluation) -> RegimeLabel {
        let pressure_mpa = state.inputs.pressure_mpa();
        let held = self.last == Some(RegimeKind::Contact)
            && state.regime == RegimeKind::Free
            && state.onset_pressure_mpa.is_some_and(|onset| pressure_mpa > onset - self.margin_mpa);
        let regime = if held { RegimeKind::Contact } else { state.regime };
        self.last = Some(regime);
        RegimeLabel { regime, held }
    }
}

/// Leaves no coefficients.
fn clear(out: &mut Evaluation) {
    out.coefficients.clear();
    out.difference.clear();
    out.gradients.iter_mut().for_each(Vec::clear);
}

/// Coefficients of these groups; those of others stay as they were.
fn coefficients<'a>(
    part: &RegimePart,
    groups: impl Iterator<Item = &'a (Sums, Range<usize>)>,
    out: &mut Evaluation,
    gradient: bool,
) {
    let map = &part.model.inputs;
    let x = &map.scale(&out.inputs);
    let count = if gradient { part.coefficient_count } else { 0 };
    out.gradients.iter_mut().for_each(|row| row.resize(count, 0.0)); // within the capacity reserved
    out.coefficients.resize(part.coefficient_count, 0.0);
    for (sums, range) in groups {
        let rows = gradient.then(|| out.gradients.each_mut().map(|row| &mut row[range.clone()]));
        sums.evaluate(x, &mut out.scratch, &mut out.coefficients[range.clone()], rows);
    }
    out.difference.clear();
    if let Some(difference) = &part.model.difference {
        out.difference.resize(part.coefficient_count, 0.0); // within the capacity reserved
        difference.add(x, &mut out.difference, &mut out.gradients);
        out.coefficients.iter_mut().zip(&out.difference).for_each(|(coefficient, by)| *coefficient += by);
    }
    // From scaled axes to the model's inputs: positions only grow, so the last axis moves first.
    for (index, row) in out.gradients.iter_mut().enumerate() {
        match map.axes.get(index) {
            Some(axis) => row.iter_mut().for_each(|slope| *slope /= axis.max - axis.min),
            None => row.fill(0.0),
        }
    }
    for (index, axis) in map.axes.iter().enumerate().rev() {
        out.gradients.swap(index, axis.input);
    }
    if let Some(far) = &part.model.far_onset {
        far.correct(out.inputs.gap_mm(), &mut out.coefficients, &mut out.gradients[GAP]);
    }
}

/// Distance of a state with all inputs from the training range of a regime.
fn distance(part: &RegimePart, inputs: &Inputs) -> f64 {
    let map = &part.model.inputs;
    part.model.domain.distance(&map.scale(inputs)).max(map.off_constants(inputs))
}

/// Leaves no numbers in a refused state: whoever uses one without asking has NaN.
fn refuse(out: &mut Evaluation) {
    if out.flags.refusal.is_some() {
        (out.contact_force_n, out.force_gradient) = (f64::NAN, [f64::NAN; MAX_INPUTS]);
        out.coefficients.fill(f64::NAN);
        out.gradients.iter_mut().for_each(|row| row.fill(f64::NAN));
    }
}

/// `F = (P - P_c) h` or `F = h`, lifted to 0 where negative, with its gradient.
fn force(part: &RegimePart, onset: &OnsetAt, x: &Point, out: &mut Evaluation) {
    let Some((force, gradient)) = signed_force(part, onset, x, out.inputs, out) else { return };
    if force < 0.0 {
        out.flags.force_clamped = true;
        return;
    }
    (out.contact_force_n, out.force_gradient) = (force, gradient);
}

/// `F = (P - P_c) h` or `F = h` with its gradient; `None` if the regime has no force.
fn signed_force(
    part: &RegimePart,
    onset: &OnsetAt,
    x: &Point,
    inputs: Inputs,
    out: &mut Evaluation,
) -> Option<(f64, [f64; MAX_INPUTS])> {
    let (model, sums) = part.model.force.as_ref().zip(part.force.as_ref())?;
    let (mut h, mut rows) = ([0.0], [[0.0]; MAX_INPUTS]);
    sums.evaluate(x, &mut out.scratch, &mut h, Some(rows.each_mut().map(|row| row.as_mut_slice())));
    let (h, mut force, mut gradient) = (h[0], h[0], [0.0; MAX_INPUTS]);
    for (axis, row) in part.model.inputs.axes.iter().zip(rows) {
        gradient[axis.input] = row[0] / (axis.max - axis.min);
    }
    if model.times_excess_pressure {
        let excess = inputs.pressure_mpa() - onset.pressure_mpa;
        force = excess * h;
        gradient = gradient.map(|by_input| excess * by_input);
        gradient[PRESSURE] += h;
        gradient.iter_mut().zip(onset.gradient).for_each(|(by_input, slope)| *by_input -= slope * h);
    }
    Some((force, gradient))
}
