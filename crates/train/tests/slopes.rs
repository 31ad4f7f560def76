//! Interpolants that were fitted to derivatives as well.

use rom::inputs::{MAX_INPUTS, Point};
use rom::interpolant::{Metric, Slope};
use train::config::{KernelKind, KernelSpec, ModeChoice, RegimeConfig, Tail};
use train::fit::{FitError, Samples, fit};
use train::select::{States, Task, choose};

const KERNELS: [(KernelKind, Tail); 5] = [
    (KernelKind::Cubic, Tail::Linear),
    (KernelKind::Quintic, Tail::Quadratic),
    (KernelKind::Gaussian { shape: 3.0 }, Tail::Constant),
    (KernelKind::Matern72 { length: 2.0 }, Tail::Linear),
    (KernelKind::CubicQuintic { crossover: 0.4 }, Tail::Quadratic),
];
const ASLANT: Metric = Metric { scale: [1.3, 0.6, 0.9, 1.0, 1.0, 1.0, 1.0, 1.0], shear: 0.4 };

fn points(n: usize) -> Vec<Point> {
    let one = |i: usize| {
        let mut x = [0.0; MAX_INPUTS];
        x.iter_mut().zip([2.0_f64, 3.0, 5.0]).for_each(|(x, root)| *x = (i as f64 * root.sqrt()).fract());
        x
    };
    (1..=n).map(one).collect()
}

fn smooth(x: &Point) -> f64 {
    (2.0 * x[0]).sin() + x[0] * x[1] * x[1] + 0.3 * (3.0 * x[2]).cos()
}

fn slope(x: &Point, axis: u32) -> f64 {
    match axis {
        0 => 2.0 * (2.0 * x[0]).cos() + x[1] * x[1],
        1 => 2.0 * x[0] * x[1],
        _ => -0.9 * (3.0 * x[2]).sin(),
    }
}

/// Samples with derivatives with respect to all inputs at every second one; the values and derivatives themselves.
struct Known {
    inputs: Vec<Point>,
    values: Vec<f64>,
    slopes: Vec<Slope>,
    slope_values: Vec<f64>,
}

impl Known {
    fn at(inputs: Vec<Point>) -> Self {
        let place = |(centre, axis): (u32, u32)| Slope { centre, axis };
        let all = (0..inputs.len() as u32).step_by(2).flat_map(|c| (0..3).map(move |axis| (c, axis)));
        let slopes: Vec<Slope> = all.map(place).collect();
        Self {
            values: inputs.iter().map(smooth).collect(),
            slope_values: slopes.iter().map(|s| slope(&inputs[s.centre as usize], s.axis)).collect(),
            inputs,
            slopes,
        }
    }

    fn samples(&self) -> Samples<'_> {
        Samples {
            dimensions: 3,
            inputs: &self.inputs,
            values: &self.values,
            outputs: 1,
            slopes: &self.slopes,
            slope_values: &self.slope_values,
            exact: None,
        }
    }
}

#[test]
fn values_and_derivatives_are_reproduced() {
    let known = Known::at(points(24));
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        let fitted = fit(&known.samples(), spec, ASLANT, 0.0).expect("fits").interpolant;
        for (x, value) in known.inputs.iter().zip(&known.values) {
            assert!((fitted.values_at(x)[0] - value).abs() < 1e-7, "{kernel:?}");
        }
        for (s, value) in known.slopes.iter().zip(&known.slope_values) {
            let found = fitted.gradient_at(&known.inputs[s.centre as usize])[s.axis as usize][0];
            assert!((found - value).abs() < 1e-6, "{kernel:?} {s:?}: {found} is not {value}");
        }
        for x in [[0.31, 0.62, 0.44], [0.9, 0.1, 0.7], [0.05, 0.55, 0.5]] {
            let mut at = Point::default();
            at[..3].copy_from_slice(&x);
            for axis in 0..3 {
                let moved = |h: f64| {
                    let mut x = at;
                    x[axis] += h;
                    fitted.values_at(&x)[0]
                };
                let central = |h: f64| (moved(h) - moved(-h)) / (2.0 * h);
                let (found, numeric) =
                    (fitted.gradient_at(&at)[axis][0], (4.0 * central(5e-4) - central(1e-3)) / 3.0);
                assert!((found - numeric).abs() < 1e-5, "{kernel:?} {axis}: {found} is not {numeric}");
            }
        }
    }
}

