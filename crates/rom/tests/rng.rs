//! The generator: its published sequence, its distributions.

use rom::rng::Rng;

#[test]
fn sequence_matches_the_published_one() {
    // First outputs of SplitMix64 for seed 1234567, as listed with the reference implementation.
    let mut rng = Rng::new(1_234_567);
    assert_eq!(rng.next_u64(), 6_457_827_717_110_365_317);
    assert_eq!(rng.next_u64(), 3_203_168_211_198_807_973);
}

#[test]
fn normal_deviates_have_mean_zero_and_variance_one() {
    let mut rng = Rng::new(1);
    let n = 20_000;
    let values: Vec<f64> = (0..n).map(|_| rng.normal()).collect();
    let mean = values.iter().sum::<f64>() / f64::from(n);
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(n);
    assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "mean {mean}, variance {variance}");
}

#[test]
fn shuffle_keeps_every_item() {
    let mut items: Vec<usize> = (0..50).collect();
    Rng::new(3).shuffle(&mut items);
    assert_ne!(items, (0..50).collect::<Vec<_>>());
    items.sort_unstable();
    assert_eq!(items, (0..50).collect::<Vec<_>>());
}
