//! Models of measurements: closed-form curves with noise, still inputs, runs that are shifted.

use rom::inputs::Inputs;
use rom::model::Selection;
use rom::model_state::ModelState;
use rom::rng::Rng;
use train::measured::{Measured, MeasuredError, Run, fit, learn, outputs, select};

/// Two inputs that move at different rates and one that only scatters; a marker in a plane and an angle.
fn bench(seed: u64, rows: usize, shift_mm: f64) -> Measured {
    let mut rng = Rng::new(seed);
    let mut run = Run { inputs: vec![Vec::new(); 3], outputs: vec![Vec::new(); 3], ..Run::default() };
    for row in 0..rows {
        let t_s = 0.05 * row as f64;
        let [a, b] = [0.5 - 0.5 * (0.4 * t_s).cos(), 0.5 - 0.5 * (0.93 * t_s).cos()];
        let mut noise = || rng.uniform() - 0.5;
        let still = 0.01 * noise();
        run.time_s.push(t_s);
        run.inputs.iter_mut().zip([0.1 * a, 0.1 * b, still]).for_each(|(column, v)| column.push(v));
        let clean = truth(a, b);
        let values = [clean[0] + shift_mm + 0.4 * noise(), clean[1] + 0.4 * noise(), clean[2] + noise()];
        run.outputs.iter_mut().zip(values).for_each(|(column, v)| column.push(v));
    }
    let names = |names: [&str; 3]| names.map(str::to_owned).to_vec();
    Measured {
        inputs: names(["pressure_mpa", "second_mpa", "still_mpa"]),
        outputs: names(["tip_x_mm", "tip_y_mm", "angle_deg"]),
        runs: vec![run],
    }
}

fn truth(a: f64, b: f64) -> [f64; 3] {
    [100.0 - 8.0 * a * a - 5.0 * b, 20.0 * (1.3 * a).sin() + 10.0 * b * b, 90.0 * a + 20.0 * b]
}

#[test]
fn smooth_map_is_found_through_noise_and_its_half_widths_hold_on_another_run() {
    let learned = learn("arm", &bench(1, 2000, 0.0)).unwrap();
    assert_eq!(learned.inputs, ["pressure_mpa", "second_mpa"]);
    assert!(learned.remarks.iter().any(|remark| remark.starts_with("still_mpa")), "{:?}", learned.remarks);
    for (report, noise) in
        learned.outputs.iter().zip([0.4, 0.4, 1.0_f64].map(|width| width / 12.0_f64.sqrt()))
    {
        assert!((report.noise / noise - 1.0).abs() < 0.15, "{report:?}");
        assert!((report.rms / noise - 1.0).abs() < 0.1 && report.loop_share < 0.01, "{report:?}");
    }
    let named: Vec<String> = outputs(&learned.model).into_iter().map(|output| output.name).collect();
    assert_eq!(named, ["tip_x_mm", "tip_y_mm", "angle_deg"]);
    let mut state = ModelState::new(&learned.model, &Selection::default()).unwrap();
    for (a, b) in [(0.1, 0.2), (0.5, 0.5), (0.9, 0.3)] {
        state.update(Inputs::new(0.1 * a, f64::INFINITY).with(2, 0.1 * b)).unwrap();
        for (output, exact) in outputs(&learned.model).iter().zip(truth(a, b)) {
            let found = f64::from(state.fields()[output.field + output.node]);
            assert!((found - exact).abs() < 0.1, "{}: {found} for {exact}", output.name);
        }
    }
    let other = &bench(2, 1500, 0.0).runs[0];
    let mut inside = [0.0; 3];
    for row in 0..1500 {
        state.update(Inputs::new(other.inputs[0][row], f64::INFINITY).with(2, other.inputs[1][row])).unwrap();
        for (k, output) in outputs(&learned.model).iter().enumerate() {
            let error = f64::from(state.fields()[output.field]) - other.outputs[k][row];
            inside[k] += f64::from(u8::from(error.abs() <= output.half_width)) / 1500.0;
        }
    }
    assert!(inside.iter().all(|share| (0.85..=0.97).contains(share)), "{inside:?}");
}

#[test]
fn shift_between_runs_widens_the_half_widths() {
    let mut two = bench(1, 1000, 0.0);
    let narrow = learn("arm", &two).unwrap().outputs[0].half_width;
    two.runs.extend(bench(2, 1000, 2.0).runs);
    let wide = learn("arm", &two).unwrap().outputs[0].half_width;
    // Means are 1 and -1 of their centre: s = sqrt(2), times 1.28 sqrt(1.5), on the errors of 1 mm themselves.
    assert!(narrow < 0.3 && (2.9..3.6).contains(&wide), "{narrow} {wide}");
}