#[test]
fn leave_one_out_includes_derivatives_of_the_sample() {
    let known = Known::at(points(24));
    for (kernel, tail) in KERNELS {
        let spec = KernelSpec { kernel, tail };
        let all = fit(&known.samples(), spec, ASLANT, 0.0).expect("fits");
        for left_out in [0_usize, 7, 22] {
            let kept = |centre: usize| centre != left_out;
            let renumbered = |centre: u32| centre - u32::from(centre as usize > left_out);
            let (mut slopes, mut slope_values) = (Vec::new(), Vec::new());
            for (s, value) in
                known.slopes.iter().zip(&known.slope_values).filter(|(s, _)| kept(s.centre as usize))
            {
                slopes.push(Slope { centre: renumbered(s.centre), ..*s });
                slope_values.push(*value);
            }
            let pick = |i: &usize| kept(*i);
            let inputs = (0..24).filter(pick).map(|i| known.inputs[i]).collect();
            let values = (0..24).filter(pick).map(|i| known.values[i]).collect();
            let rest = Known { inputs, values, slopes, slope_values };
            let without = fit(&rest.samples(), spec, ASLANT, 0.0).expect("fits").interpolant;
            let x = &known.inputs[left_out];
            let error = known.values[left_out] - without.values_at(x)[0];
            assert!((all.residuals[left_out] - error).abs() < 1e-6, "{kernel:?} {left_out}");
            for (j, s) in known.slopes.iter().enumerate().filter(|(_, s)| s.centre as usize == left_out) {
                let error = known.slope_values[j] - without.gradient_at(x)[s.axis as usize][0];
                assert!((all.slope_residuals[j] - error).abs() < 1e-5, "{kernel:?} {left_out} {s:?}");
            }
        }
    }
}

#[test]
fn derivatives_reduce_the_error_and_need_smooth_kernels() {
    let known = Known::at(points(40));
    let spec = KernelSpec { kernel: KernelKind::Quintic, tail: Tail::Quadratic };
    let worst = |samples: &Samples| {
        let fitted = fit(samples, spec, Metric::IDENTITY, 0.0).expect("fits").interpolant;
        let error = |x: &Point| (fitted.values_at(x)[0] - smooth(x)).abs();
        points(300).split_off(100).iter().map(error).fold(0.0, f64::max)
    };
    let with = worst(&known.samples());
    let without = worst(&Samples { slopes: &[], slope_values: &[], ..known.samples() });
    assert!(with < 0.5 * without, "{with} is not half of {without}");
    let linear = KernelSpec { kernel: KernelKind::Linear, tail: Tail::Constant };
    let refused = fit(&known.samples(), linear, Metric::IDENTITY, 0.0).expect_err("refused");
    assert_eq!(refused, FitError::NoDerivatives { kernel: "linear" });
}

/// The score of the chosen candidate over that many outputs, and its leave-one-out errors by case.
fn scored(known: &Known, outputs: usize, slopes: &[Slope]) -> (f64, Vec<f64>) {
    let repeat = |values: &[f64]| -> Vec<f64> {
        values.iter().flat_map(|v| (1..=outputs).map(move |k| v * k as f64)).collect()
    };
    let count = known.inputs.len();
    let score = vec![1.0; count];
    let states =
        States { operating: 2, dimensions: 3, inputs: &known.inputs, score: &score, slopes, exact: None };
    let task = Task {
        values: repeat(&known.values),
        outputs,
        slope_values: repeat(&known.slope_values[..slopes.len()]),
        dropped: vec![0.0; count],
        modes: ModeChoice::Fixed(outputs),
        modes_for_energy: outputs,
        leading: 0,
    };
    let spec = KernelSpec { kernel: KernelKind::Cubic, tail: Tail::Linear };
    let config = RegimeConfig { kernels: vec![spec], smoothing: vec![0.0], ..RegimeConfig::default() };
    let choice = choose(states, &[task], &config, &|_| true).expect("chooses").remove(0);
    let errors = choice.fit.residuals.chunks_exact(outputs);
    let errors = errors.map(|row| row.iter().map(|e| e * e).sum::<f64>().sqrt()).collect();
    (choice.candidates[0].error.expect("fitted"), errors)
}

#[test]
fn hard_cases_have_less_weight_with_several_outputs_and_derivatives() {
    let known = Known::at(points(40));
    let arithmetic = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let geometric = |errors: &[f64]| (errors.iter().map(|e| e.ln()).sum::<f64>() / errors.len() as f64).exp();
    for (outputs, slopes) in [(2, &known.slopes[..]), (2, &[]), (1, &known.slopes[..]), (1, &[])] {
        let (score, errors) = scored(&known, outputs, slopes);
        let means = [arithmetic(&errors), geometric(&errors)];
        assert!(means[0] > 1.05 * means[1], "{means:?} are the same");
        let expected = means[usize::from(outputs > 1 && !slopes.is_empty())];
        assert!(
            (score / expected - 1.0).abs() < 1e-9,
            "{outputs}, {}: {score} is not {expected}",
            slopes.len()
        );
    }
}
