//! Models of measurements: closed-form curves with noise, still inputs, runs that are shifted.

use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::reconstructor::Reconstructor;
use rom::rng::Rng;
use rom::session::{Gaps, Session};
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
        assert!((0.9..2.0).contains(&(report.rms / noise)) && report.loop_share < 0.01, "{report:?}");
    }
    let named: Vec<String> = outputs(&learned.model).into_iter().map(|output| output.name).collect();
    assert_eq!(named, ["tip_x_mm", "tip_y_mm", "angle_deg"]);
    let mut state = ModelState::new(&learned.model, &Selection::default()).unwrap();
    for (a, b) in [(0.1, 0.2), (0.5, 0.5), (0.9, 0.3)] {
        state.update(Inputs::new(0.1 * a, f64::INFINITY).with(2, 0.1 * b)).unwrap();
        for (output, exact) in outputs(&learned.model).iter().zip(truth(a, b)) {
            let found = f64::from(state.fields()[output.field + output.node]);
            assert!((found - exact).abs() < 1.0, "{}: {found} for {exact}", output.name);
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
    assert!(inside.iter().all(|share| *share > 0.85), "{inside:?}");
}

#[test]
fn shift_between_runs_widens_the_half_widths() {
    let mut two = bench(1, 1000, 0.0);
    let narrow = learn("arm", &two).unwrap().outputs[0].half_width;
    two.runs.extend(bench(2, 1000, 2.0).runs);
    let wide = learn("arm", &two).unwrap().outputs[0].half_width;
    assert!(narrow < 1.4 && (1.9..3.0).contains(&wide), "{narrow} {wide}");
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

/// Errors and half-widths of each output on a run, as a session gives them.
fn predict(model: &Model, names: &[&str], run: &Run) -> Vec<Vec<(f64, f64)>> {
    let mut session = Session::new(model, Gaps::Recorded).unwrap();
    let mut evaluation = session.evaluation();
    let reconstructor = Reconstructor::new(model, &Selection::default()).unwrap();
    let mut fields = vec![0.0; reconstructor.entries()];
    let outputs = outputs(model);
    let mut found = vec![Vec::new(); names.len()];
    for (row, t_s) in run.time_s.iter().enumerate() {
        let start = Inputs::new(run.inputs[0][row], f64::INFINITY);
        let inputs = run.inputs.get(1).map_or(start, |second| start.with(2, second[row]));
        session.step((1e9 * t_s).round() as u64, inputs, &mut evaluation).unwrap();
        reconstructor.reconstruct_into(&evaluation, &mut fields).unwrap();
        for ((k, name), all) in names.iter().enumerate().zip(&mut found) {
            let output = outputs.iter().find(|output| output.name == *name).unwrap();
            let value = f64::from(fields[model.header.node_count * output.field + output.node]);
            all.push((value - run.outputs[k][row], output.half_width_of(&evaluation)));
        }
    }
    found
}

/// Share of the values with a half-width that are within it.
fn covered(errors: &[(f64, f64)]) -> f64 {
    let known = || errors.iter().filter(|(_, width)| width.is_finite());
    known().filter(|(error, width)| error.abs() <= *width).count() as f64 / known().count() as f64
}

fn rms(errors: &[(f64, f64)]) -> f64 {
    (errors.iter().map(|(error, _)| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn lag_of_short_dynamic_runs_is_found_and_half_widths_hold_on_another_run() {
    let mut rng = Rng::new(21);
    let mut shares = Vec::new();
    for _ in 0..3 {
        let learned = learn("arm", &dynamic(&mut rng)).unwrap();
        let [filling_s, emptying_s] = learned.lag_s.unwrap();
        let time_s = (filling_s * emptying_s).sqrt();
        assert!((0.15..0.6).contains(&time_s), "{filling_s} {emptying_s}");
        assert!(learned.error_share < 0.3 * learned.memoryless_share, "{learned:?}");
        let found = predict(&learned.model, &["tip_x_mm", "tip_y_mm"], &dynamic(&mut rng).runs[0]);
        assert!(
            found.iter().all(|errors| rms(errors) < 2.0),
            "{:?}",
            found.iter().map(|e| rms(e)).collect::<Vec<_>>()
        );
        shares.extend(found.iter().map(|errors| covered(errors)));
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    assert!((0.85..=1.0).contains(&mean) && shares.iter().all(|share| *share > 0.7), "{shares:?}");
}

#[test]
fn settled_states_in_any_order_have_no_lags() {
    let mut rng = Rng::new(5);
    let mut data = bench(1, 600, 0.0);
    let mut order: Vec<usize> = (0..600).collect();
    rng.shuffle(&mut order);
    let run = &mut data.runs[0];
    for column in run.inputs.iter_mut().chain(&mut run.outputs) {
        *column = order.iter().map(|row| column[*row]).collect();
    }
    data.inputs.truncate(2);
    data.runs[0].inputs.truncate(2);
    let learned = learn("rig", &data).unwrap();
    assert_eq!((learned.lag_s, learned.shares[2]), (None, 0.0));
    assert!(!learned.model.header.learned.as_ref().unwrap().has_memory());
}

/// A membrane that snaps up at a pressure that rises with its load: settled rows of one load.
fn membrane(rng: &mut Rng, load_n: f64) -> Run {
    let mut run = Run { inputs: vec![Vec::new(); 2], outputs: vec![Vec::new()], ..Run::default() };
    for row in 0..200 {
        let pressure_mpa = 0.05 * rng.uniform();
        let height = 30.0 * (1.0 + (150.0 * (pressure_mpa - 0.001 * load_n)).tanh());
        run.time_s.push(f64::from(row));
        run.inputs[0].push(pressure_mpa);
        run.inputs[1].push(load_n);
        run.outputs[0].push(height + rng.uniform() - 0.5);
    }
    run
}

#[test]
fn runs_with_a_load_of_their_own_are_learned_for_repeating_a_load() {
    let mut rng = Rng::new(8);
    let runs = [15.0, 25.0, 39.0].map(|load_n| membrane(&mut rng, load_n)).into();
    let inputs = vec!["pressure_mpa".into(), "load_n".into()];
    let learned = learn("membrane", &Measured { inputs, outputs: vec!["height_mm".into()], runs }).unwrap();
    let found = predict(&learned.model, &["height_mm"], &membrane(&mut rng, 25.0));
    assert!(rms(&found[0]) < 1.0, "{}", rms(&found[0]));
    assert!(covered(&found[0]) > 0.85, "{}", covered(&found[0]));
    let between = predict(&learned.model, &["height_mm"], &membrane(&mut rng, 20.0));
    assert!(covered(&between[0]) > 0.85, "{}", covered(&between[0]));
}

#[test]
fn beyond_the_learned_inputs_half_widths_grow_or_are_absent_and_the_base_answers() {
    let learned = learn("arm", &bench(1, 1500, 0.0)).unwrap();
    let mut session = Session::new(&learned.model, Gaps::Recorded).unwrap();
    let mut evaluation = session.evaluation();
    let mut at = |t_s: u64, pressure_mpa: f64| {
        let inputs = Inputs::new(pressure_mpa, f64::INFINITY).with(2, 0.05);
        session.step(1_000_000_000 * t_s, inputs, &mut evaluation).unwrap();
        (evaluation.flags.extrapolated, evaluation.coefficients[2], evaluation.output_half_widths[2])
    };
    at(0, 0.05);
    let (is_outside, _, inside) = at(100, 0.05);
    assert!(!is_outside && inside > 0.0);
    let (is_outside, value, width) = at(200, 0.14);
    let exact = truth(1.4, 0.5)[2];
    assert!(
        is_outside && (width.is_nan() || (width > inside && (value - exact).abs() < width)),
        "{value} {width}"
    );
    let (is_outside, value, width) = at(300, 10.0);
    assert!(is_outside && value.is_nan() && width.is_nan(), "{value} {width}");
}

/// 20 markers that move by three shapes.
fn many(seed: u64, rows: usize) -> Measured {
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
    Measured {
        inputs: data.inputs[..2].to_vec(),
        outputs: (0..60).map(name).collect(),
        runs: vec![Run { time_s: take(&of.time_s), inputs, outputs }],
    }
}

#[test]
fn many_outputs_are_learned_with_half_widths_that_hold() {
    let learned = learn("arm", &many(3, 300)).unwrap();
    let other = many(4, 200);
    let names: Vec<&str> = other.outputs.iter().map(String::as_str).collect();
    let found = predict(&learned.model, &names, &other.runs[0]);
    let noise = 2.0 / 12.0_f64.sqrt();
    let errors: Vec<f64> = found.iter().map(|errors| rms(errors) / noise).collect();
    assert!(errors.iter().all(|error| *error < 2.0), "{errors:?}");
    let shares: Vec<f64> = found.iter().map(|errors| covered(errors)).collect();
    let mean = shares.iter().sum::<f64>() / 60.0;
    assert!((0.85..=1.0).contains(&mean) && shares.iter().all(|share| *share > 0.8), "{shares:?}");
}

/// Columns of a recording of the benchmark.
fn recorded(name: &str, inputs: &[&str], outputs: &[&str]) -> Run {
    let path = format!("{}/../../benchmarks/data/{name}.csv", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    let column = |name: &&str| -> Vec<f64> {
        let at = names.iter().position(|known| known == name).unwrap();
        rows.iter().map(|row| row[at]).collect()
    };
    let columns = |names: &[&str]| names.iter().map(column).collect();
    Run { time_s: column(&"time_s"), inputs: columns(inputs), outputs: columns(outputs) }
}

/// The method was tried in numpy first. Reference: `Model().fit([run_1]).predict(*run_2)` of that prototype on these two files, one thread, has an
/// RMS of 1.169, 0.348 and 0.363 mm, median half-widths of 3.40, 0.92 and 1.72 mm, and 100 % of the values within.
#[test]
fn next_run_of_an_arm_is_predicted_as_by_the_prototype() {
    let (inputs, outputs) = (["segment1_b_mpa", "segment2_b_mpa"], ["tip_x_mm", "tip_y_mm", "tip_z_mm"]);
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let runs = vec![recorded("arm_10-3_1", &inputs, &outputs)];
    let learned = learn("arm", &Measured { inputs: names(&inputs), outputs: names(&outputs), runs }).unwrap();
    assert!(learned.remarks.iter().any(|remark| remark.starts_with("one run says nothing about the next")));
    let run_2 = recorded("arm_10-3_2", &inputs, &outputs);
    let mut session = Session::new(&learned.model, Gaps::Recorded).unwrap();
    let mut evaluation = session.evaluation();
    let mut found = vec![Vec::new(); 3];
    for (row, t_s) in run_2.time_s.iter().enumerate() {
        let at = |input: usize| run_2.inputs[input][row];
        let values = Inputs::new(f64::NAN, f64::INFINITY).with(2, at(0)).with(3, at(1));
        session.step((1e9 * (t_s - run_2.time_s[0])) as u64, values, &mut evaluation).unwrap();
        for (k, all) in found.iter_mut().enumerate() {
            let error = evaluation.coefficients[k] - run_2.outputs[k][row];
            all.push((error, evaluation.output_half_widths[k]));
        }
    }
    let together = |of: [f64; 3]| of.iter().map(|v| v * v).sum::<f64>().sqrt();
    let position_mm = together([0, 1, 2].map(|k| rms(&found[k])));
    let prototype_mm = together([1.169, 0.348, 0.363]);
    assert!((position_mm / prototype_mm - 1.0).abs() < 0.05, "{position_mm} {prototype_mm}");
    for (errors, prototype_mm) in found.iter().zip([3.40, 0.92, 1.72]) {
        let mut widths: Vec<f64> = errors.iter().map(|(_, width)| *width).collect();
        widths.sort_by(f64::total_cmp);
        let median_mm = widths[widths.len() / 2];
        assert!((0.6..1.1).contains(&(median_mm / prototype_mm)), "{median_mm} {prototype_mm}");
        assert!(covered(errors) > 0.95, "{}", covered(errors));
    }
}
