//! The numerical parts, each against a plain second way of computing the same thing.

use faer::Mat;
use proptest::prelude::*;
use rom::config::{KernelKind, KernelSpec, Tail};
use rom::fit::{FitError, Samples, fit};
use rom::gp::maximum_likelihood;
use rom::hull::{Domain, DomainStatus};
use rom::interpolant::{KernelScratch, Metric};
use rom::pod::{Compact, PodError, decompose, truncation_error};
use rom::regime::{Onset, OnsetTable};

const KERNELS: [(KernelKind, Tail); 8] = [
    (KernelKind::Linear, Tail::None),
    (KernelKind::Linear, Tail::Constant),
    (KernelKind::ThinPlate, Tail::Linear),
    (KernelKind::Cubic, Tail::Linear),
    (KernelKind::Quintic, Tail::Quadratic),
    (KernelKind::Gaussian { shape: 5.0 }, Tail::Constant),
    (KernelKind::Matern52, Tail::Linear),
    (KernelKind::Matern72 { length: 2.0 }, Tail::Linear),
];

/// Scattered points of the unit square (a Kronecker sequence).
fn points(n: usize) -> Vec<[f64; 2]> {
    (1..=n).map(|i| [(i as f64 * 0.754_877_666).fract(), (i as f64 * 0.569_840_291).fract()]).collect()
}

fn smooth(x: [f64; 2]) -> f64 {
    (2.0 * x[0]).sin() + x[0] * x[1] * x[1] + 0.3 * (3.0 * x[1]).cos()
}

fn samples<'a>(inputs: &'a [[f64; 2]], values: &'a [f64]) -> Samples<'a> {
    Samples { dimensions: 2, inputs, values, outputs: 1 }
}

#[test]
fn closed_form_leave_one_out_is_leaving_one_out() {
    let inputs = points(25);
    let values: Vec<f64> = inputs.iter().map(|x| smooth(*x)).collect();
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        for smoothing in [0.0, 1e-3] {
            let all =
                fit(&samples(&inputs, &values), spec, Metric { scale: [1.0, 0.7], shear: -0.3 }, smoothing)
                    .expect("fits");
            for i in [0, 7, 24] {
                let rest: Vec<usize> = (0..25).filter(|j| *j != i).collect();
                let (x, y): (Vec<_>, Vec<_>) = rest.iter().map(|&j| (inputs[j], values[j])).unzip();
                // The ridge is relative to the largest kernel value, which the left-out point may hold.
                let Ok(without) =
                    fit(&samples(&x, &y), spec, Metric { scale: [1.0, 0.7], shear: -0.3 }, smoothing)
                else {
                    panic!("fits")
                };
                let left_out = values[i] - without.interpolant.values_at(inputs[i])[0];
                let tolerance = if smoothing > 0.0 { 4e-2 * left_out.abs().max(1e-3) } else { 1e-8 };
                assert!(
                    (all.residuals[i] - left_out).abs() < tolerance,
                    "{kernel:?} {i}: {} {left_out}",
                    all.residuals[i]
                );
            }
        }
    }
}

