//! The largest stress of a state without its stress field.

use crate::accepted::largest_coefficients;
use crate::evaluation::Evaluation;
use crate::kernel::{Peak, PeakSearch, ReconstructError, Source};
use crate::model::{Model, ModelError, RegimeModel};
use crate::reconstructor::source;
use crate::snapshots::{FieldKind, RegimeKind};

/// Finds value and node of the largest von Mises stress of all nodes: to the bit those that a
/// [`crate::reconstructor::Reconstructor`] in f32 finds on its way through the whole field, at a part of its cost where the stress has
/// its peaks in few places.
#[derive(Clone, Debug)]
pub struct StressPeak {
    regimes: Vec<(RegimeKind, PeakSearch)>,
    swept: (usize, usize),
}

impl StressPeak {
    /// Lays out the stress of all regimes; none for a model without stress. Cost: some ten passes over its modes.
    ///
    /// # Errors
    /// [`ModelError`] when a block is missing or damaged.
    pub fn new(model: &Model) -> Result<Option<Self>, ModelError> {
        model.header.check().map_err(ModelError::Inconsistent)?;
        let mut fields = model.header.fields.iter();
        let Some(field) = fields.position(|field| field.spec.kind == FieldKind::Stress) else {
            return Ok(None);
        };
        let search = |regime: &RegimeModel| {
            let found = match source(model, regime, &[field], field, &[])? {
                Source::Affine(affine) => {
                    PeakSearch::build(&affine, model.header.node_count, &largest_coefficients(regime))?
                }
                Source::Magnitude { .. } => {
                    let text = "a stress is no length of a displacement; train the model again".to_owned();
                    return Err(ModelError::Inconsistent(text));
                }
            };
            Ok((regime.kind, found))
        };
        let regimes = model.header.regimes.iter().map(search).collect::<Result<_, _>>()?;
        Ok(Some(Self { regimes, swept: (0, 1) }))
    }

    /// The largest stress, MPa, of an evaluation that has the stress' coefficients. Nothing is allocated.
    ///
    /// # Errors
    /// [`ReconstructError`] for an evaluation of another model.
    pub fn find(&mut self, evaluation: &Evaluation) -> Result<Peak, ReconstructError> {
        let search = self.regimes.iter_mut().find(|(kind, _)| *kind == evaluation.regime);
        let Some((_, search)) = search else {
            return Err(ReconstructError::Coefficients { found: 0, expected: evaluation.coefficients.len() });
        };
        let found = search.find(&evaluation.coefficients)?;
        self.swept = search.swept();
        Ok(found)
    }

    /// Share of the nodes whose stress the last search computed.
    pub fn computed_share(&self) -> f64 {
        self.swept.0 as f64 / self.swept.1 as f64
    }
}
