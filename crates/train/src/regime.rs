//! Training of one regime: inputs, groups, force, training range, half-widths.

use crate::config::{ModeChoice, RegimeConfig, TrainConfig};
use crate::datasheet::{Candidate, CaseError, ForceViolation};
use crate::error::TrainError;
use crate::force::ForceRegion;
use crate::group::{Columns, DecomposedGroup, Group, GroupFit, Plan, fit_groups};
use crate::pod::Centre;
use crate::select::{States, Task, choose};
use crate::sort::{TrainingCases, varying};
use faer::Mat;
use rom::clearance::OnsetSolver;
use rom::halfwidths::{Errors, HalfWidths, LocalHalfWidths};
use rom::hull::TrainingRange;
use rom::inputs::{GAP, InputMap, InputSpec, Inputs, PRESSURE, Point};
use rom::interpolant::{Interpolant, Slope};
use rom::model::{Clearance, FarOnset, ForceModel, GroupModel, RegimeModel};
use rom::regime::{OnsetAt, OnsetTable};
use rom::snapshots::{Database, FieldKind, RegimeKind, Vibration};

/// Largest half-width of predicted cases, as a fraction of the largest coordinate.
const PREDICTED_FRACTION: f64 = 0.02;

/// Smallest excess pressure used for the force, as a fraction of the largest: below, errors of the onset dominate.
const MIN_EXCESS: f64 = 0.01;

/// Onset of contact while a model is trained.
pub(crate) struct OnsetModel {
    /// Onset over the gap, with parameters at their nominal values.
    pub table: OnsetTable,
    /// Solver of the onset if it depends on parameters.
    pub solver: Option<OnsetSolver>,
    /// Number of sampled states whose lowest node is not above the obstacle.
    pub crossings: usize,
}

impl OnsetModel {
    /// Onset at a state.
    pub fn at(&self, inputs: &Inputs) -> OnsetAt {
        match &self.solver {
            Some(solver) => solver.onset(inputs, None, &mut solver.scratch()),
            None => self.table.at(inputs.gap_mm()),
        }
    }

    /// Depth of the lowest node at pressure and parameters, mm; `None` without parameters.
    pub fn depth_mm(&self, inputs: &Inputs) -> Option<f64> {
        let solver = self.solver.as_ref()?;
        Some(solver.depth_mm(inputs, &mut solver.scratch()))
    }

    /// Remark of the data sheet on states whose lowest node is not above the obstacle.
    pub fn remarks(&self) -> Option<String> {
        (self.crossings > 0).then(|| {
            format!(
                "in {} sampled states the lowest node is not above the obstacle; the onset uses the nodes that were lowest \
                 above it in some state",
                self.crossings
            )
        })
    }

    /// Clearance, as the model stores it.
    pub fn into_clearance(self) -> Option<Clearance> {
        self.solver.map(OnsetSolver::into_clearance)
    }
}

/// Largest coordinate of a vibration in the decomposition, mm: that of a swing after a jump of pressure.
const VIBRATION_MM: f64 = 5.0;

/// A trained regime, before assembly.
pub(crate) struct TrainedRegime {
    pub kind: RegimeKind,
    pub inputs: InputMap,
    pub groups: Vec<GroupFit>,
    pub force: Option<ForceFit>,
    pub domain: TrainingRange,
    pub halfwidths: HalfWidths,
    pub local_halfwidths: Option<LocalHalfWidths>,
    pub cases: usize,
    pub boundary_states: usize,
    pub far_onset: Option<FarOnset>,
    pub errors: Vec<CaseError>,
    /// Scaled inputs of the training states.
    pub scaled: Vec<Point>,
    /// Positions of parameters that neither the groups nor the force need.
    pub idle: Vec<usize>,
}

