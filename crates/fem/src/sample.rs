//! Where to compute states: Latin hypercubes, grids, points along the onset of contact, and where a model has its largest errors.

use rom::rng::Rng;

/// A box to sample, one `[lower, upper]` a dimension.
pub type Bounds = [[f64; 2]];

/// Random hypercubes among which the best start is chosen.
const STARTS: usize = 50;
/// Exchanges tried for each point of the best start.
const EXCHANGES_PER_POINT: usize = 200;

/// A Latin hypercube of `n` points: every one of `n` equal slices of every dimension holds exactly one point, at its
/// middle. Space-filling: the smallest distance between two points (in the unit box) is made large, first by choosing
/// among random hypercubes, then by exchanging coordinates (maximin, Morris and Mitchell 1995). `O(n^2)` an exchange.
#[must_use]
pub fn latin_hypercube(n: usize, bounds: &Bounds, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = Rng::new(seed);
    let random = |rng: &mut Rng| -> Vec<Vec<f64>> {
        let mut columns: Vec<Vec<usize>> = bounds.iter().map(|_| (0..n).collect()).collect();
        columns.iter_mut().for_each(|c| rng.shuffle(c));
        (0..n).map(|i| columns.iter().map(|c| (c[i] as f64 + 0.5) / n as f64).collect()).collect()
    };
    let starts: Vec<_> = (0..STARTS).map(|_| random(&mut rng)).collect();
    let best = starts.into_iter().map(|p| (spacing(&p), p)).max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((mut space, mut points)) = best.filter(|_| n > 1) else {
        return vec![bounds.iter().map(|[low, high]| 0.5 * (low + high)).collect(); n];
    };
    for _ in 0..EXCHANGES_PER_POINT * n {
        let (a, b, dimension) = (rng.below(n), rng.below(n), rng.below(bounds.len()));
        exchange(&mut points, a, b, dimension);
        let trial = spacing(&points);
        if trial >= space {
            space = trial;
        } else {
            exchange(&mut points, a, b, dimension);
        }
    }
    points.into_iter().map(|p| scaled(&p, bounds)).collect()
}

/// The first `n` points of a sequence of low discrepancy: every first part of it fills the box evenly too.
///
/// The additive recurrence with the powers of the generalised golden ratio `phi^(d+1) = phi + 1` (Roberts 2018), from a
/// random first point. `O(n)`.
#[must_use]
pub fn sequence(n: usize, bounds: &Bounds, seed: u64) -> Vec<Vec<f64>> {
    let mut ratio = 2.0_f64;
    for _ in 0..64 {
        ratio = (1.0 + ratio).powf(1.0 / (bounds.len() as f64 + 1.0));
    }
    let mut rng = Rng::new(seed);
    let first: Vec<f64> = bounds.iter().map(|_| rng.uniform()).collect();
    let coordinate = |i: usize, d: usize| (first[d] + i as f64 * ratio.powi(-(d as i32) - 1)).fract();
    (0..n).map(|i| scaled(&(0..bounds.len()).map(|d| coordinate(i, d)).collect::<Vec<_>>(), bounds)).collect()
}

fn exchange(points: &mut [Vec<f64>], a: usize, b: usize, dimension: usize) {
    let value = points[a][dimension];
    points[a][dimension] = points[b][dimension];
    points[b][dimension] = value;
}

/// Smallest squared distance between two points.
fn spacing(points: &[Vec<f64>]) -> f64 {
    let squared = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>();
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| squared(a, b)));
    pairs.fold(f64::INFINITY, f64::min)
}

fn scaled(unit: &[f64], bounds: &Bounds) -> Vec<f64> {
    unit.iter().zip(bounds).map(|(u, [low, high])| low + u * (high - low)).collect()
}

