//! The numerical parts, each against a plain second way of computing the same thing.

use faer::Mat;
use faer::linalg::solvers::Solve;
use proptest::prelude::*;
use rom::hull::{DomainStatus, TrainingRange};
use rom::inputs::Point;
use rom::interpolant::{Interpolant, Metric};
use rom::model::truncation_error;
use rom::regime::{Onset, OnsetTable};
use train::config::{KernelKind, KernelSpec, ModeChoice, RegimeConfig, Tail};
use train::fit::{FitError, Samples, fit};
use train::pod::{Centre, Compact, PodError, decompose};
use train::select::{States, Task, choose};

const KERNELS: [(KernelKind, Tail); 8] = [
    (KernelKind::Linear, Tail::None),
    (KernelKind::Linear, Tail::Constant),
    (KernelKind::ThinPlate, Tail::Linear),
    (KernelKind::Cubic, Tail::Linear),
    (KernelKind::Quintic, Tail::Quadratic),
    (KernelKind::Gaussian { shape: 5.0 }, Tail::Constant),
    (KernelKind::Matern72 { length: 2.0 }, Tail::Linear),
    (KernelKind::CubicQuintic { crossover: 0.4 }, Tail::Quadratic),
];

/// A metric that stretches and shears two inputs.
const ASLANT: Metric = Metric { scale: [1.3, 0.6, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], shear: 0.4 };

/// Scaled inputs from those in use.
fn point<const D: usize>(x: [f64; D]) -> Point {
    let mut point = Point::default();
    point[..D].copy_from_slice(&x);
    point
}

/// Scattered points of the unit square (a Kronecker sequence).
fn points(n: usize) -> Vec<Point> {
    (1..=n).map(|i| point([(i as f64 * 0.754_877_666).fract(), (i as f64 * 0.569_840_291).fract()])).collect()
}

fn smooth(x: &Point) -> f64 {
    (2.0 * x[0]).sin() + x[0] * x[1] * x[1] + 0.3 * (3.0 * x[1]).cos()
}

fn samples<'a>(inputs: &'a [Point], values: &'a [f64]) -> Samples<'a> {
    Samples { dimensions: 2, inputs, values, outputs: 1, slopes: &[], slope_values: &[], exact: None }
}