impl TrainedRegime {
    /// Regime as the model stores it.
    pub fn model(&self, plan: &Plan) -> RegimeModel {
        let mut next = 0;
        let groups = plan.groups.iter().zip(&self.groups).map(|(group, fit)| {
            let coefficients = next..next + fit.choice.modes;
            next = coefficients.end;
            GroupModel {
                name: group.name.clone(),
                fields: group.fields.clone(),
                coefficients,
                surrogate: fit.choice.fit.interpolant.clone(),
                singular_values: fit.pod.singular_values.clone(),
            }
        });
        RegimeModel {
            kind: self.kind,
            inputs: self.inputs.clone(),
            groups: groups.collect(),
            force: self.force.as_ref().map(|force| force.model.clone()),
            domain: self.domain.clone(),
            halfwidths: self.halfwidths,
            local_halfwidths: self.local_halfwidths.clone(),
            far_onset: self.far_onset.clone(),
            difference: None,
        }
    }

    /// A field at a state, node by node.
    pub fn field(&self, plan: &Plan, field: usize, inputs: &Inputs) -> Vec<f64> {
        let Some((g, at)) = plan.find(field) else { return Vec::new() };
        let stacked = self.groups[g].evaluate(&self.inputs.scale(inputs));
        let nodes = stacked.len() / plan.groups[g].fields.len();
        stacked[at * nodes..(at + 1) * nodes].to_vec()
    }
}

/// States on which a regime is trained: cases first, then onset states.
struct Training<'a> {
    database: &'a Database,
    kind: RegimeKind,
    cases: &'a [usize],
    /// Inputs of cases and onset states.
    points: Vec<Inputs>,
    inputs: InputMap,
    scaled: Vec<Point>,
    /// 1 for cases inside the hull of the cases, 0 for the others.
    score: Vec<f64>,
    domain: TrainingRange,
    /// Known derivatives of the states, and their rows in the database's sensitivities.
    slopes: Vec<Slope>,
    slope_rows: Vec<usize>,
}

pub(crate) fn free(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    sorted: &TrainingCases,
) -> Result<TrainedRegime, TrainError> {
    let cases = &sorted.free;
    let points = cases.iter().map(|&i| database.cases[i].inputs_at_gap(0.0)).collect();
    let training = Training::new(database, sorted, RegimeKind::Free, points, f64::INFINITY);
    let groups = training.groups(config, &config.free, plan, None, &sorted.contact)?;
    let errors = training.errors(plan, &groups, None);
    Ok(training.part(groups, None, errors, config.coverage))
}

pub(crate) fn contact(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    sorted: &TrainingCases,
    boundary: Option<(&TrainedRegime, &OnsetModel)>,
) -> Result<TrainedRegime, TrainError> {
    let cases = &sorted.contact;
    let mut points: Vec<Inputs> = cases.iter().map(|&i| database.cases[i].inputs()).collect();
    let largest_gap = points.iter().map(Inputs::gap_mm).fold(f64::NEG_INFINITY, f64::max);
    let mut far = Vec::new();
    match boundary {
        Some((_, onset)) if onset.solver.is_some() => {
            // Neighbours in the list differ in their parameters: fewer along the onset for each input.
            let count = config.boundary_states * 3 / 4 * (1 + database.parameters.len());
            points.extend(onset_with_parameters(&points, onset, count.min(cases.len())));
        }
        Some((_, onset)) => {
            points.extend(boundary_points(&points, onset, config));
            far = far_points(&points[cases.len()..], &onset.table);
        }
        None => {}
    }
    let training = Training::new(database, sorted, RegimeKind::Contact, points, largest_gap);
    let groups = training.groups(config, &config.contact, plan, boundary.map(|b| b.0), &[])?;
    let far_onset =
        boundary.filter(|_| config.centred).and_then(|(free, _)| training.far_onset(free, &groups, &far));
    let onset = boundary.filter(|_| config.split_at_onset).map(|b| b.1);
    let force = training.force(&config.contact, onset)?;
    let errors = training.errors(plan, &groups, Some(&force));
    Ok(TrainedRegime { far_onset, ..training.part(groups, Some(force), errors, config.coverage) })
}

