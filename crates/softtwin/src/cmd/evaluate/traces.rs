//! Errors and pictures of a model along motions of the finite elements.

use crate::files;
use crate::picture::{Figure, Panel, Series};
use crate::report;
use anyhow::Result;
use rom::model::Model;
use std::path::{Path, PathBuf};
use train::trace::{MotionErrors, motion_errors, phase, spectrum};

/// Compares, draws and prints.
pub fn run(model: &Model, folders: &[PathBuf], picture: Option<&Path>, as_json: bool) -> Result<()> {
    let compare =
        |folder: &PathBuf| motion_errors(model, &folder.join("series.csv")).map_err(files::not_followed);
    let all: Vec<MotionErrors> = folders.iter().map(compare).collect::<Result<_>>()?;
    if let Some(picture) = picture {
        let panels = folders.iter().zip(&all).flat_map(|(folder, errors)| panels(folder, errors)).collect();
        Figure { title: "Motions".into(), panels, columns: 4 }.save(picture)?;
    }
    report::print(&all, as_json)
}

/// Points of a curve from the rows of a series.
type Curve = fn(&[Vec<f64>]) -> Vec<(f64, f64)>;

/// Curves of finite elements, model and static model, phase and spectrum.
fn panels(folder: &Path, errors: &MotionErrors) -> [Panel; 4] {
    let title = folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let names = ["finite elements", "model", "static"];
    let curves = |x: &str, y: &str, count: usize, points: Curve| {
        let curve = |(colour, (name, rows)): (usize, (&str, &Vec<Vec<f64>>))| {
            Series::line(name, colour, points(rows))
        };
        let series = names.into_iter().zip(&errors.motion).take(count).enumerate().map(curve).collect();
        Panel::new(&title, x, y, series)
    };
    [
        curves("time [s]", "tip y [mm]", 3, |rows| rows.iter().map(|row| (row[0], row[5])).collect()),
        curves("time [s]", "contact force [N]", 3, |rows| rows.iter().map(|row| (row[0], row[6])).collect()),
        curves("tip y [mm]", "rate of tip y [mm/s]", 2, phase),
        curves("frequency [Hz]", "amplitude of tip y [mm]", 2, spectrum),
    ]
}
