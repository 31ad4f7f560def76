//! Result of a fit: text, JSON, picture, material file.

use super::specimen::{Specimen, kind_name};
use crate::picture::{Axis, Figure, Mark, Panel, Series};
use fem::material::Hyperelastic;
use fem::material::fit::Fitted;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Everything of a fit.
pub struct Report<'a> {
    /// Tests.
    pub specimens: &'a [Specimen],
    /// All laws that were fitted.
    pub candidates: &'a [Fitted],
    /// The chosen one.
    pub best: &'a Fitted,
    /// Stretches of a bar that the tests reach.
    pub range: [f64; 2],
    /// Suspicions about the tests.
    pub remarks: &'a [String],
    /// Density (t/mm3).
    pub density_t_per_mm3: f64,
}

/// Bulk modulus of a material file, MPa: rubber.
const BULK_MPA: f64 = 2000.0;

/// `yeoh`, as files name the law.
fn key(law: &Hyperelastic) -> String {
    law.name().to_lowercase()
}

/// A number with six significant digits.
fn number(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn percent(error_mpa: f64, specimen: &Specimen) -> f64 {
    100.0 * error_mpa / specimen.test.largest_mpa()
}

fn stability(fitted: &Fitted) -> String {
    fitted
        .stable_to
        .map_or_else(|| "at every stretch".into(), |stretch| format!("to a stretch of {stretch:.2}"))
}

impl Report<'_> {
    /// Lines for people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        for specimen in self.specimens {
            out += &format!("{} ({}):\n", specimen.name, kind_name(specimen.kind));
            specimen.notes.iter().for_each(|note| out += &format!("  {note}\n"));
        }
        out += "law, constants, RMS error, error on parts left out (% of the largest stress), stable (Drucker)\n";
        for fitted in self.candidates {
            let mark = if std::ptr::eq(fitted, self.best) || fitted.law == self.best.law { "*" } else { " " };
            out += &format!(
                "{mark} {:<14}{:>2}{:>8.2}{:>8.2}   {}\n",
                key(&fitted.law),
                fitted.law.constants().len(),
                100.0 * fitted.error,
                100.0 * fitted.held_out_error,
                stability(fitted)
            );
        }
        let law = &self.best.law;
        out += &format!(
            "{}, initial shear modulus {:.5} MPa, 95 % intervals:\n",
            key(law),
            law.shear_modulus_mpa()
        );
        for ((name, value), half_width) in law.constants().iter().zip(&self.best.half_widths) {
            let interval =
                half_width.map_or_else(|| "not determined by the tests".into(), |h| format!("+- {h:.2e}"));
            out += &format!("  {name:<8} {value:>13.6e} {interval}\n");
        }
        for specimen in self.specimens {
            let [rms, largest] = specimen.test.error_mpa(law);
            out += &format!(
                "  {}: {} rows, largest stress {:.4} MPa, RMS {:.2} %, largest error {:.2} %\n",
                specimen.name,
                specimen.test.points.len(),
                specimen.test.largest_mpa(),
                percent(rms, specimen),
                percent(largest, specimen)
            );
        }
        out += &format!(
            "valid for stretches of a bar from {:.3} to {:.3}, stable {}",
            self.range[0],
            self.range[1],
            stability(self.best)
        );
        self.remarks.iter().for_each(|remark| out += &format!("\nremark: {remark}"));
        out
    }

    /// One object for programs.
    pub fn json(&self, out: Option<&Path>, picture: Option<&Path>) -> Value {
        let law = &self.best.law;
        let constants: Map<String, Value> =
            law.constants().iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
        let names = law.constants().into_iter().map(|(name, _)| name.to_owned());
        let half_widths: Map<String, Value> =
            names.zip(self.best.half_widths.iter().map(|h| json!(h))).collect();
        let tests: Vec<Value> = self
            .specimens
            .iter()
            .map(|specimen| {
                let [rms, largest] = specimen.test.error_mpa(law);
                json!({
                    "file": specimen.name,
                    "test": kind_name(specimen.kind),
                    "rows": specimen.test.points.len(),
                    "largest_stress_mpa": specimen.test.largest_mpa(),
                    "rms_percent": percent(rms, specimen),
                    "largest_error_percent": percent(largest, specimen),
                    "loops_lost_percent": specimen.loops.iter().map(|lost| 100.0 * lost).collect::<Vec<_>>(),
                    "notes": specimen.notes,
                })
            })
            .collect();
        let candidates: Vec<Value> = self
            .candidates
            .iter()
            .map(|fitted| {
                json!({
                    "law": key(&fitted.law), "constants": fitted.law.constants().len(),
                    "rms_percent": 100.0 * fitted.error, "held_out_percent": 100.0 * fitted.held_out_error,
                    "stable_to_stretch": fitted.stable_to,
                })
            })
            .collect();
        json!({
            "law": key(law), "constants": constants, "half_widths_95": half_widths,
            "shear_modulus_mpa": law.shear_modulus_mpa(), "rms_percent": 100.0 * self.best.error,
            "held_out_percent": 100.0 * self.best.held_out_error, "stretch_range": self.range,
            "stable_to_stretch": self.best.stable_to, "tests": tests, "candidates": candidates,
            "remarks": self.remarks, "material": out, "picture": picture,
        })
    }
}