/// States on the onset, see [`spread`]; only one if all cases have the same gap.
fn boundary_points(cases: &[Inputs], onset: &OnsetModel, config: &TrainConfig) -> Vec<Inputs> {
    let (count, table) = (config.boundary_states, &onset.table);
    let gap = cases[0].gap_mm();
    let gaps = || cases.iter().map(Inputs::gap_mm);
    if gaps().all(|g| g == gap) {
        let onset = table.onset(gap).pressure_mpa().filter(|p| count > 0 && *p > 0.0);
        return onset.map(|p| Inputs::new(p, gap)).into_iter().collect();
    }
    let (low, high) = gaps().fold((f64::INFINITY, 0.0_f64), |(l, h), g| (l.min(g), h.max(g)));
    let limit = high + config.boundary_overshoot * (high - low);
    let last = table.gap_mm.partition_point(|g| *g <= limit).saturating_sub(1);
    let state = |i: usize| cases[0].with(PRESSURE, table.pressure_mpa[i]).with(GAP, table.gap_mm[i]);
    spread(last, count).into_iter().map(state).collect()
}

/// At most `count` numbers from 0 to `last`, closer at the low end, where the relative change of stress with pressure is largest.
fn spread(last: usize, count: usize) -> Vec<usize> {
    let part = |i: usize| i as f64 / count.saturating_sub(1).max(1) as f64;
    let mut picked: Vec<usize> =
        (0..count).map(|i| (last as f64 * part(i) * part(i).sqrt()).round() as usize).collect();
    picked.dedup();
    picked
}

/// `count` states on the onset at the parameters of successive cases. Pressures are closer at the low end, as in [`spread`]; gaps are
/// those that the free model closes.
fn onset_with_parameters(cases: &[Inputs], onset: &OnsetModel, count: usize) -> Vec<Inputs> {
    let largest_mpa = onset.table.pressure_mpa.last().copied().unwrap_or(0.0);
    let state = |i: usize| {
        // Golden-ratio steps: no two neighbours in the list of cases get neighbouring pressures.
        let part = (i as f64 * 0.618_033_988_749_895).fract();
        let inputs = cases[i * cases.len() / count.max(1) % cases.len()]
            .with(PRESSURE, largest_mpa * part * part.sqrt());
        Some(inputs.with(GAP, onset.depth_mm(&inputs)?))
    };
    (0..count).filter_map(state).collect()
}

/// Derivatives of the cases with respect to the inputs of a regime, ordered by case and input, with their rows in the database.
fn slopes(
    database: &Database,
    cases: &[usize],
    inputs: &InputMap,
    doubtful: &[usize],
) -> Vec<(Slope, usize)> {
    let rows = database.sensitivities.iter().flat_map(|known| known.rows.iter().enumerate());
    let mut slopes: Vec<(Slope, usize)> = rows
        .filter(|(_, row)| !doubtful.contains(&row.case))
        .filter_map(|(index, row)| {
            let centre = cases.iter().position(|case| *case == row.case)? as u32;
            let axis = inputs.axes.iter().position(|axis| axis.input == row.input)? as u32;
            Some((Slope { centre, axis }, index))
        })
        .collect();
    slopes.sort_by_key(|(slope, _)| (slope.centre, slope.axis));
    slopes
}

fn entry(table: &OnsetTable, i: usize) -> Inputs {
    Inputs::new(table.pressure_mpa[i], table.gap_mm[i])
}

/// The last onset state among `boundary` and all entries of the table beyond it; empty if there is no entry beyond.
fn far_points(boundary: &[Inputs], table: &OnsetTable) -> Vec<Inputs> {
    let Some(last) = boundary.iter().copied().max_by(|a, b| a.gap_mm().total_cmp(&b.gap_mm())) else {
        return Vec::new();
    };
    let entries = (0..table.gap_mm.len()).map(|i| entry(table, i));
    let beyond: Vec<Inputs> = entries.filter(|e| e.gap_mm() > last.gap_mm()).collect();
    if beyond.is_empty() { beyond } else { std::iter::once(last).chain(beyond).collect() }
}

