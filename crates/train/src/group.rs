//! POD groups: which fields share one, and the fit of one group over one regime's states.

use crate::config::{Grouping, ModeChoice, RegimeConfig, TrainConfig};
use crate::error::TrainError;
use crate::pod::{Centre, Compact, Pod, PodError, decompose};
use crate::select::{Choice, States, Task, choose};
use faer::Mat;
use rom::inputs::Point;
use rom::kernel::{Modes, Precision};
use rom::snapshots::{Database, FieldKind, Split};

/// One group: a name and the fields it stacks.
pub(crate) struct Group {
    pub name: String,
    pub fields: Vec<usize>,
    /// One deformed coordinate: chosen together with the others.
    pub coordinates: bool,
}

/// A stored magnitude is derived where it is the distance within this: above the rounding of a database, below any change of
/// shape that matters.
const DERIVED_WITHIN_MM: f64 = 1.0e-2;

/// Groups of decomposed fields, and derived fields.
pub(crate) struct Plan {
    pub groups: Vec<Group>,
    /// Per field: the coordinate fields from which a magnitude is derived.
    pub magnitude_of: Vec<Option<[usize; 3]>>,
}

impl Plan {
    pub fn new(database: &Database, config: &TrainConfig) -> Self {
        let axes = match [0, 1, 2].map(|axis| database.coordinate(axis)) {
            [Some(x), Some(y), Some(z)] if config.derive_magnitude => Some([x, y, z]),
            _ => None,
        };
        let derived = |field| axes.filter(|axes| follows(database, field, *axes));
        let magnitude_of: Vec<_> = database
            .fields
            .iter()
            .enumerate()
            .map(|(at, f)| if f.kind == FieldKind::Magnitude { derived(at) } else { None })
            .collect();
        let fields: Vec<usize> = (0..database.fields.len()).filter(|&f| magnitude_of[f].is_none()).collect();
        let groups = match config.grouping {
            Grouping::Joint => vec![Group { name: "joint".into(), fields, coordinates: false }],
            Grouping::PerField => {
                let group_of_field = |&f: &usize| Group {
                    name: database.fields[f].name.clone(),
                    fields: vec![f],
                    coordinates: matches!(database.fields[f].kind, FieldKind::Coordinate(_)),
                };
                fields.iter().map(group_of_field).collect()
            }
        };
        Self { groups, magnitude_of }
    }

    /// The group that holds a field, and where in it.
    pub fn find(&self, field: usize) -> Option<(usize, usize)> {
        self.groups
            .iter()
            .enumerate()
            .find_map(|(g, group)| group.fields.iter().position(|f| *f == field).map(|at| (g, at)))
    }
}

/// True if a magnitude is everywhere the distance from the undeformed mesh, as the parameters move it. It is not where that
/// is not known, or where the field means something else.
fn follows(database: &Database, field: usize, axes: [usize; 3]) -> bool {
    if database.undeformed_mm.is_none() {
        return false;
    }
    database.of_split(Split::Train).all(|case| {
        let mut coordinates = axes.map(|axis| database.field(case, axis));
        database.field(case, field).enumerate().all(|(node, magnitude)| {
            let along = |axis: usize| {
                let x = coordinates[axis].next().map_or(f64::NAN, f64::from);
                x - database.undeformed_at(case, node, axis)
            };
            let [x, y, z] = [0, 1, 2].map(along);
            ((x * x + y * y + z * z).sqrt() - f64::from(magnitude)).abs() <= DERIVED_WITHIN_MM
        })
    })
}

/// A fitted group.
pub(crate) struct GroupFit {
    pub compact: Compact,
    pub pod: Pod,
    /// Modes of each field as the model file stores them.
    pub stored: Vec<Modes>,
    /// The same with the fields stacked, `fields x nodes` by `modes`.
    pub basis: Mat<f64>,
    /// Kernel, modes, residuals, runners-up.
    pub choice: Choice,
}

