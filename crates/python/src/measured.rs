//! Learning from recordings, and comparing with them. Results are the reports of the commands, as JSON.

use crate::model::Model;
use crate::progress::long_call;
use crate::refused;
use formats::log::{LogColumn, Recording};
use formats::unit::{in_heading, unit};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use train::comparison::{ComparedOutput, SensorBiases};
use train::measured::{LearningReport, Measured};

/// A run: times, and values by input and by output.
type Columns<'py> =
    (PyReadonlyArray1<'py, f64>, Vec<PyReadonlyArray1<'py, f64>>, Vec<PyReadonlyArray1<'py, f64>>);

fn recording(inputs: &[String], outputs: &[String], run: &Columns<'_>) -> Recording {
    let series = |names: &[String], columns: &[PyReadonlyArray1<'_, f64>]| {
        let named = names.iter().zip(columns);
        named
            .map(|(name, column)| LogColumn { name: name.clone(), values: column.as_array().to_vec() })
            .collect()
    };
    Recording {
        start_s: 0.0,
        time_s: run.0.as_array().to_vec(),
        inputs: series(inputs, &run.1),
        outputs: series(outputs, &run.2),
        remarks: Vec::new(),
    }
}

/// Learns a model from runs with columns of these names. Gives the model and the report.
#[pyfunction]
pub fn learn(
    py: Python<'_>,
    name: &str,
    inputs: Vec<String>,
    outputs: Vec<String>,
    runs: Vec<Columns<'_>>,
) -> PyResult<(Model, String)> {
    let data = Measured::of(runs.iter().map(|run| recording(&inputs, &outputs, run)).collect());
    let name = name.to_owned();
    let learned = long_call(py, None, move |_| train::measured::learn(&name, &data))?.map_err(refused)?;
    let report = serde_json::to_string(&LearningReport::of(&learned)).map_err(refused)?;
    Ok((Model::of(learned.model)?, report))
}

/// Name, measured and predicted values, half-widths of an output.
type OutputArrays<'py> =
    (String, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Compares a model with a run: the report, and the arrays behind it.
#[pyfunction]
pub fn compare<'py>(
    py: Python<'py>,
    model: &Model,
    inputs: Vec<String>,
    outputs: Vec<String>,
    run: Columns<'py>,
    follow_s: Option<f64>,
) -> PyResult<(String, Vec<OutputArrays<'py>>)> {
    let recording = recording(&inputs, &outputs, &run);
    let compare = || train::comparison::compare(model.model(), &recording, SensorBiases::default(), follow_s);
    let found = py.detach(compare).map_err(refused)?;
    let report = serde_json::to_string(&found).map_err(refused)?;
    let array = |values: &[f64]| PyArray1::from_slice(py, values);
    let arrays = found.series.iter().map(|output: &ComparedOutput| {
        let ComparedOutput { name, measured, predicted, half_width, .. } = output;
        (name.clone(), array(measured), array(predicted), array(half_width))
    });
    Ok((report, arrays.collect()))
}

/// Factor from a column's unit to the one at the end of a quantity's name. The unit is given, or in the column's heading, or that of the name.
#[pyfunction]
pub fn to_unit(name: &str, heading: &str, given: Option<&str>) -> PyResult<f64> {
    let own = name.rsplit('_').next().unwrap_or_default();
    let Some((quantity, to)) = unit(own) else {
        let text =
            format!("{name}: expected a name with a unit at its end, such as pressure_mpa or tip_x_mm");
        return Err(refused(text));
    };
    let spelling = given.or_else(|| in_heading(heading)).unwrap_or(own);
    match unit(spelling) {
        Some((found, from)) if found == quantity => Ok(from / to),
        _ => Err(refused(format!(
            "{name}: the column `{heading}` is in {spelling}, which cannot be converted to {own}; name its unit: (`{heading}`, \"{own}\")"
        ))),
    }
}
