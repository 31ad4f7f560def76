//! Training one regime: inputs, groups, force, domain, coverage bars.

use super::TrainError;
use super::group::{Decomposed, GroupFit, Plan, fit_groups};
use crate::config::{ModeChoice, RegimeConfig, TrainConfig};
use crate::conformal;
use crate::datasheet::CaseError;
use crate::hull::Domain;
use crate::interpolant::{InputAxis, InputMap, Quantity};
use crate::model::{FarOnset, ForceModel, HalfWidths};
use crate::regime::OnsetTable;
use crate::select::{Candidate, States, Task, choose};
use crate::snapshots::{Database, FieldKind, RegimeKind};
use faer::Mat;

/// Excess pressures below this share of the largest say more about the onset table than about the force.
const MIN_EXCESS: f64 = 0.01;

/// A trained regime, before assembly.
pub(super) struct Part {
    pub kind: RegimeKind,
    pub inputs: InputMap,
    pub groups: Vec<GroupFit>,
    pub force: Option<(ForceModel, Vec<Candidate>, f64)>,
    pub domain: Domain,
    pub bars: HalfWidths,
    pub cases: usize,
    pub boundary_states: usize,
    pub far_onset: Option<FarOnset>,
    pub errors: Vec<CaseError>,
}

impl Part {
    /// A field of the free model at a pressure, node by node.
    pub fn field(&self, plan: &Plan, field: usize, pressure_mpa: f64) -> Vec<f64> {
        let Some((g, at)) = plan.find(field) else { return Vec::new() };
        let stacked = self.groups[g].evaluate(self.inputs.scale(pressure_mpa, 0.0));
        let nodes = stacked.len() / plan.groups[g].fields.len();
        stacked[at * nodes..(at + 1) * nodes].to_vec()
    }
}

/// The states a regime is trained on: cases first, then boundary states.
struct Training<'a> {
    database: &'a Database,
    cases: &'a [usize],
    /// `(pressure, gap)` of cases and boundary states.
    points: Vec<(f64, f64)>,
    inputs: InputMap,
    scaled: Vec<[f64; 2]>,
    /// 1 for cases inside the hull of the cases, 0 for the others.
    score: Vec<f64>,
    domain: Domain,
    /// `(pressure, gap)` on the onset beyond the states above: the modes know them, the kernels do not.
    far: Vec<(f64, f64)>,
}

pub(super) fn free(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    cases: &[usize],
) -> Result<Part, TrainError> {
    let points = cases.iter().map(|&i| (database.cases[i].pressure_mpa, 0.0)).collect();
    let training = Training::new(database, cases, points, &[Quantity::PressureMpa], f64::INFINITY);
    let groups = training.groups(RegimeKind::Free, config, &config.free, plan, None)?;
    let (errors, bars) = training.errors(plan, &groups, None, config.coverage);
    Ok(training.part(RegimeKind::Free, groups, None, errors, bars))
}

pub(super) fn contact(
    database: &Database,
    config: &TrainConfig,
    plan: &Plan,
    cases: &[usize],
    boundary: Option<(&Part, &OnsetTable)>,
) -> Result<Part, TrainError> {
    let case = |i: usize| (database.cases[i].pressure_mpa, database.cases[i].gap_mm.unwrap_or(0.0));
    let mut points: Vec<(f64, f64)> = cases.iter().map(|&i| case(i)).collect();
    let largest_gap = points.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
    if let Some((_, table)) = boundary {
        points.extend(boundary_points(&points, table, config));
    }
    let far = boundary.map_or(Vec::new(), |(_, table)| far_points(&points[cases.len()..], table));
    let mut training =
        Training::new(database, cases, points, &[Quantity::PressureMpa, Quantity::GapMm], largest_gap);
    training.far = far.iter().copied().skip(1).step_by(FAR_STRIDE).collect();
    let groups =
        training.groups(RegimeKind::Contact, config, &config.contact, plan, boundary.map(|b| b.0))?;
    let far_onset = boundary.and_then(|(free, _)| training.far_onset(free, &groups, &far));
    let onset = boundary.filter(|_| config.split_at_onset).map(|b| b.1);
    let force = training.force(&config.contact, onset)?;
    let (errors, bars) = training.errors(plan, &groups, Some(&force.1), config.coverage);
    Ok(Part { far_onset, ..training.part(RegimeKind::Contact, groups, Some(force.0), errors, bars) })
}

