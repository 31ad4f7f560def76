//! A model along readings: whoever steps it, gaps of a recording are straight lines, and a refused reading changes nothing.

use rom::evaluation::Evaluation;
use rom::halfwidths::HalfWidths;
use rom::inertia::data::InertiaModel;
use rom::inputs::Inputs;
use rom::model::{BlockKind, Model};
use rom::session::{Gaps, Session};
use tests::{Program, Stage, moving};

const GAP_MM: f64 = 20.0;

fn relaxing() -> Model {
    Model::from_bytes(&moving::relaxing_bytes()).unwrap()
}

/// Everything of an evaluation that a reader sees, bit for bit.
fn bits(of: &Evaluation) -> Vec<u64> {
    let numbers = of.inputs.values().iter().chain(&of.coefficients).chain(&of.force_gradient);
    let widths = of.halfwidths;
    let own = [of.contact_force_n, widths.displacement_mm, widths.force_n, widths.stress_mpa];
    numbers.chain(&own).map(|value| value.to_bits()).collect()
}

#[test]
fn refused_readings_leave_a_session_as_it_was() {
    let model = relaxing();
    for gaps in [Gaps::Live, Gaps::Recorded] {
        let mut session = Session::new(&model, gaps).unwrap();
        let (mut out, mut of_other) = (session.evaluation(), session.evaluation());
        for k in 0..20_u64 {
            session.step(5_000_000 * k, Inputs::new(0.02 + 0.004 * k as f64, GAP_MM), &mut out).unwrap();
            let before = bits(&out);
            let mut other = session.clone();
            let next_ns = 5_000_000 * (k + 1);
            for (t_ns, pressure_mpa, gap_mm) in [
                // The memory takes this one, the motion does not.
                (next_ns, 0.2, f64::NAN),
                (next_ns, f64::NAN, GAP_MM),
                (next_ns, f64::INFINITY, GAP_MM),
                (next_ns, 1e200, GAP_MM),
                (5_000_000 * k, 0.2, GAP_MM),
                (0, 0.2, GAP_MM),
            ] {
                let inputs = Inputs::new(pressure_mpa, gap_mm);
                assert!(session.step(t_ns, inputs, &mut out).is_err(), "{t_ns} {pressure_mpa} {gap_mm}");
                assert!(session.step_held(t_ns, inputs, &mut out).is_err(), "{t_ns} {pressure_mpa} {gap_mm}");
            }
            assert_eq!(bits(&out), before);
            let inputs = Inputs::new(0.05, GAP_MM);
            let both =
                [session.clone().step(next_ns, inputs, &mut out), other.step(next_ns, inputs, &mut of_other)];
            assert_eq!(both[0], both[1]);
            assert_eq!(bits(&out), bits(&of_other), "step {k}");
        }
    }
}

#[test]
fn learned_model_answers_alike_live_recorded_and_from_its_file_and_refused_readings_change_nothing() {
    let model = tests::learned_model();
    let from_file = Model::from_bytes(&model.to_bytes().unwrap()).unwrap();
    let mut sessions = [(&model, Gaps::Live), (&model, Gaps::Recorded), (&from_file, Gaps::Live)]
        .map(|(model, gaps)| Session::new(model, gaps).unwrap());
    let bits = |of: &Evaluation| {
        let numbers = of.coefficients.iter().chain(&of.output_half_widths);
        numbers.map(|value| value.to_bits()).collect::<Vec<u64>>()
    };
    let inputs = |k: u64| {
        let pressure_mpa = 0.05 - 0.05 * (0.026 * k as f64).cos();
        Inputs::new(pressure_mpa, f64::INFINITY).with(2, 0.4 * pressure_mpa)
    };
    let mut seen = Vec::new();
    for k in 0..150 {
        let t_ns = 17_000_000 * k + k % 3;
        let all = sessions.each_mut().map(|session| {
            let mut out = session.evaluation();
            session.step(t_ns, inputs(k), &mut out).unwrap();
            for (t_ns, value) in
                [(t_ns + 5_000_000, f64::NAN), (t_ns + 5_000_000, 1e200), (t_ns, 0.02), (0, 0.02)]
            {
                let refused = session.step(t_ns, Inputs::new(value, f64::INFINITY).with(2, value), &mut out);
                assert!(refused.is_err(), "{t_ns} {value}");
            }
            bits(&out)
        });
        assert!(all[0] == all[1] && all[0] == all[2], "{k}");
        assert!(seen.last() != Some(&all[0]) && all[0].len() == 4, "{k}");
        seen.push(all[0].clone());
    }
    // A restart begins again.
    sessions[0].restart();
    let mut out = sessions[0].evaluation();
    sessions[0].step(0, inputs(0), &mut out).unwrap();
    assert_eq!(bits(&out), seen[0]);
}