#[test]
fn still_inputs_and_unrelated_outputs_are_refused() {
    let mut still = bench(1, 1000, 0.0);
    let noise = still.runs[0].inputs[2].clone();
    still.runs[0].inputs = vec![noise.clone(), noise.iter().rev().copied().collect(), noise];
    assert!(matches!(learn("arm", &still), Err(MeasuredError::Unrelated { .. })));
    still.runs[0].inputs = vec![vec![0.05; 1000]; 3];
    assert!(matches!(learn("arm", &still), Err(MeasuredError::Still)));
    let mut silent = bench(1, 1000, 0.0);
    silent.runs[0].outputs = vec![vec![1.0; 1000], vec![f64::NAN; 1000], vec![2.0; 1000]];
    assert!(matches!(learn("arm", &silent), Err(MeasuredError::NoOutput)));
    assert!(matches!(fit("arm", &bench(1, 7, 0.0)), Err(MeasuredError::Few { found: 7, .. })));
}

#[test]
fn missing_values_leave_out_their_rows_and_too_many_inputs_are_refused() {
    let mut data = bench(1, 1000, 0.0);
    data.runs[0].outputs[1][100..400].fill(f64::NAN);
    data.runs[0].inputs[0][500..510].fill(f64::NAN);
    let mut remarks = Vec::new();
    assert_eq!(fit("arm", &select(&data, &mut remarks).unwrap()).unwrap().rows, 690);
    let column = data.runs[0].inputs[1].clone();
    data.runs[0].inputs = vec![column; 8];
    data.inputs = (0..8).map(|at| format!("p{at}_mpa")).collect();
    assert!(matches!(learn("arm", &data), Err(MeasuredError::Many { expected: 6, found: 8 })));
}

/// 30 s of three swings of an input, of which the outputs see a lag of 0.3 s.
fn dynamic(rng: &mut Rng) -> Measured {
    let swings: Vec<[f64; 2]> =
        (0..3).map(|_| [0.2 + 1.7 * rng.uniform(), std::f64::consts::TAU * rng.uniform()]).collect();
    let mut run = Run { inputs: vec![Vec::new()], outputs: vec![Vec::new(); 2], ..Run::default() };
    let (mut behind, step_s) = (f64::NAN, 0.1);
    for row in 0..300 {
        let t_s = step_s * f64::from(row);
        let sum: f64 = swings.iter().map(|[rate, phase]| (rate * t_s + phase).sin()).sum();
        let input = (0.5 + 0.2 * sum).clamp(0.0, 1.0);
        behind = if row == 0 { input } else { input + (behind - input) * f64::exp(-step_s / 0.3) };
        let clean = truth(behind, 0.5);
        run.time_s.push(t_s);
        run.inputs[0].push(0.1 * input);
        run.outputs[0].push(clean[0] + 0.5 * (rng.uniform() - 0.5));
        run.outputs[1].push(clean[1] + 0.5 * (rng.uniform() - 0.5));
    }
    let outputs = vec!["tip_x_mm".into(), "tip_y_mm".into()];
    Measured { inputs: vec!["pressure_mpa".into()], outputs, runs: vec![run] }
}