/// States on the onset, evenly spread over pressure; one only where all cases share a gap.
fn boundary_points(cases: &[(f64, f64)], table: &OnsetTable, config: &TrainConfig) -> Vec<(f64, f64)> {
    let count = config.boundary_states;
    let gap = cases[0].1;
    if cases.iter().all(|c| c.1 == gap) {
        let onset = table.onset(gap).pressure_mpa().filter(|p| count > 0 && *p > 0.0);
        return onset.map(|p| (p, gap)).into_iter().collect();
    }
    let (low, high) = cases.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), c| (l.min(c.1), h.max(c.1)));
    let limit = high + config.boundary_overshoot * (high - low);
    let last = table.gap_mm.partition_point(|g| *g <= limit).saturating_sub(1);
    let pick = |i: usize| i * last / (count - 1).max(1);
    (0..count).map(pick).map(|i| (table.pressure_mpa[i], table.gap_mm[i])).collect()
}

/// Every so many entries of the onset table beyond the trained ones take part in the POD.
const FAR_STRIDE: usize = 20;

/// The last onset state among `boundary` and all entries of the table beyond it; none when it is the table's end.
fn far_points(boundary: &[(f64, f64)], table: &OnsetTable) -> Vec<(f64, f64)> {
    let Some(last) = boundary.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) else { return Vec::new() };
    let entries = table.pressure_mpa.iter().copied().zip(table.gap_mm.iter().copied());
    let beyond: Vec<(f64, f64)> = entries.filter(|e| e.1 > last.1).collect();
    if beyond.is_empty() { beyond } else { std::iter::once(last).chain(beyond).collect() }
}

type Force = (ForceModel, Vec<Candidate>, f64);

impl<'a> Training<'a> {
    fn new(
        database: &'a Database,
        cases: &'a [usize],
        points: Vec<(f64, f64)>,
        quantities: &[Quantity],
        largest_gap: f64,
    ) -> Self {
        let inputs = input_map(&points, quantities);
        let scaled: Vec<[f64; 2]> = points.iter().map(|p| inputs.scale(p.0, p.1)).collect();
        // The domain is where cases were simulated, plus the onset up to the largest gap simulated.
        let trusted: Vec<[f64; 2]> = scaled
            .iter()
            .zip(&points)
            .enumerate()
            .filter(|(i, (_, p))| *i < cases.len() || p.1 <= largest_gap)
            .map(|(_, (x, _))| *x)
            .collect();
        let domain = domain_of(inputs.dimensions(), &trusted);
        let edge = domain_of(inputs.dimensions(), &scaled[..cases.len()]);
        let mut score: Vec<f64> = (0..points.len())
            .map(|i| f64::from(u8::from(i < cases.len() && !edge.has_vertex(scaled[i]))))
            .collect();
        if score.iter().sum::<f64>() < 3.0 {
            score[..cases.len()].fill(1.0); // too few inside to judge by: judge by all
        }
        Self { database, cases, points, inputs, scaled, score, domain, far: Vec::new() }
    }

