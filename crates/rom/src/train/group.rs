//! POD groups: which fields share one, and the fit of one group over one regime's states.

use super::TrainError;
use crate::config::{Grouping, ModeChoice, RegimeConfig, TrainConfig};
use crate::fit::Samples;
use crate::interpolant::Interpolant;
use crate::pod::{Compact, Pod, decompose};
use crate::select::{Candidate, Task, choose};
use crate::snapshots::{Database, FieldKind, RegimeKind};
use faer::Mat;

/// One group: a name and the fields it stacks.
pub(super) struct Group {
    pub name: String,
    pub fields: Vec<usize>,
}

/// What is decomposed and what is derived.
pub(super) struct Plan {
    pub groups: Vec<Group>,
    /// By field: the coordinate fields a magnitude is derived from.
    pub magnitude_of: Vec<Option<[usize; 3]>>,
}

impl Plan {
    pub fn new(database: &Database, config: &TrainConfig) -> Self {
        let axes = match [0, 1, 2].map(|axis| database.coordinate(axis)) {
            [Some(x), Some(y), Some(z)] if config.derive_magnitude && database.undeformed_mm.is_some() => {
                Some([x, y, z])
            }
            _ => None,
        };
        let magnitude_of: Vec<_> = database
            .fields
            .iter()
            .map(|f| if f.kind == FieldKind::Magnitude { axes } else { None })
            .collect();
        let fields: Vec<usize> = (0..database.fields.len()).filter(|&f| magnitude_of[f].is_none()).collect();
        let groups = match config.grouping {
            Grouping::Joint => vec![Group { name: "joint".into(), fields }],
            Grouping::PerField => fields
                .iter()
                .map(|&f| Group { name: database.fields[f].name.clone(), fields: vec![f] })
                .collect(),
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

/// States of a regime: scaled inputs and which of them are scored.
pub(super) struct States<'a> {
    pub kind: RegimeKind,
    pub dimensions: usize,
    pub inputs: &'a [[f64; 2]],
    /// Weight in the leave-one-out score; 0 for states that are fitted but not judged by.
    pub score: &'a [f64],
}

/// A fitted group.
pub(super) struct GroupFit {
    pub compact: Compact,
    pub pod: Pod,
    pub modes: usize,
    /// Full-length modes, `fields x nodes` by `modes`.
    pub basis: Mat<f64>,
    pub surrogate: Interpolant,
    /// `states x modes` leave-one-out residuals of the coefficients.
    pub residuals: Vec<f64>,
    pub candidates: Vec<Candidate>,
}

impl GroupFit {
    /// Decomposes `snapshots` (one column a state) and chooses kernel and modes.
    pub fn new(
        group: &Group,
        snapshots: Mat<f64>,
        states: &States,
        config: &RegimeConfig,
        centred: bool,
    ) -> Result<Self, TrainError> {
        let regime = states.kind.name();
        let pod_error = |source| TrainError::Pod { group: group.name.clone(), regime, source };
        let compact = Compact::new(snapshots, centred).map_err(pod_error)?;
        let pod = decompose(compact.r.as_ref()).map_err(pod_error)?;
        let limit = pod.rank.min(config.max_modes);
        let coefficients = pod.u.get(.., ..limit).transpose() * &compact.r;
        let m = coefficients.ncols();
        let values: Vec<f64> =
            (0..m).flat_map(|j| coefficients.col(j).iter().copied().collect::<Vec<_>>()).collect();
        let dropped: Vec<f64> = (0..m)
            .map(|j| (compact.r.col(j).squared_norm_l2() - coefficients.col(j).squared_norm_l2()).max(0.0))
            .collect();
        let modes = *config.group_modes.get(&group.name).unwrap_or(&config.modes);
        let task = Task {
            samples: Samples {
                dimensions: states.dimensions,
                inputs: states.inputs,
                values: &values,
                outputs: limit,
            },
            dropped: &dropped,
            score: states.score,
            modes,
            modes_for_energy: if let ModeChoice::Energy(e) = modes { pod.modes_for_energy(e) } else { limit },
        };
        let choice = choose(&task, config).map_err(|source| TrainError::Fit {
            what: format!("group {}", group.name),
            regime,
            source,
        })?;
        let basis = compact.modes(&pod, choice.modes);
        Ok(Self {
            compact,
            pod,
            modes: choice.modes,
            basis,
            surrogate: choice.fit.interpolant,
            residuals: choice.fit.residuals,
            candidates: choice.candidates,
        })
    }

    /// The group's stacked fields at a scaled input.
    pub fn evaluate(&self, x: [f64; 2]) -> Vec<f64> {
        let a = self.surrogate.values_at(x);
        let mut y = self.compact.mean.clone();
        for (k, a) in a.iter().enumerate() {
            for (y, phi) in y.iter_mut().zip(self.basis.col(k).iter()) {
                *y += a * phi;
            }
        }
        y
    }

    /// Leave-one-out error fields of the first `cases` states, one column a case: data minus prediction, closed form.
    pub fn error_fields(&self, cases: usize) -> Mat<f64> {
        let u = self.pod.u.get(.., ..self.modes);
        let r = self.compact.r.get(.., ..cases);
        let residual = Mat::from_fn(self.modes, cases, |k, i| self.residuals[i * self.modes + k]);
        let prediction = u * (u.transpose() * r - residual);
        &self.compact.q * (r - prediction)
    }
}
