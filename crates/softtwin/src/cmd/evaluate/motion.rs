//! Series of one motion.

use formats::trace::SERIES;

/// Series of one motion at the same instants.
pub struct Motion {
    /// Name: that of its folder.
    pub name: String,
    /// Finite elements.
    pub truth: Vec<[f64; SERIES]>,
    /// Model.
    pub moving: Vec<[f64; SERIES]>,
    /// Model without inertia.
    pub still: Vec<[f64; SERIES]>,
}

/// Places of pressure and y of the tip in a series.
const PRESSURE: usize = 1;
const TIP_Y: usize = 5;

/// Smallest swing, as a fraction of the range of the tip's height.
const LEAST_SWING: f64 = 0.01;

/// Frequency of the tip's swing after the last change of the pressure, Hz, by its extrema, refined by parabolas. `None` with fewer than two, or
/// where it hardly swings.
pub fn frequency_hz(rows: &[[f64; SERIES]]) -> Option<f64> {
    let last = rows.last()?[PRESSURE];
    let begin = rows.iter().rposition(|row| row[PRESSURE] != last).map_or(0, |at| at + 1);
    let span = |rows: &[[f64; SERIES]]| {
        let heights = rows.iter().map(|row| row[TIP_Y]);
        heights.clone().fold(f64::NEG_INFINITY, f64::max) - heights.fold(f64::INFINITY, f64::min)
    };
    if span(&rows[begin..]) < LEAST_SWING * span(rows) {
        return None;
    }
    let mut extrema = Vec::new();
    for three in rows[begin..].windows(3) {
        let [before, after] = [three[1][TIP_Y] - three[0][TIP_Y], three[2][TIP_Y] - three[1][TIP_Y]];
        if before * after < 0.0 {
            // The slope passes 0 between the middles of both intervals.
            let [from_s, to_s] = [three[1][0] - three[0][0], three[2][0] - three[1][0]];
            let (first, second) = (before / from_s, after / to_s);
            let middle_s = three[1][0] - 0.5 * from_s;
            extrema.push(middle_s + 0.5 * (from_s + to_s) * first / (first - second));
        }
    }
    let (first, end) = (extrema.first()?, extrema.last()?);
    (end > first).then(|| 0.5 * (extrema.len() - 1) as f64 / (end - first))
}