    fn groups(
        &self,
        kind: RegimeKind,
        config: &TrainConfig,
        choices: &RegimeConfig,
        plan: &Plan,
        free: Option<&Part>,
    ) -> Result<Vec<GroupFit>, TrainError> {
        let states = self.states(&self.scaled, &self.score);
        let one = |(g, group): (usize, &super::group::Group)| {
            let nodes = self.database.node_count;
            let all = self.points.iter().chain(&self.far);
            let mut y = Mat::zeros(nodes * group.fields.len(), self.points.len() + self.far.len());
            for (j, &case) in self.cases.iter().enumerate() {
                for (at, &field) in group.fields.iter().enumerate() {
                    let column = &mut y.col_as_slice_mut(j)[at * nodes..(at + 1) * nodes];
                    column
                        .iter_mut()
                        .zip(self.database.field(case, field))
                        .for_each(|(y, v)| *y = f64::from(v));
                }
            }
            for (j, point) in all.enumerate().skip(self.cases.len()) {
                if let Some(free) = free {
                    let state = free.groups[g].evaluate(free.inputs.scale(point.0, 0.0));
                    y.col_as_slice_mut(j).copy_from_slice(&state);
                }
            }
            Decomposed::new(group, y, self.points.len(), kind.name(), choices, config.centred)
        };
        let decomposed = plan.groups.iter().enumerate().map(one).collect::<Result<Vec<_>, _>>()?;
        fit_groups(plan, decomposed, states, kind.name(), choices, config)
    }

    /// What makes the contact fields meet the free ones at the onset entries `far`, of which the first is trained on.
    fn far_onset(&self, free: &Part, groups: &[GroupFit], far: &[(f64, f64)]) -> Option<FarOnset> {
        if far.len() < 2 || self.inputs.dimensions() < 2 {
            return None;
        }
        let correction = |(at, point): (usize, &(f64, f64))| {
            let one = |(fit, free_fit): (&GroupFit, &GroupFit)| {
                let surrogate = fit.choice.fit.interpolant.values_at(self.inputs.scale(point.0, point.1));
                let wanted = fit.project(&free_fit.evaluate(free.inputs.scale(point.0, 0.0)));
                let difference =
                    wanted.iter().zip(&surrogate).map(|(w, s)| if at == 0 { 0.0 } else { w - s });
                difference.collect::<Vec<_>>()
            };
            groups.iter().zip(&free.groups).flat_map(one).collect::<Vec<_>>()
        };
        Some(FarOnset {
            gap_mm: far.iter().map(|p| p.1).collect(),
            corrections: far.iter().enumerate().flat_map(correction).collect(),
        })
    }

    fn states<'b>(&self, inputs: &'b [[f64; 2]], score: &'b [f64]) -> States<'b> {
        States { dimensions: self.inputs.dimensions(), inputs, score }
    }

    /// The contact force and its leave-one-out residuals by case, in N.
    fn force(
        &self,
        config: &RegimeConfig,
        onset: Option<&OnsetTable>,
    ) -> Result<(Force, Vec<f64>), TrainError> {
        let forces: Vec<f64> = self.cases.iter().map(|&i| self.database.cases[i].contact_force_n).collect();
        let excess: Vec<f64> = match onset {
            Some(table) => {
                self.points[..forces.len()].iter().map(|p| p.0 - table.pressure_and_slope(p.1).0).collect()
            }
            None => vec![1.0; forces.len()],
        };
        let least = MIN_EXCESS * excess.iter().copied().fold(0.0, f64::max);
        let used: Vec<usize> = (0..forces.len()).filter(|&i| excess[i] > least).collect();
        let inputs: Vec<[f64; 2]> = used.iter().map(|&i| self.scaled[i]).collect();
        let values: Vec<f64> = used.iter().map(|&i| forces[i] / excess[i]).collect();
        let score: Vec<f64> = used.iter().map(|&i| self.score[i] * excess[i]).collect();
        let task = Task {
            dropped: vec![0.0; values.len()],
            values,
            outputs: 1,
            modes: ModeChoice::Fixed(1),
            modes_for_energy: 1,
        };
        let chosen = choose(self.states(&inputs, &score), &[task], config);
        let error = |source| TrainError::Fit {
            what: "the contact force".into(),
            regime: RegimeKind::Contact.name(),
            source,
        };
        let choice = chosen.map_err(error)?.swap_remove(0); // one task, one choice
        let mut residuals = vec![0.0; forces.len()];
        used.iter().zip(&choice.fit.residuals).for_each(|(&i, e)| residuals[i] = e * excess[i]);
        let squares: f64 = residuals.iter().zip(&self.score).map(|(e, s)| e * e * s).sum();
        let rms = (squares / self.score.iter().sum::<f64>()).sqrt();
        let force = ForceModel { surrogate: choice.fit.interpolant, times_excess_pressure: onset.is_some() };
        Ok(((force, choice.candidates, rms), residuals))
    }

