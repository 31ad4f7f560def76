//! Pictures of motions: curves of finite elements, model and static model, phase, spectrum.

use super::motion::Motion;
use crate::picture::{Axis, Figure, Mark, Panel, Series};
use formats::trace::{SERIES, around};

/// Places of time, height of the tip and contact force in a series.
const TIME: usize = 0;
const TIP_Y: usize = 5;
const FORCE: usize = 6;
/// Instants of a spectrum.
const SAMPLES: usize = 512;
/// Lines of a spectrum that are shown.
const LINES: usize = 64;

/// Points of a curve.
type Points = Vec<(f64, f64)>;

/// A row of panels for each motion.
pub fn figure(motions: &[Motion]) -> Figure {
    let panels = motions.iter().flat_map(panels).collect();
    Figure { title: "Motions".into(), panels, columns: 4 }
}

fn panels(motion: &Motion) -> [Panel; 4] {
    let title = motion.name.clone();
    let all = [("finite elements", &motion.truth), ("model", &motion.moving), ("static", &motion.still)];
    let panel = |x: &str, y: &str, count: usize, of: &dyn Fn(&[[f64; SERIES]]) -> Points| Panel {
        title: title.clone(),
        x: Axis::linear(x),
        y: Axis::linear(y),
        series: all[..count]
            .iter()
            .enumerate()
            .map(|(colour, (name, rows))| Series {
                name: (*name).into(),
                colour,
                mark: Mark::Line,
                points: of(rows),
            })
            .collect(),
        map: None,
    };
    let over_time = |at: usize| {
        move |rows: &[[f64; SERIES]]| -> Points { rows.iter().map(|row| (row[TIME], row[at])).collect() }
    };
    [
        panel("time [s]", "tip y [mm]", 3, &over_time(TIP_Y)),
        panel("time [s]", "contact force [N]", 3, &over_time(FORCE)),
        panel("tip y [mm]", "rate of tip y [mm/s]", 2, &phase),
        panel("frequency [Hz]", "amplitude of tip y [mm]", 2, &spectrum),
    ]
}

/// Position and rate between neighbouring instants.
fn phase(rows: &[[f64; SERIES]]) -> Points {
    let between = |pair: &[[f64; SERIES]]| {
        let [a, b] = [pair[0], pair[1]];
        (0.5 * (a[TIP_Y] + b[TIP_Y]), (b[TIP_Y] - a[TIP_Y]) / (b[TIME] - a[TIME]))
    };
    rows.windows(2).map(between).collect()
}

/// Amplitudes of the tip's height about its straight line between the ends, with a Hann window.
fn spectrum(rows: &[[f64; SERIES]]) -> Points {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Vec::new() };
    let length_s = last[TIME] - first[TIME];
    let at = |k: usize| {
        let t_s = first[TIME] + length_s * k as f64 / SAMPLES as f64;
        let ([a, b], part) = around(rows, |row| row[TIME], t_s);
        let share = k as f64 / SAMPLES as f64;
        let line = first[TIP_Y] + share * (last[TIP_Y] - first[TIP_Y]);
        let window = 1.0 - (std::f64::consts::TAU * share).cos();
        window * (a[TIP_Y] + part * (b[TIP_Y] - a[TIP_Y]) - line)
    };
    let values: Vec<f64> = (0..SAMPLES).map(at).collect();
    let line = |n: usize| {
        let turn = std::f64::consts::TAU * n as f64 / SAMPLES as f64;
        let sums = values.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, v)| {
            let (sin, cos) = (turn * k as f64).sin_cos();
            (re + v * cos, im + v * sin)
        });
        (n as f64 / length_s, 2.0 * sums.0.hypot(sums.1) / SAMPLES as f64)
    };
    (1..LINES).map(line).collect()
}