/// The columns of a decomposition, in this order.
#[derive(Clone, Copy)]
pub(crate) struct Columns {
    /// States that are interpolated between.
    pub states: usize,
    /// States along the onset: in the span of the modes only.
    pub onset: usize,
    /// Vibrations: in the span of the modes only.
    pub vibrations: usize,
    /// Derivatives: in the span, and fitted where a kernel takes them.
    pub derivatives: usize,
    /// Factor of the derivatives: each counts as a step of this fraction of the input's range.
    pub weight: f64,
}

impl Columns {
    /// All of them.
    pub fn count(&self) -> usize {
        self.states + self.onset + self.vibrations + self.derivatives
    }
}

/// Weight of an onset state, relative to 1 for an interpolated state.
const ONSET_WEIGHT: f64 = 1.5;
/// Largest additional weight of an onset state with small values.
const MOST_ONSET_WEIGHT: f64 = 4.0;

/// Makes directions of the onset's columns: deviations from the centre of the states, each in relation to its own largest value,
/// as jumps at the onset are measured.
fn weigh_onset(y: &mut Mat<f64>, columns: Columns, centre: Centre) {
    let range = columns.states..columns.states + columns.onset;
    let mean = centre.of(y, columns.states);
    let sizes: Vec<f64> = range.clone().map(|j| y.col(j).norm_max()).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    for (j, size) in range.zip(sizes) {
        let relative = if size > largest / MOST_ONSET_WEIGHT { largest / size } else { MOST_ONSET_WEIGHT };
        let weight = ONSET_WEIGHT * relative;
        y.col_as_slice_mut(j).iter_mut().zip(&mean).for_each(|(v, mean)| *v = weight * (*v - mean));
    }
}

/// A decomposed group that waits for its kernel.
pub(crate) struct DecomposedGroup {
    compact: Compact,
    pod: Pod,
    task: Task,
}

impl DecomposedGroup {
    /// Decomposes `snapshots`.
    pub fn new(
        group: &Group,
        mut snapshots: Mat<f64>,
        columns: Columns,
        regime: &str,
        config: &RegimeConfig,
        centre: Centre,
    ) -> Result<Self, TrainError> {
        let pod_error =
            |source| TrainError::Pod { group: group.name.clone(), regime: regime.to_owned(), source };
        let states = columns.states;
        weigh_onset(&mut snapshots, columns, centre);
        let directions = columns.count() - states;
        let compact = Compact::new(snapshots, directions, centre).map_err(pod_error)?;
        let pod = decompose(compact.r.as_ref()).map_err(pod_error)?;
        let limit = pod.rank.min(config.max_modes);
        let a = pod.u.get(.., ..limit).transpose() * &compact.r;
        let dropped = |j| (compact.r.col(j).squared_norm_l2() - a.col(j).squared_norm_l2()).max(0.0);
        let modes = *config.group_modes.get(&group.name).unwrap_or(&config.modes);
        let task = Task {
            values: (0..states).flat_map(|j| a.col_as_slice(j)).copied().collect(),
            outputs: limit,
            slope_values: (columns.count() - columns.derivatives..a.ncols())
                .flat_map(|j| a.col_as_slice(j).iter().map(|v| v / columns.weight))
                .collect(),
            dropped: (0..states).map(dropped).collect(),
            modes,
            modes_for_energy: if let ModeChoice::Energy(e) = modes { pod.modes_for_energy(e) } else { limit },
        };
        Ok(Self { compact, pod, task })
    }
}

