//! What version 4 of the model file adds behind the header of version 3: parameters, the clearance that the onset is solved
//! from, interpolants with derivatives. A model that has none of them is written as version 3, byte for byte as before.

use super::header::{Clearance, ModelHeader};
use crate::inputs::PARAMETERS;
use crate::interpolant::Slope;
use serde::{Deserialize, Serialize};

#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Further {
    /// Values of the parameters that a state takes that says nothing else.
    values: Vec<f64>,
    clearance: Option<Clearance>,
    /// By interpolant, in the order of [`super::RegimeModel::interpolants`], regime after regime.
    slopes: Vec<Vec<Slope>>,
}

impl Further {
    /// What the header has beyond version 3.
    pub(super) fn of(header: &ModelHeader) -> Self {
        let fits = header.regimes.iter().flat_map(|regime| regime.interpolants());
        Self {
            values: header.inputs.iter().skip(PARAMETERS).filter_map(|input| input.value).collect(),
            clearance: header.clearance.clone(),
            slopes: fits.map(|fit| fit.slopes.clone()).collect(),
        }
    }

    /// Whether it has nothing.
    pub(super) fn is_empty(&self) -> bool {
        self.values.is_empty() && self.clearance.is_none() && self.slopes.iter().all(Vec::is_empty)
    }

    /// Adds it to a header that was read.
    ///
    /// # Errors
    /// A sentence when it belongs to another header.
    pub(super) fn add_to(self, header: &mut ModelHeader) -> Result<(), String> {
        let parameters = header.inputs.len().saturating_sub(PARAMETERS);
        let fits: usize = header.regimes.iter().map(|regime| regime.interpolants().count()).sum();
        if self.values.len() != parameters || self.slopes.len() != fits {
            return Err(format!(
                "expected {parameters} values of parameters and {fits} lists of derivatives, found {} and {}",
                self.values.len(),
                self.slopes.len()
            ));
        }
        let inputs = header.inputs.iter_mut().skip(PARAMETERS);
        inputs.zip(self.values).for_each(|(input, value)| input.value = Some(value));
        let fits = header.regimes.iter_mut().flat_map(|regime| {
            let force = regime.force.as_mut().map(|force| &mut force.surrogate);
            regime.groups.iter_mut().map(|group| &mut group.surrogate).chain(force)
        });
        fits.zip(self.slopes).for_each(|(fit, slopes)| fit.slopes = slopes);
        header.clearance = self.clearance;
        Ok(())
    }
}