/// How far the pressure of each case is above the onset of contact, MPa; 1 for a model without an onset.
struct ExcessPressures {
    mpa: Vec<f64>,
    onsets: Option<Vec<OnsetAt>>,
}

impl ExcessPressures {
    /// Derivative of a case's excess pressure with respect to an input; 0 for a model without an onset.
    fn by_input(&self, case: usize, input: usize) -> f64 {
        let Some(onsets) = &self.onsets else { return 0.0 };
        let by_pressure = if input == PRESSURE { 1.0 } else { 0.0 };
        by_pressure - onsets[case].gradient[input]
    }
}

/// Fitted contact force.
pub(crate) struct ForceFit {
    pub model: ForceModel,
    pub candidates: Vec<Candidate>,
    /// Root mean square of the leave-one-out residuals, N.
    pub error_n: f64,
    /// Leave-one-out residual of each case, N.
    residuals_n: Vec<f64>,
    /// Axes of parameters that the force does not need.
    idle: Vec<usize>,
    /// Where the force has the wrong sign or falls with pressure, although no other candidate is nearly as good.
    pub violation: Option<ForceViolation>,
}

impl<'a> Training<'a> {
    fn new(
        database: &'a Database,
        sorted: &'a TrainingCases,
        kind: RegimeKind,
        points: Vec<Inputs>,
        largest_gap: f64,
    ) -> Self {
        let cases = sorted.of(kind);
        let inputs = InputMap::of_states(&points, &varying(database, kind));
        let scaled: Vec<Point> = points.iter().map(|p| inputs.scale(p)).collect();
        // Training range: the simulated cases and the onset up to the largest simulated gap.
        let trusted: Vec<Point> = scaled
            .iter()
            .zip(&points)
            .enumerate()
            .filter(|(i, (_, p))| *i < cases.len() || p.gap_mm() <= largest_gap)
            .map(|(_, (x, _))| *x)
            .collect();
        let (operating, dimensions) = (inputs.operating(), inputs.dimensions());
        let domain = TrainingRange::of_points(operating, dimensions, &trusted);
        let edge = TrainingRange::of_points(operating, dimensions, &scaled[..cases.len()]);
        let mut score: Vec<f64> = (0..points.len())
            .map(|i| f64::from(u8::from(i < cases.len() && !edge.has_vertex(&scaled[i]))))
            .collect();
        if score.iter().sum::<f64>() < 3.0 {
            score[..cases.len()].fill(1.0); // too few inside to judge by: judge by all
        }
        let known = slopes(database, cases, &inputs, &sorted.doubtful);
        let (slopes, slope_rows) = known.into_iter().unzip();
        Self { database, kind, cases, points, inputs, scaled, score, domain, slopes, slope_rows }
    }