/// A full grid with `counts[d]` points in dimension `d`, both bounds included (the middle when there is one point);
/// the last dimension runs fastest.
#[must_use]
pub fn grid(counts: &[usize], bounds: &Bounds) -> Vec<Vec<f64>> {
    let mut points = vec![Vec::new()];
    for (count, [low, high]) in counts.iter().zip(bounds) {
        let at = |i: usize| if *count == 1 { 0.5 } else { i as f64 / (*count - 1) as f64 };
        let values: Vec<f64> = (0..*count).map(|i| low + at(i) * (high - low)).collect();
        points = points
            .into_iter()
            .flat_map(|p: Vec<f64>| values.iter().map(move |v| [p.as_slice(), &[*v]].concat()))
            .collect();
    }
    points
}

/// `n` points `[pressure, gap]` along the onset of contact, evenly spread over the gaps.
///
/// `clearances` are free states as (pressure in MPa, distance at which an obstacle just clears them in mm), in any
/// order. While pressure rises the actuator bends away from its base, so the onset pressure of a gap is where the
/// clearance first reaches it. Empty when fewer than two states are given or none of the gaps is reached.
#[must_use]
pub fn onset(n: usize, clearances: &[(f64, f64)], gaps: [f64; 2]) -> Vec<Vec<f64>> {
    let mut table = clearances.to_vec();
    table.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(first), Some(reach)) = (table.first(), table.iter().map(|t| t.1).reduce(f64::max)) else {
        return Vec::new();
    };
    let (low, high) = (gaps[0].max(first.1), gaps[1].min(reach));
    if table.len() < 2 || low >= high {
        return Vec::new();
    }
    let gaps = grid(&[n], &[[low, high]]);
    gaps.iter().filter_map(|gap| Some(vec![onset_pressure_mpa(&table, gap[0])?, gap[0]])).collect()
}

/// A sample and the error there of a model trained without it, in any unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InfillError {
    /// Scaled inputs.
    pub at: [f64; 2],
    /// Leave-one-out error, 0 or more.
    pub error: f64,
}

