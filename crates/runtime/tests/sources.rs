//! Every source keeps the contract of `Source`; traces of every kind are read or refused with the place.

use proptest::prelude::*;
use runtime::source::{
    InputNames, Poll, Profile, Reading, ReplaySpec, SensorTrace, SimulateSpec, Source, SourceSpec, TraceError,
};
use std::path::Path;

const TRACE: &str =
    "# made by hand\nt_s,pressure_mpa,gap_mm\n0.000,0.00,40\n0.005,0.01,40\n0.010,0.02,40\n0.500,0.03,39.5\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("trace.csv"), TRACE).unwrap();
    folder
}

/// One specification of each variant and shape: add new sources here.
fn all_specs() -> Vec<SourceSpec> {
    let replay = |spec: ReplaySpec| SourceSpec::Replay(ReplaySpec { trace: "trace.csv".into(), ..spec });
    let simulate = |profile| {
        SourceSpec::Simulate(SimulateSpec {
            profile,
            duration_s: 0.5,
            noise_mpa: 5e-5,
            resolution_mpa: 1e-4,
            ..SimulateSpec::default()
        })
    };
    vec![
        replay(ReplaySpec::default()),
        replay(ReplaySpec { speed: 2.0, from_s: 0.004, ..ReplaySpec::default() }),
        replay(ReplaySpec { repeat: true, ..ReplaySpec::default() }),
        simulate(Profile::ConstantFlow {
            flow_ml_per_min: 125.0,
            volume_mm3: 6711.6,
            compliance_mm3_per_mpa: 60000.0,
            until_mpa: 0.07,
        }),
        simulate(Profile::Ramp { from_mpa: 0.0, to_mpa: 0.07, rise_s: 0.4 }),
        simulate(Profile::Step { low_mpa: 0.0, high_mpa: 0.05, at_s: 0.25 }),
        simulate(Profile::Sine { mean_mpa: 0.03, amplitude_mpa: 0.03, frequency_hz: 2.0 }),
    ]
}

/// The next reading, ahead of its time; none at the end.
fn next(source: &mut dyn Source) -> Option<Reading> {
    match source.poll(f64::INFINITY) {
        Poll::Reading(reading) => Some(reading),
        end => {
            assert_eq!(end, Poll::End);
            None
        }
    }
}

fn take(mut source: Box<dyn Source>, count: usize) -> Vec<Reading> {
    std::iter::from_fn(|| next(source.as_mut())).take(count).collect()
}

#[test]
fn every_source_keeps_the_contract() {
    let folder = folder();
    for spec in all_specs() {
        let open = || spec.open(folder.path(), &InputNames::default()).unwrap();
        let readings = take(open(), 1000);
        assert!(!readings.is_empty(), "{spec:?} gives nothing");
        assert!(readings[0].due_s >= 0.0, "{spec:?} begins before 0");
        for pair in readings.windows(2) {
            assert!(pair[1].due_s >= pair[0].due_s, "{spec:?} goes back in time: {pair:?}");
        }
        let bits = |readings: &[Reading]| -> Vec<[u64; 3]> {
            readings
                .iter()
                .map(|r| [r.due_s, r.sample.pressure_mpa, r.sample.gap_mm].map(f64::to_bits))
                .collect()
        };
        assert_eq!(bits(&readings), bits(&take(open(), 1000)), "{spec:?} is not repeatable");
        let mut source = open();
        let count = std::iter::from_fn(|| next(source.as_mut())).take(1000).count();
        if count < 1000 {
            assert_eq!(source.poll(f64::INFINITY), Poll::End, "{spec:?} continues after its end");
        }
        // Nothing comes before its time.
        let mut source = open();
        for reading in &readings {
            let early = source.poll(reading.due_s.next_down());
            let is_held = early == Poll::Waiting { until_s: reading.due_s };
            assert!(is_held || matches!(early, Poll::Reading(_)), "{spec:?}: {early:?}");
            if is_held {
                assert!(matches!(source.poll(reading.due_s), Poll::Reading(_)), "{spec:?}");
            }
        }
    }
}

#[test]
fn replay_keeps_the_timing_and_knows_speed_part_and_rounds() {
    let folder = folder();
    let open = |spec: ReplaySpec| {
        let spec = ReplaySpec { trace: "trace.csv".into(), ..spec };
        take(SourceSpec::Replay(spec).open(folder.path(), &InputNames::default()).unwrap(), 6)
    };
    let due = |readings: &[Reading]| -> Vec<f64> {
        readings.iter().map(|r| (r.due_s * 1e6).round() / 1e6).collect()
    };
    assert_eq!(due(&open(ReplaySpec::default())), [0.0, 0.005, 0.01, 0.5]);
    assert_eq!(due(&open(ReplaySpec { speed: 2.0, ..ReplaySpec::default() })), [0.0, 0.0025, 0.005, 0.25]);
    let part = open(ReplaySpec { from_s: 0.005, to_s: 0.1, ..ReplaySpec::default() });
    assert_eq!(due(&part), [0.0, 0.005]);
    assert_eq!(part[0].sample.t_trace_s, 0.005);
    let rounds = open(ReplaySpec { repeat: true, ..ReplaySpec::default() });
    assert_eq!(
        due(&rounds),
        [0.0, 0.005, 0.01, 0.5, 0.505, 0.51],
        "a round ends one period after its last row"
    );
}