/// Prints the values of another run within the half-widths.
#[test]
fn half_widths_of_short_dynamic_runs_hold_on_another_run() {
    let mut rng = Rng::new(21);
    let mut shares = Vec::new();
    for _ in 0..6 {
        let learned = learn("arm", &dynamic(&mut rng)).unwrap();
        let other = &dynamic(&mut rng).runs[0];
        let mut state = ModelState::new(&learned.model, &Selection::default()).unwrap();
        let mut inside = [0.0; 2];
        for row in 0..300 {
            state.update(Inputs::new(other.inputs[0][row], f64::INFINITY)).unwrap();
            for (k, output) in outputs(&learned.model).iter().enumerate() {
                let error = f64::from(state.fields()[output.field]) - other.outputs[k][row];
                inside[k] += f64::from(u8::from(error.abs() <= output.half_width)) / 300.0;
            }
        }
        shares.extend(inside);
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    println!("within the half-widths: {mean:.3} of all, by run and output {shares:.2?}");
    assert!((0.85..=0.97).contains(&mean), "{shares:?}");
}

/// 20 markers that move by three shapes, and their values without noise by row.
fn many(seed: u64, rows: usize) -> (Measured, Vec<Vec<f64>>) {
    let data = bench(seed, 8 * rows, 0.0);
    let take = |column: &Vec<f64>| -> Vec<f64> { column.iter().step_by(8).copied().collect() };
    let of = &data.runs[0];
    let (mut rng, inputs) = (Rng::new(seed + 10), of.inputs[..2].iter().map(take).collect::<Vec<_>>());
    let clean = |row: usize, k: usize| {
        let [a, b] = [10.0 * inputs[0][row], 10.0 * inputs[1][row]];
        let s = 0.3 * k as f64;
        50.0 + 15.0 * s.sin() * a + 12.0 * (1.7 * s).cos() * (1.5 * b).sin() + 8.0 * (0.6 * s).cos() * a * b
    };
    let clean: Vec<Vec<f64>> = (0..rows).map(|row| (0..60).map(|k| clean(row, k)).collect()).collect();
    let mut noisy = |k: usize| clean.iter().map(|row| row[k] + 2.0 * (rng.uniform() - 0.5)).collect();
    let outputs = (0..60).map(&mut noisy).collect();
    let name = |k: usize| format!("m{}_{}_mm", k / 3, ["x", "y", "z"][k % 3]);
    let data = Measured {
        inputs: data.inputs[..2].to_vec(),
        outputs: (0..60).map(name).collect(),
        runs: vec![Run { time_s: take(&of.time_s), inputs, outputs }],
    };
    (data, clean)
}

#[test]
fn many_outputs_share_their_modes_below_the_noise_with_fewer_numbers_and_half_widths_that_hold() {
    let learned = learn("arm", &many(3, 300).0).unwrap();
    assert_eq!(learned.modes, 3, "{}", learned.kernel);
    let group = &learned.model.header.regimes[0].groups[0];
    let terms = (group.surrogate.weights.len() + group.surrogate.tail_weights.len()) / 3;
    assert!(3 * (terms + 60) + 60 < 60 * terms / 5, "{terms} terms");
    let (other, clean) = many(4, 200);
    let of = &other.runs[0];
    let mut state = ModelState::new(&learned.model, &Selection::default()).unwrap();
    let (mut square, mut inside) = (0.0, [0.0; 60]);
    for (row, clean) in clean.iter().enumerate() {
        state.update(Inputs::new(of.inputs[0][row], f64::INFINITY).with(2, of.inputs[1][row])).unwrap();
        for output in outputs(&learned.model) {
            let k = other.outputs.iter().position(|name| *name == output.name).unwrap();
            let found = f64::from(state.fields()[20 * output.field + output.node]);
            square += (found - clean[k]).powi(2) / 12_000.0;
            inside[k] += f64::from(u8::from((found - of.outputs[k][row]).abs() <= output.half_width)) / 200.0;
        }
    }
    let (noise, mean) = (2.0 / 12.0_f64.sqrt(), inside.iter().sum::<f64>() / 60.0);
    assert!(square.sqrt() < 0.3 * noise, "{} of noise {noise}", square.sqrt());
    assert!((0.85..=0.97).contains(&mean) && inside.iter().all(|share| *share > 0.8), "{inside:?}");
}

#[test]
fn map_of_steps_is_smooth_between_their_levels() {
    // A lag of 0.2 s behind steps that repeat: their transitions pass between the levels, always in the same way.
    let levels = [0.0, 0.4, 0.8, 1.0, 0.6, 0.2, 0.0, 1.0, 0.0, 0.5];
    let (mut gauge, mut state) = (0.0, 0.0);
    let mut run = Run { inputs: vec![Vec::new()], outputs: vec![Vec::new()], ..Run::default() };
    for row in 0..3000_u32 {
        gauge += 0.33 * (levels[(row / 85) as usize % levels.len()] - gauge);
        state += 0.095 * (gauge - state);
        run.time_s.push(0.02 * f64::from(row));
        run.inputs[0].push(0.1 * gauge);
        run.outputs[0].push(90.0 * state);
    }
    let data =
        Measured { inputs: vec!["pressure_mpa".into()], outputs: vec!["angle_deg".into()], runs: vec![run] };
    let learned = learn("finger", &data).unwrap();
    let mut state = ModelState::new(&learned.model, &Selection::default()).unwrap();
    let value = |p: f64| {
        state.update(Inputs::new(0.1 * p, f64::INFINITY)).unwrap();
        f64::from(state.fields()[0])
    };
    let values: Vec<f64> = (0..=40).map(|k| f64::from(k) / 40.0).map(value).collect();
    assert!(values.windows(2).all(|pair| pair[1] > pair[0]), "{values:?}");
}