/// A twin takes readings faster than it answers them: the memory and the branch see every one, and an answer is that of a session which
/// answered all.
#[test]
fn readings_that_are_taken_and_not_answered_are_remembered() {
    let mut model = relaxing();
    model.blocks.retain(|(kind, _)| *kind != BlockKind::Inertia);
    let mut live = Session::new(&model, Gaps::Live).unwrap();
    let mut every = live.clone();
    let (mut out, mut of_every) = (live.evaluation(), live.evaluation());
    let mut random = rom::rng::Rng::new(3);
    for k in 0..200_u64 {
        let pressure_mpa = if k % 7 == 3 { f64::NAN } else { 0.1 * random.uniform() };
        let (t_ns, inputs) = (3_000_000 * k, Inputs::new(pressure_mpa, GAP_MM));
        let stepped = every.step(t_ns, inputs, &mut of_every);
        let taken = live.take(t_ns, inputs);
        assert_eq!(stepped.err(), taken.as_ref().err().copied());
        if let Ok(filtered) = taken
            && k % 5 == 0
        {
            live.answer(&filtered, &mut out).unwrap();
            live.complete(&mut out);
            assert_eq!(bits(&out), bits(&of_every), "reading {k}");
        }
    }
}

/// A recording that has no gaps is answered as it was live, but for half-widths: a twin does not know that a recording begins at rest.
#[test]
fn answers_live_and_from_a_recording_are_the_same_until_a_gap() {
    let model = relaxing();
    let sessions = [Gaps::Live, Gaps::Recorded].map(|gaps| Session::new(&model, gaps).unwrap());
    let outs = sessions.each_ref().map(Session::evaluation);
    let [(mut live, mut of_live), (mut recorded, mut of_recorded)] =
        sessions.into_iter().zip(outs).collect::<Vec<_>>().try_into().unwrap();
    let (mut last_ns, mut answered) = (0, 0);
    for reading in [1, 2, 3].into_iter().flat_map(moving::readings) {
        if reading.restarts || reading.t_ns > last_ns + 250_000_000 || reading.t_ns + 1_000_000_000 < last_ns
        {
            live.restart();
            recorded.restart();
        }
        let inputs = Inputs::new(reading.pressure_mpa, GAP_MM);
        let before = bits(&of_live);
        let stepped = live.step(reading.t_ns, inputs, &mut of_live);
        assert_eq!(recorded.step(reading.t_ns, inputs, &mut of_recorded), stepped, "{reading:?}");
        if stepped.is_err() {
            assert_eq!(bits(&of_live), before);
            continue;
        }
        last_ns = reading.t_ns;
        for out in [&mut of_live, &mut of_recorded] {
            out.halfwidths = HalfWidths::default();
        }
        assert_eq!(bits(&of_live), bits(&of_recorded), "{reading:?}");
        answered += 1;
    }
    assert!(answered > 900, "{answered}");
}