#[test]
fn table_of_a_bench_is_replayed_through_its_mapping() {
    let folder = folder();
    std::fs::write(
        folder.path().join("run.csv"),
        "Time (ms);P (kPa);Load (gf)\n100;10,0;100\n105;20,0;200\n110;;300\n",
    )
    .unwrap();
    let channel = |name: &str, column: &str, unit: &str| {
        format!("[[input]]\nname = \"{name}\"\ncolumn = \"{column}\"\nunit = \"{unit}\"\n")
    };
    let mapping = format!(
        "[time]\ncolumn = 1\nunit = \"ms\"\n{}{}",
        channel("pressure_mpa", "P", "kPa"),
        channel("load_n", "Load", "gf")
    );
    std::fs::write(folder.path().join("log.toml"), mapping).unwrap();
    let spec = ReplaySpec { trace: "run.csv".into(), log: Some("log.toml".into()), ..ReplaySpec::default() };
    let open = |names: &[&str]| {
        SourceSpec::Replay(spec.clone()).open(folder.path(), &InputNames::new(names.iter().copied()))
    };
    let readings = take(open(&["load_n"]).unwrap(), 9);
    let due: Vec<f64> = readings.iter().map(|reading| (reading.due_s * 1e6).round() / 1e6).collect();
    assert_eq!(due, [0.0, 0.005, 0.01]);
    assert!((readings[1].sample.pressure_mpa - 0.02).abs() < 1e-12);
    assert!((readings[1].sample.inputs[0] - 1.961_33).abs() < 1e-9, "{:?}", readings[1].sample);
    assert!(readings[2].sample.pressure_mpa.is_nan());
    assert!(open(&["torque_nmm"]).is_err(), "an input that the mapping lacks");
}

#[test]
fn profiles_have_their_shape() {
    let flow = Profile::ConstantFlow {
        flow_ml_per_min: 125.0,
        volume_mm3: 6711.6,
        compliance_mm3_per_mpa: 60000.0,
        until_mpa: 0.07,
    };
    for t_s in [0.0, 0.5, 2.0, 4.0] {
        let p = flow.pressure_mpa(t_s);
        let inside = (p + 0.101325) * (6711.6 + 60000.0 * p);
        let filled = 0.101325 * (6711.6 + 125.0e3 / 60.0 * t_s);
        assert!((inside - filled).abs() < 1e-9 * filled, "gas law at {t_s} s: {inside} against {filled}");
    }
    assert_eq!(flow.pressure_mpa(60.0), 0.07);
    let ramp = Profile::Ramp { from_mpa: 0.01, to_mpa: 0.05, rise_s: 2.0 };
    assert_eq!([ramp.pressure_mpa(0.0), ramp.pressure_mpa(1.0), ramp.pressure_mpa(9.0)], [0.01, 0.03, 0.05]);
    let step = Profile::Step { low_mpa: 0.0, high_mpa: 0.05, at_s: 1.0 };
    assert_eq!([step.pressure_mpa(0.999), step.pressure_mpa(1.0)], [0.0, 0.05]);
    let sine = Profile::Sine { mean_mpa: 0.03, amplitude_mpa: 0.02, frequency_hz: 0.5 };
    assert!((sine.pressure_mpa(0.0) - 0.01).abs() < 1e-15 && (sine.pressure_mpa(1.0) - 0.05).abs() < 1e-15);
}