/// Chooses kernels and modes: coordinates together, every other group for itself. The order of the groups is kept.
pub(crate) fn fit_groups(
    plan: &Plan,
    decomposed: Vec<DecomposedGroup>,
    states: States,
    regime: &str,
    config: &RegimeConfig,
    precision: Precision,
) -> Result<Vec<GroupFit>, TrainError> {
    let together = |g: &usize| plan.groups[*g].coordinates;
    let all = 0..plan.groups.len();
    let mut clusters: Vec<Vec<usize>> = vec![all.clone().filter(together).collect()];
    clusters.extend(all.filter(|g| !together(g)).map(|g| vec![g]));
    let mut choices: Vec<Option<Choice>> = plan.groups.iter().map(|_| None).collect();
    for cluster in clusters.iter().filter(|c| !c.is_empty()) {
        let tasks: Vec<Task> = cluster.iter().map(|&g| decomposed[g].task.clone()).collect();
        let names: Vec<&str> = cluster.iter().map(|&g| plan.groups[g].name.as_str()).collect();
        let what = format!("group {}", names.join(", "));
        let refused = |source| TrainError::Fit { what, regime: regime.to_owned(), source };
        let chosen = choose(states, &tasks, config, &|_| true).map_err(refused)?;
        for (&g, choice) in cluster.iter().zip(chosen) {
            choices[g] = Some(choice);
        }
    }
    let mut fits = Vec::new();
    for ((group, d), choice) in plan.groups.iter().zip(decomposed).zip(choices) {
        let Some(choice) = choice else { continue };
        let exact = d.compact.modes(&d.pod, choice.modes);
        let nodes = exact.nrows() / group.fields.len();
        let field = |at: usize| {
            let value = |mode, node| exact[(at * nodes + node, mode)];
            Modes::new(precision, nodes, choice.modes, value).map_err(|_| TrainError::Pod {
                group: group.name.clone(),
                regime: regime.to_owned(),
                source: PodError::NoConvergence,
            })
        };
        let stored = (0..group.fields.len()).map(field).collect::<Result<Vec<_>, _>>()?;
        let value = |row: usize, mode| stored[row / nodes].value(mode, row % nodes);
        let basis = Mat::from_fn(exact.nrows(), choice.modes, value);
        fits.push(GroupFit { stored, basis, compact: d.compact, pod: d.pod, choice });
    }
    Ok(fits)
}

impl GroupFit {
    /// The group's stacked fields at a scaled input.
    pub fn evaluate(&self, x: &Point) -> Vec<f64> {
        let a = self.choice.fit.interpolant.values_at(x);
        let mut y = self.compact.mean.clone();
        for (k, a) in a.iter().enumerate() {
            for (y, phi) in y.iter_mut().zip(self.basis.col(k).iter()) {
                *y += a * phi;
            }
        }
        y
    }

    /// Coefficients of the group's stacked fields: their best approximation by the modes kept.
    pub fn project(&self, fields: &[f64]) -> Vec<f64> {
        let deviation: Vec<f64> = fields.iter().zip(&self.compact.mean).map(|(y, mean)| y - mean).collect();
        let coefficient =
            |k: usize| self.basis.col_as_slice(k).iter().zip(&deviation).map(|(phi, y)| phi * y).sum();
        (0..self.choice.modes).map(coefficient).collect()
    }

    /// Leave-one-out error fields of the first `cases` states, one column per case: data minus prediction, closed form. The
    /// prediction is that of the first `used` modes as stored.
    pub fn error_fields(&self, cases: usize, used: usize) -> Mat<f64> {
        let modes = self.choice.modes;
        let u = self.pod.u.get(.., ..used);
        let r = self.compact.r.get(.., ..cases);
        let residual = Mat::from_fn(used, cases, |k, i| self.choice.fit.residuals[i * modes + k]);
        &self.compact.q * r - self.basis.get(.., ..used) * (u.transpose() * r - residual)
    }

    /// Leave-one-out error with the first 0, 1, ... all modes, per entry in the unit of the fields.
    pub fn leave_one_out(&self) -> Vec<f64> {
        let entries = self.compact.mean.len() as f64;
        self.choice.leave_one_out.iter().map(|error| error / entries.sqrt()).collect()
    }
}
