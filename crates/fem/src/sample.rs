//! Sampling of states: Latin hypercubes, grids, and points along the contact onset.

use rom::rng::Rng;

/// Box to sample, one `[lower, upper]` per dimension.
pub type Bounds = [[f64; 2]];

/// Number of random hypercubes from which the best start is chosen.
const STARTS: usize = 50;
/// Exchanges tried per point of the best start.
const EXCHANGES_PER_POINT: usize = 200;

/// A Latin hypercube of `n` points: every one of `n` equal slices of every dimension holds exactly one point, at its
/// middle. Space-filling: the smallest distance between two points (in the unit box) is made large, first by choosing
/// among random hypercubes, then by exchanging coordinates (maximin, Morris and Mitchell 1995). `O(n^2)` per exchange.
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

/// First `n` points of a low-discrepancy sequence; every leading part of it fills the box evenly too.
///
/// The additive recurrence with the powers of the generalised golden ratio `phi^(d+1) = phi + 1` (Roberts 2018), from a
/// random first point. `O(n)`.
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
pub fn grid(counts: &[usize], bounds: &Bounds) -> Vec<Vec<f64>> {
    let mut points = vec![Vec::new()];
    for (count, [low, high]) in counts.iter().zip(bounds) {
        let fraction = |i: usize| if *count == 1 { 0.5 } else { i as f64 / (*count - 1) as f64 };
        let values: Vec<f64> = (0..*count).map(|i| low + fraction(i) * (high - low)).collect();
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

/// Lowest pressure (MPa) at which the clearance reaches `gap` (mm); `table` as the clearances of [`onset`], by rising pressure.
pub fn onset_pressure_mpa(table: &[(f64, f64)], gap: f64) -> Option<f64> {
    let pair = table.windows(2).find(|w| w[0].1 <= gap && gap <= w[1].1)?;
    let [(p0, c0), (p1, c1)] = [pair[0], pair[1]];
    Some(if c1 > c0 { p0 + (p1 - p0) * (gap - c0) / (c1 - c0) } else { p0 })
}