/// Indices of the `n` candidates (fewer when there are fewer) with the largest expected error, largest first.
///
/// One after another: the candidate with the largest `(error of the nearest sample) x (distance to it)`, as in
/// cross-validation Voronoi sampling. A chosen one is then a sample with its neighbour's error, so that the next goes
/// elsewhere. `O(n x candidates x samples)`.
#[must_use]
pub fn infill(n: usize, samples: &[InfillError], candidates: &[[f64; 2]]) -> Vec<usize> {
    let mut samples = samples.to_vec();
    let mut chosen = Vec::new();
    for _ in 0..n.min(candidates.len()) {
        let expected = |at: &[f64; 2]| -> Option<(f64, f64)> {
            let distance = |s: &InfillError| (s.at[0] - at[0]).hypot(s.at[1] - at[1]);
            let nearest = samples.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            Some((nearest.error * distance(nearest), nearest.error))
        };
        let open = (0..candidates.len()).filter(|i| !chosen.contains(i));
        let best = open
            .filter_map(|i| expected(&candidates[i]).map(|(expected, error)| (i, expected, error)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((index, _, error)) = best else { break };
        samples.push(InfillError { at: candidates[index], error });
        chosen.push(index);
    }
    chosen
}

/// Lowest pressure (MPa) at which the clearance reaches `gap` (mm); `table` as the clearances of [`onset`], by rising pressure.
#[must_use]
pub fn onset_pressure_mpa(table: &[(f64, f64)], gap: f64) -> Option<f64> {
    let pair = table.windows(2).find(|w| w[0].1 <= gap && gap <= w[1].1)?;
    let [(p0, c0), (p1, c1)] = [pair[0], pair[1]];
    Some(if c1 > c0 { p0 + (p1 - p0) * (gap - c0) / (c1 - c0) } else { p0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rom::rng::Rng;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn every_slice_of_every_dimension_holds_one_point(n in 1..25_usize, seed in any::<u64>()) {
            let bounds = [[0.0, 0.09], [10.0, 50.0]];
            let points = latin_hypercube(n, &bounds, seed);
            prop_assert_eq!(points.len(), n);
            for (d, [low, high]) in bounds.into_iter().enumerate() {
                let mut slices: Vec<usize> =
                    points.iter().map(|p| ((p[d] - low) / (high - low) * n as f64) as usize).collect();
                slices.sort_unstable();
                prop_assert_eq!(slices, (0..n).collect::<Vec<_>>());
            }
            prop_assert_eq!(&points, &latin_hypercube(n, &bounds, seed));
        }
    }

    #[test]
    fn every_first_part_of_a_sequence_fills_the_box() {
        let bounds = [[0.0, 1.0]; 7];
        let points = sequence(400, &bounds, 3);
        assert_eq!(points[..100], sequence(100, &bounds, 3)[..]);
        assert_ne!(points[0], sequence(1, &bounds, 4)[0]);
        for n in [16, 50, 100, 400] {
            for d in 0..7 {
                let below = points[..n].iter().filter(|p| p[d] < 0.5).count();
                assert!(
                    below.abs_diff(n / 2) <= 2 + n / 50,
                    "{below} of {n} in the lower half of dimension {d}"
                );
            }
        }
    }

    #[test]
    fn exchanges_spread_the_points_better_than_chance() {
        let bounds = [[0.0, 1.0], [0.0, 1.0]];
        let chosen = spacing(&latin_hypercube(30, &bounds, 1)).sqrt();
        let mut rng = Rng::new(1);
        let chance: f64 = (0..100)
            .map(|_| {
                let mut order: Vec<usize> = (0..30).collect();
                rng.shuffle(&mut order);
                let middle = |i: usize| (i as f64 + 0.5) / 30.0;
                let points: Vec<_> =
                    order.iter().enumerate().map(|(i, j)| vec![middle(i), middle(*j)]).collect();
                spacing(&points).sqrt()
            })
            .sum::<f64>()
            / 100.0;
        assert!(chosen > 2.0 * chance, "{chosen} against {chance} by chance");
    }

    #[test]
    fn a_grid_has_its_bounds_and_the_last_dimension_runs_fastest() {
        let points = grid(&[2, 3], &[[0.0, 1.0], [10.0, 20.0]]);
        let expected = [[0.0, 10.0], [0.0, 15.0], [0.0, 20.0], [1.0, 10.0], [1.0, 15.0], [1.0, 20.0]];
        assert_eq!(points, expected.map(Vec::from));
        assert_eq!(grid(&[1], &[[2.0, 4.0]]), [vec![3.0]]);
    }

    #[test]
    fn infill_adds_samples_at_large_errors_and_then_elsewhere() {
        let sample = |x: f64, error| InfillError { at: [x, 0.0], error };
        let samples = [sample(0.0, 1.0), sample(0.5, 4.0), sample(1.0, 1.0)];
        let candidates: Vec<[f64; 2]> = (0..=100).map(|i| [f64::from(i) / 100.0, 0.0]).collect();
        let chosen = infill(3, &samples, &candidates);
        let places: Vec<f64> = chosen.iter().map(|i| candidates[*i][0]).collect();
        assert!(places[..2].iter().all(|x| (x - 0.5).abs() > 0.2 && (x - 0.5).abs() < 0.26), "{places:?}");
        assert!((places[0] - 0.5) * (places[1] - 0.5) < 0.0, "both sides of the bad sample: {places:?}");
        assert_eq!(infill(5, &samples, &candidates[..2]).len(), 2);
        assert!(infill(5, &[], &candidates).is_empty());
    }

    #[test]
    fn onset_points_lie_on_the_curve_within_reach() {
        let clearance = |p: f64| 27.0 + 1000.0 * p;
        let table: Vec<(f64, f64)> = [0.0, 0.03, 0.01, 0.02].map(|p| (p, clearance(p))).to_vec();
        let points = onset(5, &table, [10.0, 50.0]);
        assert_eq!(points.len(), 5);
        assert!(points.iter().all(|p| (clearance(p[0]) - p[1]).abs() < 1e-9), "{points:?}");
        assert_eq!((points[0][1], points[4][1]), (27.0, 50.0));
        assert!(onset(5, &table, [60.0, 80.0]).is_empty());
        assert!(onset(5, &[], [10.0, 50.0]).is_empty());
    }
}
