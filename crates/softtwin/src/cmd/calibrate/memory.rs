//! Unknowns fitted to readings, behind a memory that is identified beside them.

use crate::failure::{configuration, unexplained};
use crate::files;
use crate::unknowns::{Unknowns, problems};
use estimate::{Fit, Measurement};
use runtime::estimation;
use std::path::Path;
use train::memory::{FittedUnknowns, Identified, MemoryError, identify_beside};

/// Unknowns fitted to readings behind the memory of their model.
pub struct Calibration {
    /// Unknowns with their model's sensors.
    pub unknowns: Unknowns,
    /// Readings behind the memory.
    pub readings: Vec<Measurement>,
    /// Fit to them.
    pub fit: Fit,
}

impl Calibration {
    /// Fits.
    pub fn of(mut unknowns: Unknowns, mut readings: Vec<Measurement>) -> anyhow::Result<Self> {
        if unknowns.session.filters_inputs() {
            estimation::filter(&mut unknowns.session, &unknowns.setup, &mut readings);
        }
        let fit = estimate::fit(&unknowns.setup, &readings, &mut unknowns.sensors)
            .map_err(|errors| problems(errors.iter().map(ToString::to_string).collect()))?;
        Ok(Self { unknowns, readings, fit })
    }
}

/// Identifies the memory, writes the model with it and fits the unknowns behind it.
///
/// # Errors
/// A pressure that does not move; a model without pressure; I/O errors.
pub fn calibrate(
    unknowns: Unknowns,
    readings: &[Measurement],
    out: &Path,
) -> anyhow::Result<(Calibration, Identified)> {
    let mut model = files::model(&unknowns.spec.model)?;
    model.header.set_parameters(unknowns.spec.given_inputs()).map_err(configuration)?;
    let mut last = None;
    let found = identify_beside(&mut model, readings, |model, readings| {
        let calibration = Calibration::of(Unknowns::of(unknowns.spec.clone(), model)?, readings.to_vec())?;
        let Unknowns { setup, sensors, .. } = &calibration.unknowns;
        let fit = calibration.fit.clone();
        let fitted = FittedUnknowns { setup: setup.clone(), sensors: sensors.clone(), fit };
        last = Some(calibration);
        Ok(fitted)
    });
    let found = found.map_err(|error: anyhow::Error| match error.downcast::<MemoryError>() {
        Ok(error) => unexplained(format!("--memory: {error}")),
        Err(error) => error,
    })?;
    files::save(out, &model.to_bytes()?)?;
    last.map(|last| (last, found)).ok_or_else(|| anyhow::anyhow!("no fit"))
}
