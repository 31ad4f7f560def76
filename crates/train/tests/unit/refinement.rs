//! Tests of `src/refinement.rs`.

use super::*;

#[test]
fn infill_adds_samples_at_large_errors_then_elsewhere() {
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