#[test]
fn closed_form_leave_one_out_matches_refitting() {
    let inputs = points(25);
    let values: Vec<f64> = inputs.iter().map(smooth).collect();
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        for smoothing in [0.0, 1e-3] {
            let all = fit(&samples(&inputs, &values), spec, ASLANT, smoothing).expect("fits");
            for i in [0, 7, 24] {
                let rest: Vec<usize> = (0..25).filter(|j| *j != i).collect();
                let (x, y): (Vec<_>, Vec<_>) = rest.iter().map(|&j| (inputs[j], values[j])).unzip();
                // The ridge is relative to the largest kernel value, which the left-out point may hold.
                let Ok(without) = fit(&samples(&x, &y), spec, ASLANT, smoothing) else { panic!("fits") };
                let left_out = values[i] - without.interpolant.values_at(&inputs[i])[0];
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

/// Prediction at `x` of the interpolant of these samples, from its equations; `None` where they are singular.
fn refitted(spec: KernelSpec, dimensions: usize, inputs: &[Point], values: &[f64], x: &Point) -> Option<f64> {
    let (n, q) = (inputs.len(), spec.tail.terms(dimensions));
    let terms: Vec<Vec<f64>> = inputs.iter().map(|c| spec.tail.values(dimensions, c)).collect();
    let kernel = |a: &Point, b: &Point| spec.kernel.value(rom::inputs::square_distance(a, b));
    let a = Mat::from_fn(n + q, n + q, |i, j| match (i < n, j < n) {
        (true, true) => kernel(&inputs[i], &inputs[j]),
        (true, false) => terms[i][j - n],
        (false, true) => terms[j][i - n],
        (false, false) => 0.0,
    });
    let s = a.singular_values().ok()?;
    if n < q || s[n + q - 1] < 1e-11 * s[0] {
        return None;
    }
    let b = Mat::from_fn(n + q, 1, |i, _| if i < n { values[i] } else { 0.0 });
    let w = a.full_piv_lu().solve(&b);
    let of_kernel: f64 = (0..n).map(|i| w[(i, 0)] * kernel(&inputs[i], x)).sum();
    let of_tail: f64 =
        spec.tail.values(dimensions, x).iter().enumerate().map(|(k, t)| w[(n + k, 0)] * t).sum();
    Some(of_kernel + of_tail)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    /// Random designs of one to six inputs, with as many states as the tail has terms or a few more, and designs that vary one input
    /// at a time: every residual is that of a refit, or the fit is refused because one sample cannot be left out.
    #[test]
    fn closed_form_leave_one_out_of_small_designs_is_that_of_refitting_or_refused(
        dimensions in 1_usize..=6,
        tail in prop::sample::select(vec![Tail::Constant, Tail::Linear, Tail::Quadratic]),
        extra in 0_usize..4,
        one_at_a_time in any::<bool>(),
        coordinates in prop::collection::vec(0.0_f64..1.0, 6 * 40),
    ) {
        let spec = KernelSpec { kernel: if tail == Tail::Constant { KernelKind::Linear } else { KernelKind::Cubic }, tail };
        let n = tail.terms(dimensions) + extra;
        let mut inputs: Vec<Point> = (0..n)
            .map(|i| std::array::from_fn(|d| if d < dimensions { coordinates[6 * i + d] } else { 0.0 }))
            .collect();
        if one_at_a_time {
            for (i, x) in inputs.iter_mut().enumerate() {
                (0..dimensions).filter(|d| i == 0 || *d != i % dimensions).for_each(|d| x[d] = 0.5);
            }
        }
        let values: Vec<f64> = inputs.iter().map(|x| x.iter().enumerate().map(|(k, x)| ((k + 2) as f64 * x).sin()).sum()).collect();
        let samples = Samples { dimensions, inputs: &inputs, values: &values, outputs: 1, slopes: &[], slope_values: &[], exact: None };
        let without = |i: usize| {
            let rest = |j: &usize| *j != i;
            let x: Vec<Point> = (0..n).filter(rest).map(|j| inputs[j]).collect();
            let y: Vec<f64> = (0..n).filter(rest).map(|j| values[j]).collect();
            refitted(spec, dimensions, &x, &y, &inputs[i])
        };
        match fit(&samples, spec, Metric::IDENTITY, 0.0) {
            Ok(fitted) => for (i, (value, found)) in values.iter().zip(fitted.residuals).enumerate() {
                let Some(prediction) = without(i) else { continue };
                let expected = value - prediction;
                prop_assert!((found - expected).abs() <= 1e-5 * (1.0 + expected.abs()), "{i} of {n}: {found}, refitted {expected}");
            },
            // Its leverage h on the tail is within 1e-8 of 1, and without it the smallest singular value of the tail's terms is at most
            // sqrt(1 - h) times the largest one with it: the tail is undetermined, or nearly so.
            Err(FitError::TailRestsOn { sample, .. }) => {
                let singular_values = |left_out: Option<usize>| {
                    let kept: Vec<usize> = (0..n).filter(|j| Some(*j) != left_out).collect();
                    let terms = Mat::from_fn(kept.len(), tail.terms(dimensions), |i, j| tail.values(dimensions, &inputs[kept[i]])[j]);
                    terms.singular_values().expect("finite terms")
                };
                let (all, rest) = (singular_values(None), singular_values(Some(sample)));
                let least = if n - 1 < tail.terms(dimensions) { 0.0 } else { rest[tail.terms(dimensions) - 1] };
                prop_assert!(least <= 1.01e-4 * all[0], "{least} of {}", all[0]);
            }
            Err(FitError::TailUndetermined { .. } | FitError::Coincident { .. }) => {
                prop_assert_eq!(refitted(spec, dimensions, &inputs, &values, &inputs[0]), None);
            }
            Err(error) => prop_assert!(false, "{error}"),
        }
    }
}

/// By how much an interpolant may miss its samples: that of a Matern 7/2 is smoothed a little.
fn missed(kernel: KernelKind) -> f64 {
    if matches!(kernel, KernelKind::Matern72 { .. }) { 1e-6 } else { 1e-9 }
}

#[test]
fn interpolants_pass_through_their_samples_and_reproduce_their_tails() {
    let inputs = points(30);
    let plane = |x: &Point| 3.0 - 2.0 * x[0] + 0.5 * x[1];
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        let values: Vec<f64> = inputs.iter().map(smooth).collect();
        let through = fit(&samples(&inputs, &values), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
        for (x, y) in inputs.iter().zip(&values) {
            assert!((through.values_at(x)[0] - y).abs() < missed(kernel), "{kernel:?}");
        }
        if matches!(tail, Tail::Linear | Tail::Quadratic) {
            let values: Vec<f64> = inputs.iter().map(plane).collect();
            let flat =
                fit(&samples(&inputs, &values), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
            for x in [[0.31, 0.77], [1.4, -0.2]].map(point) {
                assert!((flat.values_at(&x)[0] - plane(&x)).abs() < 1e-8, "{kernel:?} at {x:?}");
            }
        }
    }
}

/// A kernel without tail does not know what a constant is: the paper's method at the edge of its samples.
#[test]
fn linear_spline_without_tail_misses_a_constant() {
    let inputs = points(30);
    let spec = KernelSpec { kernel: KernelKind::Linear, tail: Tail::None };
    let constant =
        fit(&samples(&inputs, &[1000.0; 30]), spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
    let at_edge = constant.values_at(&point([-0.1, -0.1]))[0];
    assert!((at_edge - 1000.0).abs() > 1.0, "{at_edge}");
}

#[test]
fn singular_systems_are_refused_with_the_reason() {
    let spec = KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear };
    let refuse = |inputs: &[Point]| {
        let values = vec![1.0; inputs.len()];
        fit(&samples(inputs, &values), spec, Metric::IDENTITY, 0.0).expect_err("refused")
    };
    assert_eq!(refuse(&[]), FitError::Empty);
    assert_eq!(
        refuse(&[[0.1, 0.2], [0.5, 0.5], [0.9, 0.1], [0.5, 0.5]].map(point)),
        FitError::Coincident { first: 1, second: 3 }
    );
    let line: Vec<Point> = (0..6).map(|i| point([0.1 * f64::from(i), 0.2 * f64::from(i)])).collect();
    assert!(matches!(refuse(&line), FitError::TailUndetermined { samples: 6, .. }));
}

#[test]
fn pod_reproduces_the_snapshots_with_orthonormal_modes() {
    let y =
        Mat::from_fn(300, 12, |i, j| ((i * (j + 1)) as f64 * 0.01).sin() * 10.0_f64.powi(-(j as i32)) + 50.0);
    let compact = Compact::new(y.clone(), 0, Centre::Mean).expect("decomposes");
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
fn small_singular_values_are_kept() {
    let y = Mat::from_fn(64, 8, |i, j| if i / 8 == j { 10.0_f64.powi(-2 * j as i32) } else { 0.0 });
    let compact = Compact::new(y, 0, Centre::Origin).expect("decomposes");
    let pod = decompose(compact.r.as_ref()).expect("decomposes");
    for (k, s) in pod.singular_values.iter().enumerate().take(7) {
        let expected = 8.0_f64.sqrt() * 10.0_f64.powi(-2 * k as i32);
        assert!((s / expected - 1.0).abs() < 1e-2, "{k}: {s:e}");
    }
    assert_eq!(truncation_error(&[], 0), 0.0);
    assert_eq!(Compact::new(Mat::zeros(4, 0), 0, Centre::Mean).err(), Some(PodError::Empty));
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
        let closed = table.closed_gap_mm(p);
        assert!((closed - gap.clamp(20.0, 50.0)).abs() < 1e-9, "{p} MPa closes {closed} mm, not {gap} mm");
    }
}

/// Value and gradient at a point, by finite differences beside the analytic ones.
fn check_gradient(fit: &Interpolant, x: Point) {
    for (input, slope) in fit.gradient_at(&x).iter().map(|row| row[0]).enumerate() {
        let h = 1e-5;
        let at = |step: f64| {
            let mut x = x;
            x[input] += step;
            fit.values_at(&x)[0]
        };
        let numeric = (at(h) - at(-h)) / (2.0 * h);
        assert!(
            (slope - numeric).abs() < 1e-5 * (1.0 + slope.abs()),
            "input {input}: {slope} is not {numeric}"
        );
    }
}

/// A smooth function of five inputs, of which the first `dimensions` vary.
fn formula(x: &Point) -> f64 {
    (1.5 * x[0]).sin() + x[0] * x[1] * x[1] + 0.4 * (2.0 * x[2]).cos() - 0.3 * x[3] * x[0]
        + 0.2 * (x[4] + x[1]).exp()
}

/// Scattered points of the unit cube: multiples of square roots of primes.
fn cube(dimensions: usize, n: usize) -> Vec<Point> {
    let roots = [2.0_f64, 3.0, 5.0, 7.0, 11.0].map(f64::sqrt);
    let one = |i: usize| {
        let mut x = Point::default();
        x.iter_mut().zip(roots).take(dimensions).for_each(|(x, root)| *x = (i as f64 * root).fract());
        x
    };
    (1..=n).map(one).collect()
}

#[test]
fn three_to_five_inputs_are_interpolated_with_their_gradients() {
    for dimensions in 3..=5 {
        let inputs = cube(dimensions, 220);
        let values: Vec<f64> = inputs.iter().map(formula).collect();
        let samples = Samples { dimensions, ..samples(&inputs, &values) };
        let metric = Metric { scale: [1.2, 0.7, 0.5, 1.1, 0.8, 1.0, 1.0, 1.0], shear: -0.2 };
        for (kernel, tail) in [
            (KernelKind::Cubic, Tail::Linear),
            (KernelKind::Quintic, Tail::Quadratic),
            (KernelKind::Matern72 { length: 2.0 }, Tail::Linear),
            (KernelKind::CubicQuintic { crossover: 0.4 }, Tail::Quadratic),
        ] {
            let fitted = fit(&samples, KernelSpec { kernel, tail }, metric, 0.0).expect("fits").interpolant;
            for (x, y) in inputs.iter().zip(&values) {
                assert!(
                    (fitted.values_at(x)[0] - y).abs() < 10.0 * missed(kernel),
                    "{kernel:?} misses a sample of {dimensions} inputs"
                );
            }
            for mut x in cube(dimensions, 12) {
                x.iter_mut().take(dimensions).for_each(|x| *x = 0.2 + 0.6 * (1.0 - *x));
                let error = (fitted.values_at(&x)[0] - formula(&x)).abs();
                assert!(error < 0.02, "{kernel:?} over {dimensions} inputs at {x:?} is off by {error}");
                check_gradient(&fitted, x);
            }
        }
    }
}

#[test]
fn selection_over_four_inputs_finds_the_irrelevant_input() {
    let inputs = cube(4, 90);
    let values: Vec<f64> = inputs.iter().map(|x| (3.0 * x[0]).sin() + x[1] * x[3]).collect();
    let score = vec![1.0; inputs.len()];
    let states =
        States { operating: 2, dimensions: 4, inputs: &inputs, score: &score, slopes: &[], exact: None };
    let dropped = vec![0.0; inputs.len()];
    let slope_values = Vec::new();
    let task = Task {
        values,
        outputs: 1,
        slope_values,
        dropped,
        modes: ModeChoice::Fixed(1),
        modes_for_energy: 1,
        leading: 0,
    };
    let spec = KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear };
    let config = RegimeConfig { kernels: vec![spec], smoothing: vec![0.0], ..RegimeConfig::default() };
    let chosen = choose(states, &[task], &config, &|_| true).expect("chooses").remove(0);
    let scale = chosen.fit.interpolant.metric.scale;
    assert!(scale[2] < 0.1, "the third input changes nothing: {scale:?}");
    let first = chosen.candidates.first().and_then(|c| c.error).expect("scored");
    let start = Metric::IDENTITY.stretched(2, 0.35).stretched(3, 0.35);
    let plain = chosen.candidates.iter().find(|c| c.metric == start).and_then(|c| c.error);
    assert!(first < plain.expect("tried"), "stretching did not pay");
}

/// A kernel that is refused by a check of the fitted function gives way to another one, unless that is much worse.
#[test]
fn selection_takes_a_sound_kernel_that_is_nearly_as_good() {
    let inputs = points(40);
    let values: Vec<f64> = inputs.iter().map(smooth).collect();
    let score = vec![1.0; inputs.len()];
    let states =
        States { operating: 2, dimensions: 2, inputs: &inputs, score: &score, slopes: &[], exact: None };
    let task = || Task {
        values: values.clone(),
        outputs: 1,
        slope_values: Vec::new(),
        dropped: vec![0.0; inputs.len()],
        modes: ModeChoice::Fixed(1),
        modes_for_energy: 1,
        leading: 0,
    };
    let spec = |kernel| KernelSpec { kernel, tail: Tail::Linear };
    let chosen = |kernels: Vec<KernelSpec>, refused: Option<KernelKind>| {
        let config = RegimeConfig { kernels, smoothing: vec![0.0], ..RegimeConfig::default() };
        let is_sound = |fitted: &Interpolant| Some(fitted.kernel) != refused;
        let choice = choose(states, &[task()], &config, &is_sound).expect("chooses").remove(0);
        choice.fit.interpolant.kernel
    };
    let near = [KernelKind::Quintic, KernelKind::CubicQuintic { crossover: 0.4 }];
    let best = chosen(near.map(spec).to_vec(), None);
    let other = near.into_iter().find(|kernel| *kernel != best).expect("one of two");
    assert_eq!(chosen(near.map(spec).to_vec(), Some(best)), other);
    // Straight lines are more than three times as wrong.
    let far = vec![spec(best), spec(KernelKind::Linear)];
    assert_eq!(chosen(far, Some(best)), best);
}

/// Pressure and gap by their hull, parameters by their ranges, holes by the distance to the nearest sample.
#[test]
fn training_range_with_parameters_is_hull_times_ranges_without_holes() {
    for (operating, dimensions) in [(1, 2), (1, 3), (2, 4), (2, 8)] {
        let ends = |k: usize| {
            let mut x = Point::default();
            (0..dimensions).for_each(|i| x[i] = f64::from(u8::from(k >> i & 1 == 1)));
            x
        };
        let all: Vec<Point> = (0..1 << dimensions).map(ends).chain(cube(dimensions, 300)).collect();
        let domain = TrainingRange::of_points(operating, dimensions, &all);
        assert!(domain.fits(dimensions) && !domain.fits(dimensions + 1), "{operating}, {dimensions}");
        assert!(domain.has_vertex(&all[0]) && !domain.has_vertex(&point([0.5; 8])));
        for (k, inside) in all.iter().enumerate() {
            assert_eq!(
                TrainingRange::status(domain.distance(inside)),
                DomainStatus::Inside,
                "{dimensions}, {k}"
            );
            let mut outside = *inside;
            outside[0] = 1.25;
            assert!(domain.distance(&outside) >= 0.25 - 1e-12);
            outside[dimensions - 1] = -0.5;
            assert!(domain.distance(&outside) >= 0.25_f64.hypot(0.5) - 1e-12);
        }
        let mut lost = all[0];
        lost[dimensions - 1] = f64::NAN;
        assert_eq!(domain.distance(&lost), f64::INFINITY);
    }
    // Two clusters: the middle lies within hull and ranges, and far from every sample.
    let cluster = |at: f64| cube(3, 40).into_iter().map(move |x| point([0, 1, 2].map(|i| at + 0.1 * x[i])));
    let two: Vec<Point> = cluster(0.0).chain(cluster(0.9)).collect();
    assert_eq!(
        TrainingRange::status(TrainingRange::of_points(2, 3, &two).distance(&point([0.5; 3]))),
        DomainStatus::Outside
    );
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn hull_contains_its_points_and_distance_is_positive_outside(
        points in prop::collection::vec([0.0..1.0_f64, 0.0..1.0_f64], 3..40),
        angle in 0.0..6.3_f64,
        far in 0.01..3.0_f64,
    ) {
        let all: Vec<Point> = points.iter().copied().map(point).collect();
        let domain = TrainingRange::of_points(2, 2, &all);
        for p in &all {
            prop_assert!(domain.distance(p) < 1e-12, "{:?} is outside its own hull", p);
        }
        let way = [angle.cos(), angle.sin()];
        let along = |p: &[f64; 2]| p[0] * way[0] + p[1] * way[1];
        let tip = points.iter().copied().max_by(|a, b| along(a).total_cmp(&along(b))).expect("points");
        let outside = [tip[0] + far * way[0], tip[1] + far * way[1]];
        // The supporting line is `far` away, and the tip itself no farther.
        prop_assert!((domain.distance(&point(outside)) - far).abs() < 1e-9);
        prop_assert!(TrainingRange::status(far) != DomainStatus::Inside);
    }

    #[test]
    fn gradients_of_interpolants_are_their_derivatives(x in 0.05..0.95_f64, y in 0.05..0.95_f64, which in 2..7_usize) {
        let inputs = points(20);
        let values: Vec<f64> = inputs.iter().map(smooth).collect();
        let (kernel, tail) = KERNELS[which];
        let fitted = fit(&samples(&inputs, &values), KernelSpec { kernel, tail }, ASLANT, 0.0).expect("fits").interpolant;
        check_gradient(&fitted, point([x, y]));
    }
}