    fn groups(
        &self,
        config: &TrainConfig,
        choices: &RegimeConfig,
        plan: &Plan,
        free: Option<&TrainedRegime>,
        others: &[usize],
    ) -> Result<Vec<GroupFit>, TrainError> {
        let rest = self.rest().filter(|_| config.centred);
        let states = States { exact: rest, ..self.states(&self.scaled, &self.score) };
        let centre = match (config.centred, rest) {
            (false, _) => Centre::Origin,
            (true, Some(state)) => Centre::State(state),
            (true, None) => Centre::Mean,
        };
        let decompose_group = |(g, group): (usize, &Group)| {
            let nodes = self.database.node_count;
            let columns = self.columns(group);
            let mut y = Mat::zeros(nodes * group.fields.len(), columns.count());
            for (j, &case) in self.cases.iter().enumerate() {
                for (index, &field) in group.fields.iter().enumerate() {
                    let column = &mut y.col_as_slice_mut(j)[index * nodes..(index + 1) * nodes];
                    column
                        .iter_mut()
                        .zip(self.database.field(case, field))
                        .for_each(|(y, v)| *y = f64::from(v));
                }
            }
            for (j, point) in self.points.iter().enumerate().skip(self.cases.len()) {
                if let Some(free) = free {
                    let state = free.groups[g].evaluate(&free.inputs.scale(point));
                    y.col_as_slice_mut(j).copy_from_slice(&state);
                }
            }
            for (j, vibration) in self.vibrations().enumerate().take(columns.vibrations) {
                let column = columns.states + j;
                self.vibration(vibration, group, y.col_as_slice_mut(column));
            }
            for j in 0..columns.derivatives {
                let column = columns.count() - columns.derivatives + j;
                self.derivative(j, group, columns.weight, y.col_as_slice_mut(column));
            }
            let basis_of = free.filter(|_| config.centred).map(|free| &free.groups[g]);
            DecomposedGroup::new(group, y, columns, self.name(), choices, centre, basis_of)
        };
        let decomposed =
            plan.groups.iter().enumerate().map(decompose_group).collect::<Result<Vec<_>, _>>()?;
        let largest = |g: usize, fit: &GroupFit| self.amplitudes(&plan.groups[g], fit, others);
        fit_groups(plan, decomposed, states, self.name(), choices, config.precision, &largest)
    }

    /// Largest amplitude of each mode of a group at any node: over the columns of its decomposition, and over the cases of another
    /// regime that shares the basis.
    fn amplitudes(&self, group: &Group, fit: &GroupFit, others: &[usize]) -> Vec<f64> {
        let nodes = self.database.node_count;
        let value = |row: usize, j: usize| {
            let (case, field) = (others[j], group.fields[row / nodes]);
            f64::from(self.database.snapshot(case)[row % nodes * self.database.fields.len() + field])
                - fit.compact.mean[row]
        };
        let others = fit.basis.transpose() * Mat::from_fn(fit.basis.nrows(), others.len(), value);
        let own = fit.pod.u.get(.., ..fit.choice.modes).transpose() * &fit.compact.r;
        let largest = |mode: usize| {
            let coefficients = own.row(mode).norm_max().max(others.row(mode).norm_max());
            coefficients * fit.basis.col(mode).norm_max()
        };
        (0..fit.choice.modes).map(largest).collect()
    }

    /// The state at rest: free, with every input that varies at 0. It is the one state that everybody can check on the table, so
    /// the model gives it exactly: the fields are deviations from it, and smoothing leaves it where it is.
    fn rest(&self) -> Option<usize> {
        let is_zero =
            |inputs: &Inputs| self.inputs.axes.iter().all(|axis| inputs.values()[axis.input] == 0.0);
        (self.kind == RegimeKind::Free).then(|| self.points.iter().position(is_zero)).flatten()
    }