#[test]
fn long_steps_of_a_simulation_are_those_of_many_short_ones() {
    let mut model = Model::from_bytes(moving::model_bytes()).unwrap();
    let mut inertia: InertiaModel = model.record(BlockKind::Inertia).unwrap().unwrap();
    inertia.damping_s = 1e-4; // it swings for many seconds
    model.set_record(BlockKind::Inertia, &inertia).unwrap();
    let at = |steps: u64| {
        let mut session = Session::new(&model, Gaps::Recorded).unwrap();
        let mut out = session.evaluation();
        session.step_held(1_000_000, Inputs::new(0.0, f64::INFINITY), &mut out).unwrap();
        for k in 1..=steps {
            let end_ns = 1_000_000 + k * 3_000_000_000 / steps;
            let stepped = session.step_held(end_ns, Inputs::new(0.1, f64::INFINITY), &mut out).unwrap();
            assert!(!stepped.at_rest && !stepped.held, "{steps} {k}");
        }
        out.coefficients.clone()
    };
    let (once, often) = (at(1), at(600));
    let mut session = Session::new(&model, Gaps::Recorded).unwrap();
    let mut rest = session.evaluation();
    session.step(0, Inputs::new(0.1, f64::INFINITY), &mut rest).unwrap();
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let swing = far(&once, &rest.coefficients);
    assert!(far(&once, &often) < 1e-3 * swing, "{once:?} {often:?} {rest:?}");
}

/// A pause of 1.5 s within a recording: `compare` and `predict --trace` bridge it alike, and a twin would not.
#[test]
fn compare_bridges_a_gap_as_predict_does() {
    let stage = Stage::with_model("gaps", &moving::relaxing_bytes());
    let time_s = |k: u32| 0.01 * f64::from(k) + if k > 20 { 1.5 } else { 0.0 };
    let pressure_mpa = |k: u32| if k > 20 { 0.2 } else { 0.1 };
    let rows = |column: &str| -> String {
        let row = |k| format!("{},{},{GAP_MM},0\n", time_s(k), pressure_mpa(k));
        format!("t_s,pressure_mpa,gap_mm{column}\n") + &(0..41).map(row).collect::<String>()
    };
    stage.write("run.csv", &rows(",contact_force_n"));
    stage.write("trace.csv", &rows("").replace(",0\n", "\n"));
    let channel = |kind: &str, name: &str, unit: &str| {
        format!("[[{kind}]]\nname = \"{name}\"\ncolumn = \"{name}\"\nunit = \"{unit}\"\n")
    };
    let log = [
        "[time]\ncolumn = \"t_s\"\nunit = \"s\"\n".to_owned(),
        channel("input", "pressure_mpa", "MPa"),
        channel("input", "gap_mm", "mm"),
        channel("output", "contact_force_n", "N"),
    ];
    stage.write("log.toml", &log.concat());
    for line in [
        "compare beam.twin --recording run.csv --log log.toml --out out --json",
        "predict beam.twin --json --trace trace.csv --step-ms 1000 --out series.csv",
    ] {
        let (status, said) = Program::tool(&stage, &line.split(' ').collect::<Vec<_>>()).end();
        assert!(status.success(), "{said:?}");
    }
    let column = |file: &str, name: &str| -> Vec<f64> {
        let table = formats::table::Table::read(&stage.path(file), true).unwrap();
        let (t_s, at) = (table.column("t_s").unwrap(), table.column(name).unwrap());
        // `predict` adds rows within the gap.
        let is_row = |t: f64| (0..41).any(|k| (t - time_s(k)).abs() < 1e-9);
        table
            .rows()
            .filter(|row| is_row(row.number(t_s).unwrap()))
            .map(|row| row.number(at).unwrap())
            .collect()
    };
    let compared = column("out/compare.csv", "contact_force_n_predicted");
    let along = column("series.csv", "contact_force_n");
    assert_eq!(compared.len(), 41);
    let off = compared.iter().zip(&along).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let model = relaxing();
    let mut twin = Session::new(&model, Gaps::Live).unwrap();
    let mut out = twin.evaluation();
    let mut live = |k| {
        let inputs = Inputs::new(pressure_mpa(k), GAP_MM);
        let stepped = twin.step((1e9 * time_s(k)).round() as u64, inputs, &mut out).unwrap();
        assert_eq!(stepped.at_rest, k == 0 || k == 21);
        out.contact_force_n
    };
    let apart = (0..41).map(|k| (live(k) - compared[k as usize]).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3 * apart, "{off} {apart}");
}