#[test]
fn wrong_specifications_are_refused_with_all_problems() {
    let spec = SimulateSpec {
        rate_hz: 0.0,
        noise_mpa: -1.0,
        duration_s: f64::NAN,
        profile: Profile::Ramp { from_mpa: f64::NAN, to_mpa: 0.0, rise_s: 0.0 },
        ..SimulateSpec::default()
    };
    let problems = SourceSpec::Simulate(spec).open(Path::new("."), &InputNames::default()).unwrap_err();
    assert_eq!(problems.len(), 5, "{problems:#?}");
    for (rate_hz, rise_s) in
        [(1e308, 1.0), (1e-300, 1.0), (200.0, 1e300), (200.0, 1e-300), (f64::INFINITY, 1.0)]
    {
        let profile = Profile::Ramp { from_mpa: 0.0, to_mpa: 0.01, rise_s };
        let spec = SourceSpec::Simulate(SimulateSpec { rate_hz, profile, ..SimulateSpec::default() });
        let problems = spec.open(Path::new("."), &InputNames::default()).unwrap_err();
        assert_eq!(problems.len(), 1, "{rate_hz} Hz, {rise_s} s: {problems:#?}");
    }
    let missing = SourceSpec::replay_of("no-such-file.csv".into())
        .open(Path::new("."), &InputNames::default())
        .unwrap_err();
    assert!(missing[0].contains("no-such-file.csv"), "{missing:?}");
    let folder = folder();
    let nothing = ReplaySpec { trace: "trace.csv".into(), from_s: 9.0, ..ReplaySpec::default() };
    let problems = SourceSpec::Replay(nothing).open(folder.path(), &InputNames::default()).unwrap_err();
    assert!(problems[0].contains("source.from_s") && problems[0].contains("trace.csv"), "{problems:?}");
}

#[test]
fn broken_traces_are_refused_with_the_line() {
    let places = |text: &str| -> Vec<(String, String)> {
        let place = |error: TraceError| match error {
            TraceError::Table(found) => (found.place, found.found),
            other => panic!("{other}"),
        };
        SensorTrace::parse(text).unwrap_err().into_iter().map(place).collect()
    };
    let found = |place: &str, found: &str| (place.to_owned(), found.to_owned());
    let missing = || found("header", "none of that name");
    assert_eq!(places("t_s,gap_mm\n0,40\n"), [missing()]);
    assert_eq!(places("a,b\n0,1\n"), [missing(), missing()]);
    assert_eq!(
        places("# c\nt_s,pressure_mpa\n0,0.1\n0.1,stray\n0.2,\n"),
        [found("line 4, column pressure_mpa", "`stray`"), found("line 5, column pressure_mpa", "``")]
    );
    assert_eq!(places("t_s,pressure_mpa\n1,0\n0.5,0\n"), [found("line 3, column t_s", "`0.5`")]);
    for column in ["gap_cm", "gap", "Measured_Force_mN", "marker1_x_m"] {
        let header = format!("t_s,pressure_mpa,{column}\n0,1,2\n");
        assert_eq!(places(&header), [found("header", &format!("`{column}`"))]);
    }
    let both = places("t_s,pressure_kpa,gap_mm\n0,1,2\n");
    assert_eq!(both, [missing(), found("header", "`pressure_kpa`")]);
    assert_eq!(places(""), [missing(), missing()]);
    assert_eq!(SensorTrace::parse("t_s,pressure_mpa\n").unwrap_err(), [TraceError::Empty]);
}

#[test]
fn traces_that_are_no_table_are_refused_in_time_and_in_few_words() {
    let folder = folder();
    let path = folder.path().join("trace.csv");
    let wide = (0..1_000_000).map(|at| format!(",c{at}")).collect::<String>();
    let long = format!(",{}", "c".repeat(1_000_000));
    let twice = format!("t_s,pressure_mpa{}\n0,0\n", ",c".repeat(9_000));
    for (bytes, most) in [
        (format!("t_s,pressure_mpa{wide}\n0,0{wide}\n").into_bytes(), 1),
        ([&[0x1f, 0x8b, 8, 0][..], b"t_s,pressure_mpa\n0,0\n"].concat(), 1),
        (format!("t_s,pressure_mpa{long}{long}\n0,0\n").into_bytes(), 1),
        (twice.into_bytes(), 1),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let errors = SensorTrace::read(&path).unwrap_err();
        let text: String = errors.iter().map(ToString::to_string).collect();
        assert!(errors.len() == most && text.len() < 4000, "{} errors, {} bytes", errors.len(), text.len());
    }
}

/// Columns of measured inputs: each is required, a pressure is not, and the values are unchanged.
#[test]
fn named_inputs_are_columns_of_a_trace() {
    let names = InputNames::new(["load_n", "shift_mm"]);
    let text = "t_s,shift_mm,measured_force_n,load_n\n0,1.5,7,2.25\n0.1,nan,8,-inf\n";
    let trace = SensorTrace::parse_named(text, &names).unwrap();
    let [first, second] = &trace.rows[..] else { panic!("{:?}", trace.rows) };
    let named: Vec<(String, f64)> = first.inputs().collect();
    assert_eq!(named, [("load_n".to_owned(), 2.25), ("shift_mm".to_owned(), 1.5)]);
    assert!(first.pressure_mpa.is_nan() && first.measured_force_n == 7.0);
    assert!(second.inputs[0] == f64::NEG_INFINITY && second.inputs[1].is_nan());
    let problems = SensorTrace::parse_named("t_s,pressure_mpa,load_n\n0,0.1,1\n", &names).unwrap_err();
    assert!(matches!(&problems[0], TraceError::Table(error) if error.expected.contains("shift_mm")));
    let problems = SensorTrace::parse_named("t_s,load_n,shift_mm\n0,1,\n", &names).unwrap_err();
    assert!(problems[0].to_string().contains("line 2, column shift_mm"), "{problems:?}");
    let unnamed = SensorTrace::parse("t_s,pressure_mpa,load_n\n0,0.1,1\n").unwrap();
    assert_eq!(unnamed.rows[0].input_count, 0, "other columns are ignored");
    let source = SourceSpec::Simulate(SimulateSpec::default());
    let refused = source.open(Path::new("."), &names).unwrap_err();
    assert!(refused[0].contains("load_n"), "{refused:?}");
}

