//! Laws of silicones from their tests. The report is that of `softtwin material fit`, as JSON.

use crate::progress::long_call;
use crate::{named, refused};
use fem::material::{
    FitError, FitReport, FittedSpecimens, LawName, Specimen, TestDescription, TestKind, material_text,
    read_list,
};
use formats::FormatError;
use formats::log::Log;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// The law of some tests.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Material {
    fitted: Arc<FittedSpecimens>,
}

/// A test: its description as in `[[test]]`, as JSON, and the two columns of a table in memory with their names.
type Test<'py> = (String, Option<Vec<(String, PyReadonlyArray1<'py, f64>)>>);

/// Name, kind, stretches and nominal stresses (MPa) of the rows that were fitted.
type FittedTest<'py> = (String, &'static str, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[derive(Debug, thiserror::Error)]
enum MaterialError {
    #[error(transparent)]
    Files(#[from] FormatError),
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Fits a law, by default the one that predicts larger strains best.
#[pyfunction]
pub fn fit_material(
    py: Python<'_>,
    tests: Vec<Test<'_>>,
    law: Option<&str>,
    max_strain: f64,
    working_weight: f64,
) -> PyResult<Material> {
    let law = law.map(str::parse::<LawName>).transpose().map_err(|error| refused(format!("law: {error}")))?;
    let mut known: Vec<(TestDescription, Option<Log>)> = Vec::new();
    for (description, columns) in tests {
        let description: TestDescription =
            serde_json::from_str(&description).map_err(|error| refused(format!("test: {error}")))?;
        match columns {
            None if description.file.extension().is_some_and(|ending| ending == "toml") => {
                let list = read_list(&description.file).map_err(|error| named(&error))?;
                known.extend(list.into_iter().map(|test| (test, None)));
            }
            None => known.push((description, None)),
            Some(columns) => {
                let columns = columns.iter().map(|(name, values)| (name.clone(), values.as_array().to_vec()));
                known.push((description, Some(Log::of_columns(columns.collect()))));
            }
        }
    }
    let work = move || -> Result<FittedSpecimens, MaterialError> {
        FittedSpecimens::check_count(known.len())?;
        let read = |(description, log): &(TestDescription, Option<Log>)| match log {
            None => Specimen::read(description, max_strain, working_weight),
            Some(log) => Specimen::of_log(log, description, max_strain, working_weight),
        };
        let specimens = known.iter().map(read).collect::<Result<_, _>>()?;
        let fitted = FittedSpecimens::new(specimens, law)?;
        fitted.check_explained()?;
        Ok(fitted)
    };
    let fitted = long_call(py, None, move |_| work())?.map_err(|error| named(&error))?;
    Ok(Material { fitted: Arc::new(fitted) })
}

#[pymethods]
impl Material {
    /// What was found, as JSON.
    fn report(&self) -> PyResult<String> {
        serde_json::to_string(&FitReport::new(&self.fitted, None, None)).map_err(refused)
    }

    /// The text of a material file for a density in t/mm3.
    fn text(&self, density_t_per_mm3: f64) -> String {
        material_text(&self.fitted, density_t_per_mm3)
    }

    /// Checks that a text is a material file.
    #[staticmethod]
    fn check(text: &str, name: &str) -> PyResult<()> {
        fem::material::MaterialFile::parse(Path::new(name), text).map(drop).map_err(|error| named(&error))
    }

    /// The law's nominal stress (MPa) at stretches, NaN where it has none.
    fn stress_mpa<'py>(
        &self,
        py: Python<'py>,
        kind: &str,
        stretches: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let kind: TestKind = kind.parse().map_err(|error| refused(format!("kind: {error}")))?;
        let law = &self.fitted.best.law;
        let stress = |stretch: &f64| law.nominal_stress_mpa(kind.deformation(), *stretch).unwrap_or(f64::NAN);
        Ok(stretches.as_array().iter().map(stress).collect::<Vec<f64>>().into_pyarray(py))
    }

    /// The rows that were fitted, by test.
    #[getter]
    fn tests<'py>(&self, py: Python<'py>) -> Vec<FittedTest<'py>> {
        let column = |specimen: &Specimen, at: usize| {
            let rows = specimen.test.points.iter();
            rows.map(|row| row[at]).collect::<Vec<f64>>().into_pyarray(py)
        };
        let test = |specimen: &Specimen| {
            (specimen.name.clone(), specimen.kind.word(), column(specimen, 0), column(specimen, 1))
        };
        self.fitted.specimens.iter().map(test).collect()
    }
}