    /// Leave-one-out errors at each case's worst node, and the bars calibrated on those inside the hull.
    fn errors(
        &self,
        plan: &Plan,
        groups: &[GroupFit],
        force: Option<&[f64]>,
        coverage: f64,
    ) -> (Vec<CaseError>, HalfWidths) {
        let (cases, nodes) = (self.cases.len(), self.database.node_count);
        let mut displacement = Mat::<f64>::zeros(nodes, cases);
        let mut stress = vec![0.0_f64; cases];
        for (group, fit) in plan.groups.iter().zip(groups) {
            let errors = fit.error_fields(cases);
            for (at, &field) in group.fields.iter().enumerate() {
                let part = errors.get(at * nodes..(at + 1) * nodes, ..);
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
                    FieldKind::Stress => {
                        (0..cases).for_each(|i| stress[i] = stress[i].max(part.col(i).norm_max()))
                    }
                    FieldKind::Magnitude | FieldKind::Other => {}
                }
            }
        }
        let errors: Vec<CaseError> = (0..cases)
            .map(|i| CaseError {
                case: self.database.cases[self.cases[i]].name.clone(),
                on_hull: self.score[i] == 0.0,
                displacement_mm: displacement.col(i).norm_max().sqrt(),
                stress_mpa: stress[i],
                force_n: force.map_or(0.0, |f| f[i].abs()),
            })
            .collect();
        let bars = conformal::bars(&errors, coverage);
        (errors, bars)
    }

    fn part(
        self,
        kind: RegimeKind,
        groups: Vec<GroupFit>,
        force: Option<Force>,
        errors: Vec<CaseError>,
        bars: HalfWidths,
    ) -> Part {
        Part {
            kind,
            groups,
            force,
            errors,
            bars,
            cases: self.cases.len(),
            far_onset: None,
            boundary_states: self.points.len() - self.cases.len(),
            inputs: self.inputs,
            domain: self.domain,
        }
    }
}

/// Axes for the quantities that vary; a regime in which nothing varies keeps its first one, a unit wide.
fn input_map(points: &[(f64, f64)], quantities: &[Quantity]) -> InputMap {
    let axis = |quantity: &Quantity| {
        let values = points.iter().map(|p| if *quantity == Quantity::PressureMpa { p.0 } else { p.1 });
        let (min, max) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        InputAxis { quantity: *quantity, min, max }
    };
    let all: Vec<InputAxis> = quantities.iter().map(axis).collect();
    let mut axes: Vec<InputAxis> =
        all.iter().copied().filter(|a| a.max - a.min > 1e-9 * a.max.abs().max(a.min.abs())).collect();
    if axes.is_empty() {
        axes.push(InputAxis { max: all[0].min + 1.0, ..all[0] });
    }
    let constant_gap = all.iter().find(|a| a.quantity == Quantity::GapMm && !axes.contains(a));
    InputMap { axes, constant_gap_mm: constant_gap.map(|a| a.min) }
}

fn domain_of(dimensions: usize, points: &[[f64; 2]]) -> Domain {
    if dimensions > 1 {
        return Domain::hull_of(points);
    }
    let ends =
        points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |e, p| [e[0].min(p[0]), e[1].max(p[0])]);
    Domain::Interval(ends)
}