#[test]
fn values_that_a_gauge_can_say_are_passed_on_and_gaps_in_time_are_noted() {
    let trace = SensorTrace::parse(TRACE).unwrap();
    assert_eq!(trace.gaps, [(6, 0.49)]);
    let odd = SensorTrace::parse("t_s,pressure_mpa\n0,nan\n0.1,inf\n0.2,-5\n").unwrap();
    assert!(odd.rows[0].pressure_mpa.is_nan() && odd.rows[1].pressure_mpa.is_infinite());
    assert!(odd.rows[2].gap_mm.is_nan());
}

#[test]
fn the_projects_own_traces_are_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/traces");
    for (file, gap_mm) in [("gap80.csv", 80.0), ("gap40.csv", 40.0), ("gap15.csv", 15.0)] {
        let trace =
            SensorTrace::read(&folder.join(file)).unwrap_or_else(|errors| panic!("{file}: {errors:?}"));
        assert!((trace.period_s - 0.005).abs() < 1e-9, "{file} is not sampled at 200 Hz");
        assert!(trace.rows.iter().all(|row| row.gap_mm == gap_mm) && trace.gaps.is_empty());
    }
}

proptest! {
    /// Columns in any order: each value is that of its column. A column twice, or one that is named as another, is refused.
    #[test]
    fn columns_in_any_order_have_their_values(
        order in Just((0_usize..7).collect::<Vec<_>>()).prop_shuffle(),
        values in prop::collection::vec(prop::array::uniform7(-9.0_f64..9.0), 1..5),
        twice in 0_usize..7,
        at in 0_usize..7,
    ) {
        let names = ["t_s", "pressure_mpa", "gap_mm", "measured_force_n", "marker1_x_mm", "marker1_y_mm", "marker1_z_mm"];
        let cell = |row: usize, column: usize| if column == 0 { row as f64 } else { values[row][column] };
        let table = |columns: &[usize], name: &dyn Fn(usize) -> String| {
            let line = |cell: &dyn Fn(usize) -> String| {
                columns.iter().map(|column| cell(*column)).collect::<Vec<_>>().join(",") + "\n"
            };
            let rows = (0..values.len()).map(|row| line(&|column| cell(row, column).to_string()));
            line(name) + &rows.collect::<String>()
        };
        let named = |column: usize| names[column].to_owned();
        let trace = SensorTrace::parse(&table(&order, &named)).unwrap();
        prop_assert_eq!(trace.rows.len(), values.len());
        for (k, row) in trace.rows.iter().enumerate() {
            let marker = row.markers_mm[0];
            let found =
                [row.t_trace_s, row.pressure_mpa, row.gap_mm, row.measured_force_n, marker.x, marker.y, marker.z];
            for (column, found) in found.into_iter().enumerate() {
                prop_assert_eq!(found, cell(k, column), "{} of row {}", names[column], k);
            }
        }
        let mut longer = order.clone();
        longer.insert(at, twice);
        prop_assert!(SensorTrace::parse(&table(&longer, &named)).is_err(), "{} twice", names[twice]);
        let other = (twice + 1 + at % 6) % 7;
        let renamed = |column: usize| named(if column == twice { other } else { column });
        prop_assert!(SensorTrace::parse(&table(&order, &renamed)).is_err(), "{} as {}", names[twice], names[other]);
    }

    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        if let Ok(trace) = SensorTrace::parse(&text) {
            prop_assert!(!trace.rows.is_empty());
        }
    }

    #[test]
    fn any_cells_are_answered(cells in prop::collection::vec("[-0-9.einfa# ,]{0,12}", 0..12)) {
        let text = format!("t_s,pressure_mpa,gap_mm\n{}", cells.join("\n"));
        if let Ok(trace) = SensorTrace::parse(&text) {
            prop_assert!(trace.rows.windows(2).all(|pair| pair[1].t_trace_s >= pair[0].t_trace_s));
        }
    }
}
