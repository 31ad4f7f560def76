//! Observables that sensors measure, in the estimation of a running twin.

use crate::estimate::{ROOT, committed, inflation};
use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::observable::Observables;
use rom::rng::Rng;
use tests::wait::wait_for;
use tests::{Program, Stage};
use wire::layout::{estimate_alarm, estimate_status};
use wire::{EstimateReader, Topic};

#[test]
fn running_twin_estimates_gap_and_bias_by_a_measured_angle() {
    let stage = Stage::new("estimate-angle");
    let (model, truth) = (committed("pneunet"), [46.0, 0.0012]);
    let (observables, evaluator) =
        (Observables::of(&model).expect("observables"), Evaluator::new(&model.header).expect("a model"));
    let angle = observables.names().position(|name| name == "bending_angle_deg").expect("the angle");
    let (mut evaluation, mut random) = (evaluator.evaluation(), Rng::new(5));
    let mut noise = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let mut row = |(t_s, pressure_mpa): (f64, f64)| {
        evaluator.evaluate(Inputs::new(pressure_mpa, truth[0]), &mut evaluation);
        let angle_deg = observables.value(angle, &evaluation).value + 0.3 * noise();
        format!("{t_s},{},{angle_deg}\n", pressure_mpa + truth[1] + 0.0005 * noise())
    };
    let rows: String = inflation().into_iter().map(&mut row).collect();
    stage.write("run.csv", &format!("t_s,pressure_mpa,bending_angle_deg\n{rows}"));
    let scene = stage.write(
        "angle.toml",
        &format!(
            "name = \"angle\"\n[[actuator]]\nname = \"finger\"\nmodel = \"{ROOT}/models/pneunet/pneunet.twin\"\nbacklog = 16\n\
             [actuator.estimate]\ngap_mm = {{ prior = 40.0, sigma = 15.0 }}\npressure_bias_mpa = {{ prior = 0.0, sigma = 0.002 }}\n\
             [actuator.observables]\nbending_angle_deg = {{ sigma = 0.3, model_sigma = 0.1 }}\n\
             [actuator.source]\nkind = \"replay\"\ntrace = \"run.csv\"\nspeed = 5.0\n[[actuator.output]]\nnodes = \"all\"\n"
        ),
    );
    let _twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let estimates =
        EstimateReader::attach(&bus, &Topic::estimate("finger").expect("a topic")).expect("a reader");
    let _bridge = Program::bridge(&stage, &scene);
    let last = wait_for(&estimates, "identifiable gap and bias", |reader| {
        let newest = reader.newest().expect("readable")?;
        (newest.identifiable == 0b11).then_some(newest)
    });
    assert_eq!((last.status, last.alarm), (estimate_status::USED, estimate_alarm::NONE), "{last:?}");
    for (at, truth) in truth.into_iter().enumerate() {
        assert!((last.values[at] - truth).abs() < 4.0 * last.sigmas[at], "{last:?}");
    }
}
