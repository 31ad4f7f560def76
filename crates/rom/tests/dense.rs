//! Small dense systems: solutions put back into the system, and systems without one.

use proptest::prelude::*;
use rom::dense::Dense;

/// `A X` of a right-hand side of `columns` columns.
fn product(a: &Dense, x: &[f64], columns: usize) -> Vec<f64> {
    let n = a.size();
    let entry = |i: usize, k: usize| (0..n).map(|j| a[(i, j)] * x[j * columns + k]).sum();
    (0..n).flat_map(|i| (0..columns).map(move |k| (i, k))).map(|(i, k)| entry(i, k)).collect()
}

proptest! {
    #[test]
    fn solution_reproduces_the_right_hand_side(
        n in 1_usize..12,
        columns in 1_usize..4,
        entries in prop::collection::vec(-1.0_f64..1.0, 144),
        right in prop::collection::vec(-1.0_f64..1.0, 48),
    ) {
        let a = Dense::from_fn(n, |i, j| entries[i * 12 + j]);
        let right = &right[..n * columns];
        let mut x = right.to_vec();
        prop_assert!(a.clone().solve(&mut x, columns).is_some());
        let largest = x.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
        for (found, expected) in product(&a, &x, columns).iter().zip(right) {
            // Backward stable: what is left is small beside the solution, however ill-conditioned the system is.
            prop_assert!((found - expected).abs() <= 1e-12 * largest, "{found} {expected} {largest}");
        }
    }
}

#[test]
fn system_with_zero_on_the_diagonal_is_solved() {
    let saddle = Dense::from_fn(3, |i, j| [[0.0, 2.0, 1.0], [2.0, 0.0, 1.0], [1.0, 1.0, 0.0]][i][j]);
    let inverse = saddle.clone().inverse().expect("regular");
    let columns: Vec<f64> = (0..9).map(|at| inverse[(at / 3, at % 3)]).collect();
    for (at, found) in product(&saddle, &columns, 3).into_iter().enumerate() {
        let expected = if at % 4 == 0 { 1.0 } else { 0.0 };
        assert!((found - expected).abs() < 1e-15, "{at}: {found}");
    }
}

#[test]
fn singular_system_returns_none() {
    assert_eq!(Dense::from_fn(2, |_, j| j as f64).inverse(), None);
    assert_eq!(Dense::from_fn(2, |i, j| if i == j { f64::NAN } else { 1.0 }).inverse(), None);
    assert_eq!(Dense::zeros(1).solve(&mut [1.0], 1), None);
}
