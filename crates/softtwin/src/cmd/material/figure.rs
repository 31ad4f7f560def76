//! A fit as a picture.

use crate::picture::{Axis, Figure, Mark, Panel, Series};
use fem::material::FittedSpecimens;

/// Most points of a drawn test.
const DRAWN: usize = 400;

/// Tests with the law, and their differences.
pub fn figure(fitted: &FittedSpecimens) -> Figure {
    let law = &fitted.best.law;
    let mut panels = Vec::new();
    for specimen in &fitted.specimens {
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
        drawn.push(series(&law.key(), 1, Mark::Line, curve));
        panels.push(Panel {
            title: format!("{} ({})", specimen.name, specimen.kind.word()),
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
    let title = format!("{}: RMS {:.2} % of the largest stress", law.key(), 100.0 * fitted.best.error);
    Figure { title, panels, columns: 2 }
}