#[test]
fn interpolants_pass_through_their_samples_and_reproduce_their_tails() {
    let inputs = points(30);
    let plane = |x: [f64; 2]| 3.0 - 2.0 * x[0] + 0.5 * x[1];
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        let values: Vec<f64> = inputs.iter().map(|x| smooth(*x)).collect();
        let through = fit(&samples(&inputs, &values), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
        for (x, y) in inputs.iter().zip(&values) {
            assert!((through.values_at(*x)[0] - y).abs() < 1e-9, "{kernel:?}");
        }
        if matches!(tail, Tail::Linear | Tail::Quadratic) {
            let values: Vec<f64> = inputs.iter().map(|x| plane(*x)).collect();
            let flat =
                fit(&samples(&inputs, &values), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
            for x in [[0.31, 0.77], [1.4, -0.2]] {
                assert!((flat.values_at(x)[0] - plane(x)).abs() < 1e-8, "{kernel:?} at {x:?}");
            }
        }
    }
}

/// A kernel without tail does not know what a constant is: the paper's method at the edge of its samples.
#[test]
fn a_tail_less_linear_spline_misses_a_constant() {
    let inputs = points(30);
    let spec = KernelSpec { kernel: KernelKind::Linear, tail: Tail::None };
    let constant =
        fit(&samples(&inputs, &[1000.0; 30]), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
    let at_edge = constant.values_at([-0.1, -0.1])[0];
    assert!((at_edge - 1000.0).abs() > 1.0, "{at_edge}");
}

#[test]
fn singular_systems_are_refused_with_the_reason() {
    let spec = KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear };
    let refuse = |inputs: &[[f64; 2]]| {
        let values = vec![1.0; inputs.len()];
        fit(&samples(inputs, &values), spec, Metric::IDENTITY, 0.0).expect_err("refused")
    };
    assert_eq!(refuse(&[]), FitError::Empty);
    assert_eq!(
        refuse(&[[0.1, 0.2], [0.5, 0.5], [0.9, 0.1], [0.5, 0.5]]),
        FitError::Coincident { first: 1, second: 3 }
    );
    let line: Vec<[f64; 2]> = (0..6).map(|i| [0.1 * f64::from(i), 0.2 * f64::from(i)]).collect();
    assert!(matches!(refuse(&line), FitError::TailUndetermined { samples: 6, .. }));
}

#[test]
fn maximum_likelihood_finds_which_input_matters() {
    let inputs = points(60);
    let values: Vec<f64> = inputs.iter().map(|x| (6.0 * x[0]).sin() + 0.05 * x[1]).collect();
    let lengths = maximum_likelihood(&samples(&inputs, &values), Tail::Linear).expect("found");
    assert!(lengths.metric[0] > 3.0 * lengths.metric[1], "{lengths:?}");
}

#[test]
fn pod_gives_back_the_snapshots_and_orthonormal_modes() {
    let y =
        Mat::from_fn(300, 12, |i, j| ((i * (j + 1)) as f64 * 0.01).sin() * 10.0_f64.powi(-(j as i32)) + 50.0);
    let compact = Compact::new(y.clone(), true).expect("decomposes");
    let pod = decompose(compact.r.as_ref()).expect("decomposes");
    let modes = compact.modes(&pod, pod.rank);
    let gram = modes.transpose() * &modes - Mat::<f64>::identity(pod.rank, pod.rank);
    assert!(gram.norm_max() < 1e-12, "modes are not orthonormal");
    let a = pod.u.transpose() * &compact.r;
    let back = &modes * &a;
    for j in 0..12 {
        for i in 0..300 {
            assert!((back[(i, j)] + compact.mean[i] - y[(i, j)]).abs() < 1e-11);
        }
    }
    assert!(pod.singular_values.windows(2).all(|s| s[0] >= s[1]));
    let energy: f64 = pod.singular_values.iter().map(|s| s * s).sum();
    let expected: f64 = pod.singular_values[3..].iter().map(|s| s * s).sum::<f64>() / energy;
    assert!((pod.truncation_error(3) / expected - 1.0).abs() < 1e-12);
    assert_eq!(pod.modes_for_energy(expected * 1.001), 3);
}

/// The method of snapshots (eigenvalues of `Y^T Y`) loses everything under 1e-8 of the largest; QR keeps 14 decades.
#[test]
fn small_singular_values_survive() {
    let y = Mat::from_fn(64, 8, |i, j| if i / 8 == j { 10.0_f64.powi(-2 * j as i32) } else { 0.0 });
    let compact = Compact::new(y, false).expect("decomposes");
    let pod = decompose(compact.r.as_ref()).expect("decomposes");
    for (k, s) in pod.singular_values.iter().enumerate().take(7) {
        let expected = 8.0_f64.sqrt() * 10.0_f64.powi(-2 * k as i32);
        assert!((s / expected - 1.0).abs() < 1e-2, "{k}: {s:e}");
    }
    assert_eq!(truncation_error(&[], 0), 0.0);
    assert_eq!(Compact::new(Mat::zeros(4, 0), true).err(), Some(PodError::Empty));
}

#[test]
fn the_onset_table_is_monotone_and_its_slope_is_its_derivative() {
    let gaps = vec![20.0, 23.0, 30.0, 31.0, 50.0];
    let table = OnsetTable::new(gaps, vec![0.0, 0.004, 0.02, 0.021, 0.09]);
    assert_eq!(table.onset(20.0), Onset::Always);
    assert_eq!(table.onset(50.1), Onset::Never);
    let mut last = f64::NEG_INFINITY;
    for i in 0..4000 {
        let gap = 15.0 + 0.01 * f64::from(i);
        let (p, slope) = table.pressure_and_slope(gap);
        assert!(p > last, "not increasing at {gap} mm");
        last = p;
        let h = 1e-5;
        let numeric = (table.pressure_and_slope(gap + h).0 - table.pressure_and_slope(gap - h).0) / (2.0 * h);
        assert!((slope - numeric).abs() < 1e-6, "slope at {gap} mm: {slope} {numeric}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn the_hull_holds_its_points_and_measures_the_way_out(
        points in prop::collection::vec([0.0..1.0_f64, 0.0..1.0_f64], 3..40),
        angle in 0.0..6.3_f64,
        far in 0.01..3.0_f64,
    ) {
        let domain = Domain::hull_of(&points);
        for p in &points {
            prop_assert!(domain.distance(*p) < 1e-12, "{:?} is outside its own hull", p);
        }
        let way = [angle.cos(), angle.sin()];
        let along = |p: &[f64; 2]| p[0] * way[0] + p[1] * way[1];
        let tip = points.iter().copied().max_by(|a, b| along(a).total_cmp(&along(b))).expect("points");
        let outside = [tip[0] + far * way[0], tip[1] + far * way[1]];
        // The supporting line is `far` away, and the tip itself no farther.
        prop_assert!((domain.distance(outside) - far).abs() < 1e-9);
        prop_assert!(Domain::status(far) != DomainStatus::Inside);
    }

    #[test]
    fn gradients_of_interpolants_are_their_derivatives(x in 0.05..0.95_f64, y in 0.05..0.95_f64, which in 2..8_usize) {
        let inputs = points(20);
        let values: Vec<f64> = inputs.iter().map(|x| smooth(*x)).collect();
        let (kernel, tail) = KERNELS[which];
        let fitted = fit(&samples(&inputs, &values), KernelSpec { kernel, tail }, Metric { scale: [1.3, 0.6], shear: 0.4 }, 0.0).expect("fits").interpolant;
        let (mut value, mut dx, mut dy) = ([0.0], [0.0], [0.0]);
        fitted.evaluate([x, y], &mut KernelScratch::new(20), &mut value, &mut dx, &mut dy);
        let h = 1e-5;
        let at = |x: f64, y: f64| fitted.values_at([x, y])[0];
        prop_assert!((dx[0] - (at(x + h, y) - at(x - h, y)) / (2.0 * h)).abs() < 1e-5 * (1.0 + dx[0].abs()));
        prop_assert!((dy[0] - (at(x, y + h) - at(x, y - h)) / (2.0 * h)).abs() < 1e-5 * (1.0 + dy[0].abs()));
    }
}
