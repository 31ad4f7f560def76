//! POD groups: which fields share one, and the fit of one group over one regime's states.

use crate::config::{Grouping, ModeChoice, RegimeConfig, TrainConfig};
use crate::error::TrainError;
use crate::pod::{Centre, Compact, Pod, PodError, decompose_beyond};
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
            .map(|(index, f)| if f.kind == FieldKind::Magnitude { derived(index) } else { None })
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
        self.states + self.vibrations + self.derivatives
    }
}

/// A decomposed group that waits for its kernel.
pub(crate) struct DecomposedGroup {
    compact: Compact,
    pod: Pod,
    task: Task,
}

impl DecomposedGroup {
    /// Decomposes `snapshots`. With a fit of the free regime the basis goes on from its modes.
    pub fn new(
        group: &Group,
        mut snapshots: Mat<f64>,
        columns: Columns,
        regime: &str,
        config: &RegimeConfig,
        centre: Centre,
        free: Option<&GroupFit>,
    ) -> Result<Self, TrainError> {
        let pod_error =
            |source| TrainError::Pod { group: group.name.clone(), regime: regime.to_owned(), source };
        let states = columns.states;
        let leading = free.map_or(0, |fit| fit.choice.modes);
        let compact = match free {
            Some(fit) => {
                for j in 0..states {
                    let column = snapshots.col_as_slice_mut(j).iter_mut();
                    column.zip(&fit.compact.mean).for_each(|(v, mean)| *v -= mean);
                }
                Compact::beyond(fit.compact.mean.clone(), &fit.compact.modes(&fit.pod, leading), snapshots)
            }
            None => Compact::new(snapshots, columns.count() - states, centre).map_err(pod_error)?,
        };
        let pod = decompose_beyond(compact.r.as_ref(), leading).map_err(pod_error)?;
        let limit = pod.rank.min(config.max_modes.max(leading));
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
            leading,
        };
        Ok(Self { compact, pod, task })
    }
}

/// Chooses kernels and modes: coordinates together, every other group for itself. The order of the groups is kept. `largest` gives the
/// largest amplitude of each mode of a group at any node in any state of the model.
pub(crate) fn fit_groups(
    plan: &Plan,
    decomposed: Vec<DecomposedGroup>,
    states: States,
    regime: &str,
    config: &RegimeConfig,
    precision: Precision,
    largest: &dyn Fn(usize, &GroupFit) -> Vec<f64>,
) -> Result<Vec<GroupFit>, TrainError> {
    let together = |g: &usize| plan.groups[*g].coordinates;
    let all = 0..plan.groups.len();
    let mut clusters: Vec<Vec<usize>> = vec![all.clone().filter(together).collect()];
    clusters.extend(all.filter(|g| !together(g)).map(|g| vec![g]));
    clusters.retain(|cluster| !cluster.is_empty());
    let mut choices: Vec<Option<Choice>> = plan.groups.iter().map(|_| None).collect();
    for cluster in &clusters {
        let tasks: Vec<Task> = cluster.iter().map(|&g| decomposed[g].task.clone()).collect();
        let names: Vec<&str> = cluster.iter().map(|&g| plan.groups[g].name.as_str()).collect();
        let what = format!("group {}", names.join(", "));
        let refused = |source| TrainError::Fit { what, regime: regime.to_owned(), source };
        let chosen = choose(states, &tasks, config, &|_| true).map_err(refused)?;
        for (&g, choice) in cluster.iter().zip(chosen) {
            choices[g] = Some(choice);
        }
    }
    let mut fits: Vec<GroupFit> = Vec::new();
    for (d, choice) in decomposed.into_iter().zip(choices) {
        let Some(choice) = choice else { continue };
        let basis = d.compact.modes(&d.pod, choice.modes);
        fits.push(GroupFit { stored: Vec::new(), basis, compact: d.compact, pod: d.pod, choice });
    }
    for cluster in &clusters {
        let bits = bits(cluster, &fits, states, largest, precision);
        for (&g, bits) in cluster.iter().zip(bits) {
            let fields = plan.groups[g].fields.len();
            fits[g].store(fields, bits).map_err(|source| TrainError::Pod {
                group: plan.groups[g].name.clone(),
                regime: regime.to_owned(),
                source,
            })?;
        }
    }
    Ok(fits)
}

