//! Samples fill their box.

use fem::sample::{grid, latin_hypercube, onset, sequence};
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
fn leading_parts_of_a_sequence_fill_the_box() {
    let bounds = [[0.0, 1.0]; 7];
    let points = sequence(400, &bounds, 3);
    assert_eq!(points[..100], sequence(100, &bounds, 3)[..]);
    assert_ne!(points[0], sequence(1, &bounds, 4)[0]);
    for n in [16, 50, 100, 400] {
        for d in 0..7 {
            let below = points[..n].iter().filter(|p| p[d] < 0.5).count();
            assert!(below.abs_diff(n / 2) <= 2 + n / 50, "{below} of {n} in the lower half of dimension {d}");
        }
    }
}

/// Least distance of two points.
fn nearest(points: &[Vec<f64>]) -> f64 {
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| distance(a, b)));
    pairs.fold(f64::INFINITY, f64::min)
}

#[test]
fn exchanges_increase_the_smallest_distance() {
    let bounds = [[0.0, 1.0], [0.0, 1.0]];
    let chosen = nearest(&latin_hypercube(30, &bounds, 1));
    let mut rng = Rng::new(1);
    let chance: f64 = (0..100)
        .map(|_| {
            let mut order: Vec<usize> = (0..30).collect();
            rng.shuffle(&mut order);
            let middle = |i: usize| (i as f64 + 0.5) / 30.0;
            let points: Vec<_> = order.iter().enumerate().map(|(i, j)| vec![middle(i), middle(*j)]).collect();
            nearest(&points)
        })
        .sum::<f64>()
        / 100.0;
    assert!(chosen > 2.0 * chance, "{chosen} against {chance} by chance");
}

#[test]
fn grid_includes_its_bounds_and_its_last_dimension_runs_fastest() {
    let points = grid(&[2, 3], &[[0.0, 1.0], [10.0, 20.0]]);
    let expected = [[0.0, 10.0], [0.0, 15.0], [0.0, 20.0], [1.0, 10.0], [1.0, 15.0], [1.0, 20.0]];
    assert_eq!(points, expected.map(Vec::from));
    assert_eq!(grid(&[1], &[[2.0, 4.0]]), [vec![3.0]]);
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