pub fn material_file(report: &Report<'_>) -> String {
    let law = &report.best.law;
    let [low, high] = report.range;
    let mut out = format!(
        "# Made by `softtwin material fit`. In actuator.toml: [elastomer] file = \"this file\" in place of its other keys.\n\
         layout = 1\n\n[elastomer]\nbulk_mpa = {BULK_MPA:?}                # K\ndensity_t_per_mm3 = {:e}\n\
         stretch_range = [{:?}, {:?}]   # of a bar, reached by the tests; stable {}\n\n[elastomer.law]\nlaw = \"{}\"\n",
        report.density_t_per_mm3,
        number(low),
        number(high),
        stability(report.best),
        key(law)
    );
    for ((name, value), half_width) in law.constants().iter().zip(&report.best.half_widths) {
        let interval = half_width.map_or_else(|| "open".into(), |h| format!("+- {h:.1e} (95 %)"));
        out += &format!("{name} = {:?}   # {interval}\n", number(*value));
    }
    out += &format!(
        "\n[fit]\nrms_percent = {:?}          # of the largest stress\n",
        number(100.0 * report.best.error)
    );
    for specimen in report.specimens {
        let [rms, _] = specimen.test.error_mpa(law);
        out += &format!(
            "\n[[fit.tests]]\nfile = {}\ntest = \"{}\"\nrms_percent = {:?}\n",
            Value::from(specimen.name.as_str()),
            kind_name(specimen.kind),
            number(percent(rms, specimen))
        );
    }
    out
}

/// Most points of a drawn test.
const DRAWN: usize = 400;

/// Tests with the law, and their differences.
pub fn figure(report: &Report<'_>) -> Figure {
    let law = &report.best.law;
    let mut panels = Vec::new();
    for specimen in report.specimens {
        let thinned = |points: &[[f64; 2]]| -> Vec<(f64, f64)> {
            let step = points.len().div_ceil(DRAWN).max(1);
            points.iter().step_by(step).map(|p| (p[0], p[1])).collect()
        };
        let points = &specimen.test.points;
        let (low, high) = points.iter().fold((1.0_f64, 1.0_f64), |(a, b), p| (a.min(p[0]), b.max(p[0])));
        let curve: Vec<(f64, f64)> = (0..=200)
            .map(|k| low + (high - low) * f64::from(k) / 200.0)
            .filter_map(|l| Some((l, law.nominal_stress_mpa(specimen.test.deformation, l)?)))
            .collect();
        let within: Vec<[f64; 2]> = specimen
            .rows
            .iter()
            .copied()
            .filter(|row| row[0] <= high + 0.02 && row[0] >= low - 0.02)
            .collect();
        let largest = specimen.test.largest_mpa();
        let off: Vec<(f64, f64)> = points
            .iter()
            .filter_map(|p| {
                Some((
                    p[0],
                    100.0 * (law.nominal_stress_mpa(specimen.test.deformation, p[0])? - p[1]) / largest,
                ))
            })
            .collect();
        let series = |name: &str, colour, mark, points| Series { name: name.into(), colour, mark, points };
        let mut drawn = vec![series("measured", 4, Mark::Line, thinned(&within))];
        drawn.push(series("fitted rows", 0, Mark::Dots, thinned(points)));
        drawn.push(series(&key(law), 1, Mark::Line, curve));
        panels.push(Panel {
            title: format!("{} ({})", specimen.name, kind_name(specimen.kind)),
            x: Axis::linear("stretch"),
            y: Axis::linear("nominal stress [MPa]"),
            series: drawn,
            map: None,
        });
        panels.push(Panel {
            title: String::new(),
            x: Axis::linear("stretch"),
            y: Axis::linear("law - measured [% of the largest stress]"),
            series: vec![series("", 1, Mark::Dots, off)],
            map: None,
        });
    }
    let title = format!("{}: RMS {:.2} % of the largest stress", key(law), 100.0 * report.best.error);
    Figure { title, panels, columns: 2 }
}