/// Part of the model's own error at the worst node that all roundings together may have there.
const ROUNDED: f64 = 0.4;
/// Largest of the roundings of some ten thousand nodes, in standard deviations, times the coefficient's root mean square over its largest.
const LARGEST_ROUNDING: f64 = 4.5 / 3.0;
/// Fewer scored states than this do not say what rounding may cost.
const MIN_STATES: usize = 4;

/// Bits of each mode of groups that are chosen together: as few as its amplitude allows beside the groups' leave-one-out error at the worst
/// node. A rounding is uniform over a step, and there is one for each mode.
fn bits(
    cluster: &[usize],
    fits: &[GroupFit],
    states: States,
    largest: &dyn Fn(usize, &GroupFit) -> Vec<f64>,
    precision: Precision,
) -> Vec<Vec<u8>> {
    let all = |bits: u8| cluster.iter().map(|&g| vec![bits; fits[g].choice.modes]).collect();
    let scored: Vec<usize> = (0..states.score.len()).filter(|i| states.score[*i] > 0.0).collect();
    let Some(last) = scored.last().filter(|_| scored.len() >= MIN_STATES && precision == Precision::Integers)
    else {
        return all(precision.bits());
    };
    let errors: Vec<Mat<f64>> = cluster.iter().map(|&g| fits[g].error_fields(last + 1)).collect();
    let worst = |&i: &usize| {
        let square =
            |row: usize| errors.iter().map(|fold| fold[(row % fold.nrows(), i)].powi(2)).sum::<f64>();
        (0..errors[0].nrows()).map(square).fold(0.0, f64::max).sqrt()
    };
    let error = mean_of_logarithms(scored.iter().map(worst));
    let modes: usize = cluster.iter().map(|&g| fits[g].choice.modes).sum();
    let step = ROUNDED * error * 12.0_f64.sqrt() / (LARGEST_ROUNDING * (modes as f64).sqrt());
    let of_group = |&g: &usize| {
        let amplitudes = largest(g, &fits[g]);
        let bits =
            |amplitude: &f64| [4, 8].into_iter().find(|bits| amplitude / step < f64::from(1 << (bits - 1)));
        amplitudes.iter().map(|amplitude| bits(amplitude).unwrap_or(16)).collect()
    };
    cluster.iter().map(of_group).collect()
}

fn mean_of_logarithms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value.max(f64::MIN_POSITIVE).ln()).sum::<f64>() / count).exp()
}

impl GroupFit {
    /// Rounds the modes to so many bits, as the model file stores them.
    fn store(&mut self, fields: usize, bits: Vec<u8>) -> Result<(), PodError> {
        let nodes = self.basis.nrows() / fields;
        let field = |index: usize| {
            let value = |mode, node| self.basis[(index * nodes + node, mode)];
            Modes::with_bits(nodes, bits.clone(), value).map_err(|_| PodError::NoConvergence)
        };
        self.stored = (0..fields).map(field).collect::<Result<Vec<_>, _>>()?;
        let value = |row: usize, mode| self.stored[row / nodes].value(mode, row % nodes);
        self.basis = Mat::from_fn(self.basis.nrows(), self.choice.modes, value);
        Ok(())
    }

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

    /// Leave-one-out error fields of the first `cases` states, one column per case: data minus prediction, closed form. The
    /// prediction is that of the modes as stored.
    pub fn error_fields(&self, cases: usize) -> Mat<f64> {
        let modes = self.choice.modes;
        let u = self.pod.u.get(.., ..modes);
        let r = self.compact.r.get(.., ..cases);
        let residual = Mat::from_fn(modes, cases, |k, i| self.choice.fit.residuals[i * modes + k]);
        &self.compact.q * r - &self.basis * (u.transpose() * r - residual)
    }
}