    /// The regime's name.
    fn name(&self) -> &'static str {
        self.kind.name()
    }

    /// Columns of a group's decomposition; with derivatives if all its fields have them.
    fn columns(&self, group: &Group) -> Columns {
        let known = self.database.sensitivities.as_ref().map_or(&[][..], |s| &s.fields);
        let all = group.fields.iter().all(|field| known.contains(field));
        // Root mean square distance, along an input, within half the spacing of the states.
        let spacing = (self.cases.len() as f64).powf(-1.0 / self.inputs.dimensions() as f64);
        Columns {
            states: self.points.len(),
            vibrations: if group.coordinates { self.vibrations().count() } else { 0 },
            derivatives: if all { self.slopes.len() } else { 0 },
            weight: spacing / 12.0_f64.sqrt(),
        }
    }

    /// Vibrations of the regime.
    fn vibrations(&self) -> impl Iterator<Item = &Vibration> {
        self.database.vibrations.iter().filter(|vibration| vibration.regime == self.kind)
    }

    /// Vibration along a group's coordinates, of an amplitude of [`VIBRATION_MM`].
    fn vibration(&self, vibration: &Vibration, group: &Group, column: &mut [f64]) {
        let nodes = self.database.node_count;
        let largest = vibration.shape_mm.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        for (field, column) in group.fields.iter().zip(column.chunks_exact_mut(nodes)) {
            let FieldKind::Coordinate(axis) = self.database.fields[*field].kind else { continue };
            let shape = vibration.shape_mm.chunks_exact(nodes).nth(usize::from(axis)).unwrap_or_default();
            column.iter_mut().zip(shape).for_each(|(y, v)| *y = VIBRATION_MM / largest * v);
        }
    }

    /// Derivative of a group's fields with respect to a scaled input, times `weight`.
    fn derivative(&self, j: usize, group: &Group, weight: f64, column: &mut [f64]) {
        let Some(known) = &self.database.sensitivities else { return };
        let (nodes, count) = (self.database.node_count, known.fields.len());
        let axis = &self.inputs.axes[self.slopes[j].axis as usize];
        let row = &known.values[self.slope_rows[j] * nodes * count..][..nodes * count];
        let factor = weight * (axis.max - axis.min);
        for (field, column) in group.fields.iter().zip(column.chunks_exact_mut(nodes)) {
            let place = known.fields.iter().position(|f| f == field).unwrap_or(0);
            let values = row.iter().skip(place).step_by(count);
            column.iter_mut().zip(values).for_each(|(y, v)| *y = factor * f64::from(*v));
        }
    }

    /// Correction that makes contact fields equal the free ones at the onset entries `far`; the first entry is a training state.
    fn far_onset(&self, free: &TrainedRegime, groups: &[GroupFit], far: &[Inputs]) -> Option<FarOnset> {
        if far.len() < 2 || self.inputs.dimensions() < 2 {
            return None;
        }
        let correction = |(index, point): (usize, &Inputs)| {
            let of_group = |(fit, free_fit): (&GroupFit, &GroupFit)| {
                let surrogate = fit.choice.fit.interpolant.values_at(&self.inputs.scale(point));
                // The basis begins with the free regime's modes; all others are 0 in its states.
                let wanted = free_fit.choice.fit.interpolant.values_at(&free.inputs.scale(point));
                let wanted = wanted.into_iter().chain(std::iter::repeat(0.0));
                let difference = wanted.zip(&surrogate).map(|(w, s)| if index == 0 { 0.0 } else { w - s });
                difference.collect::<Vec<_>>()
            };
            groups.iter().zip(&free.groups).flat_map(of_group).collect::<Vec<_>>()
        };
        Some(FarOnset {
            gap_mm: far.iter().map(Inputs::gap_mm).collect(),
            corrections: far.iter().enumerate().flat_map(correction).collect(),
        })
    }

    fn states<'b>(&'b self, inputs: &'b [Point], score: &'b [f64]) -> States<'b> {
        let (operating, dimensions) = (self.inputs.operating(), self.inputs.dimensions());
        States { operating, dimensions, inputs, score, slopes: &self.slopes, exact: None }
    }

    /// Fits `h = F / (p - P_c)`, the contact force over the pressure above the onset, or the force itself of a model without an onset.
    fn force(&self, config: &RegimeConfig, onset: Option<&OnsetModel>) -> Result<ForceFit, TrainError> {
        let forces: Vec<f64> = self.cases.iter().map(|&i| self.database.cases[i].contact_force_n).collect();
        let excess = self.excess_pressures(onset);
        let least = MIN_EXCESS * excess.mpa.iter().copied().fold(0.0, f64::max);
        let used: Vec<usize> = (0..forces.len()).filter(|&i| excess.mpa[i] > least).collect();
        let inputs: Vec<Point> = used.iter().map(|&i| self.scaled[i]).collect();
        let values: Vec<f64> = used.iter().map(|&i| forces[i] / excess.mpa[i]).collect();
        let score: Vec<f64> = used.iter().map(|&i| self.score[i] * excess.mpa[i]).collect();
        let (slopes, slope_values) = self.force_slopes(&excess, &used, &values);
        let task = Task {
            dropped: vec![0.0; values.len()],
            values,
            outputs: 1,
            slope_values,
            modes: ModeChoice::Fixed(1),
            modes_for_energy: 1,
            leading: 0,
        };
        let states = States { slopes: &slopes, ..self.states(&inputs, &score) };
        let with_forces: Vec<(Inputs, f64)> =
            self.points.iter().copied().zip(forces.iter().copied()).collect();
        let at = onset.map(|onset| |inputs: &Inputs| onset.at(inputs));
        let region =
            ForceRegion::new((&self.inputs, &self.domain), &with_forces, at.as_ref().map(|at| at as _));
        let specs = InputSpec::without_range(&self.database.parameters);
        let violation = |fitted: &Interpolant| region.violation(fitted, &specs);
        let chosen = choose(states, &[task], config, &|fitted| violation(fitted).is_none());
        let error = |source| TrainError::Fit {
            what: "the contact force".into(),
            regime: self.name().to_owned(),
            source,
        };
        let choice = chosen.map_err(error)?.swap_remove(0); // one task, one choice
        let mut residuals_n = vec![0.0; forces.len()];
        used.iter().zip(&choice.fit.residuals).for_each(|(&i, e)| residuals_n[i] = e * excess.mpa[i]);
        let squares: f64 = residuals_n.iter().zip(&self.score).map(|(e, s)| e * e * s).sum();
        let error_n = (squares / self.score.iter().sum::<f64>()).sqrt();
        let violation = violation(&choice.fit.interpolant);
        let model = ForceModel { surrogate: choice.fit.interpolant, times_excess_pressure: onset.is_some() };
        Ok(ForceFit {
            model,
            candidates: choice.candidates,
            error_n,
            residuals_n,
            idle: choice.idle,
            violation,
        })
    }

    /// Pressures of the cases above the onset.
    fn excess_pressures(&self, onset: Option<&OnsetModel>) -> ExcessPressures {
        let points = &self.points[..self.cases.len()];
        let onsets: Option<Vec<OnsetAt>> = onset.map(|onset| points.iter().map(|p| onset.at(p)).collect());
        let mpa = match &onsets {
            Some(onsets) => {
                points.iter().zip(onsets).map(|(p, onset)| p.pressure_mpa() - onset.pressure_mpa).collect()
            }
            None => vec![1.0; points.len()],
        };
        ExcessPressures { onsets, mpa }
    }

    /// Known derivatives of `h` (see [`Self::force`]) by the scaled inputs, at the used cases, where it has these values.
    fn force_slopes(
        &self,
        excess: &ExcessPressures,
        used: &[usize],
        values: &[f64],
    ) -> (Vec<Slope>, Vec<f64>) {
        let (mut slopes, mut slope_values) = (Vec::new(), Vec::new());
        for (slope, row) in self.slopes.iter().zip(&self.slope_rows) {
            let case = slope.centre as usize;
            let Some(centre) = used.iter().position(|&i| i == case) else { continue };
            let axis = &self.inputs.axes[slope.axis as usize];
            let excess_by = excess.by_input(case, axis.input);
            let force_by =
                self.database.sensitivities.as_ref().map_or(0.0, |s| s.rows[*row].contact_force_n_per_unit);
            let h_by = (force_by - values[centre] * excess_by) / excess.mpa[case];
            slopes.push(Slope { centre: centre as u32, ..*slope });
            slope_values.push(h_by * (axis.max - axis.min));
        }
        (slopes, slope_values)
    }

    /// Leave-one-out errors at each case's worst node.
    fn errors(&self, plan: &Plan, groups: &[GroupFit], force: Option<&ForceFit>) -> Vec<CaseError> {
        let (cases, nodes) = (self.cases.len(), self.database.node_count);
        let mut displacement = Mat::<f64>::zeros(nodes, cases);
        // Errors of a magnitude that is interpolated separately, and of stress.
        let (mut magnitude, mut stress) = (vec![0.0_f64; cases], vec![0.0_f64; cases]);
        for (group, fit) in plan.groups.iter().zip(groups) {
            let errors = fit.error_fields(cases);
            for (index, &field) in group.fields.iter().enumerate() {
                let part = errors.get(index * nodes..(index + 1) * nodes, ..);
                let raise = |largest: &mut Vec<f64>| {
                    largest.iter_mut().enumerate().for_each(|(i, l)| *l = l.max(part.col(i).norm_max()));
                };
                match self.database.fields[field].kind {
                    FieldKind::Coordinate(_) => {
                        for i in 0..cases {
                            displacement
                                .col_mut(i)
                                .iter_mut()
                                .zip(part.col(i).iter())
                                .for_each(|(d, e)| *d += e * e);
                        }
                    }
                    FieldKind::Stress => raise(&mut stress),
                    FieldKind::Magnitude => raise(&mut magnitude),
                    FieldKind::Other => {}
                }
            }
        }
        let case = |i: usize| CaseError {
            case: self.database.cases[self.cases[i]].name.clone(),
            on_hull: self.score[i] == 0.0,
            displacement_mm: displacement.col(i).norm_max().sqrt().max(magnitude[i]),
            stress_mpa: stress[i],
            force_n: force.map_or(0.0, |force| force.residuals_n[i].abs()),
        };
        (0..cases).map(case).collect()
    }

    /// True if left-out cases are predicted: the errors of their coordinates are small compared with the largest coordinate.
    /// Otherwise errors of neighbouring cases are unrelated, and the half-widths are constant.
    fn predicts(&self, halfwidths: &HalfWidths) -> bool {
        let database = self.database;
        let coordinates = (0..database.fields.len())
            .filter(|f| matches!(database.fields[*f].kind, FieldKind::Coordinate(_)));
        let values = coordinates.flat_map(|f| self.cases.iter().flat_map(move |c| database.field(*c, f)));
        let largest_mm = values.fold(0.0, |most: f64, value| most.max(f64::from(value).abs()));
        halfwidths.displacement_mm <= PREDICTED_FRACTION * largest_mm
    }

    fn part(
        self,
        groups: Vec<GroupFit>,
        force: Option<ForceFit>,
        errors: Vec<CaseError>,
        coverage: f64,
    ) -> TrainedRegime {
        let all: Vec<Errors> =
            errors.iter().map(|e| [e.displacement_mm, e.stress_mpa, e.force_n].into()).collect();
        let (dimensions, cases) = (self.inputs.dimensions(), &self.scaled[..self.cases.len()]);
        let halfwidths = HalfWidths::of_all(&all, coverage);
        let choices =
            groups.iter().map(|group| &group.choice.idle).chain(force.iter().map(|force| &force.idle));
        let needed = |axis: &usize| choices.clone().any(|idle| !idle.contains(axis));
        let axes = (self.inputs.operating()..dimensions).filter(|axis| !needed(axis));
        let idle = axes.map(|axis| self.inputs.axes[axis].input).collect();
        TrainedRegime {
            kind: self.kind,
            groups,
            force,
            errors,
            halfwidths,
            local_halfwidths: self
                .predicts(&halfwidths)
                .then(|| LocalHalfWidths::calibrate(dimensions, cases, &all, coverage)),
            cases: self.cases.len(),
            far_onset: None,
            boundary_states: self.points.len() - self.cases.len(),
            inputs: self.inputs,
            domain: self.domain,
            scaled: self.scaled,
            idle,
        }
    }
}
