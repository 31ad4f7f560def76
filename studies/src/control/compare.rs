//! The controller compared with a PI and with the inverse and a PI, on three plants: steps of the force, steps and a sine of the tip.

use super::laws::{InversePi, Pi};
use crate::plant::Truth;
use crate::plant::table::PlantTable;
use control::inverse::Quantity;
use control::law::{Controller, Target};
use control::plant::{Plant, PlantSpec};
use control::settings::{LawKind, Limits, Settings};
use control::trial::{Law, Loop, Moment, SineFigures, StepFigures, Trial, sine_figures, step_figures};
use control::twin_model::{Tip, TwinModel};
use rom::memory::{Line, Play};
use serde::Serialize;
use softtwin::failure::usage;

/// Parts of every trial.
pub struct Bench {
    /// The controller's model.
    pub model: rom::model::Model,
    /// The plant's body.
    pub table: PlantTable,
}

/// A plant with what is known of it.
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// The plant.
    pub spec: PlantSpec,
    /// Shown minus true gap, mm.
    pub gap_error_mm: f64,
}

/// Targets of the force, N, and of the tip, mm, each held for [`HOLD_S`].
pub const TARGETS_N: [f64; 7] = [0.1, 0.5, 0.1, 0.3, 0.4, 0.2, 0.5];
const TARGETS_MM: [f64; 4] = [-50.0, -60.0, -55.0, -60.0];
/// Duration of each, s.
pub const HOLD_S: f64 = 5.0;
/// Sine of the tip: mean and amplitude, mm, frequency, Hz.
const SINE: [f64; 3] = [-60.0, 3.0, 0.5];
/// Control cycles per second.
pub const RATE_HZ: f64 = 200.0;
/// Gains of the PI for the force (MPa/N) and the tip (MPa/mm): the best of a grid on the first plant.
const PI_GAINS: [[f64; 2]; 2] = [[0.04, 0.12], [-4e-4, -1.2e-3]];
/// Gains of the PI of the inverse: the best of a grid on the first plant.
const INVERSE_GAINS: [f64; 2] = [0.1, 1.5];

/// The plants: the first as real fingers behave, the others faster and slower.
pub fn cases() -> Vec<Case> {
    let play = |plays: &[[f64; 2]]| {
        plays.iter().map(|[threshold, weight]| Play { threshold: *threshold, weight: *weight }).collect()
    };
    let like = PlantSpec::default;
    vec![
        Case {
            name: "finger",
            gap_error_mm: 0.0,
            spec: PlantSpec {
                line: Line { fill_s: 0.3, empty_s: 1.2 },
                play: play(&[[2.25e-3, 1.0]]),
                swing_hz: 4.0,
                gauge_bias_mpa: 1e-3,
                stiffness: 0.9,
                true_gap_mm: 37.0,
                ..like()
            },
        },
        Case {
            name: "short and stiff",
            gap_error_mm: 3.0,
            spec: PlantSpec {
                line: Line { fill_s: 0.1, empty_s: 0.35 },
                play: play(&[[1e-3, 0.8]]),
                swing_hz: 9.0,
                swing_damping: 0.04,
                delay_s: 0.02,
                gauge_bias_mpa: -5e-4,
                valve_offset_mpa: 5e-4,
                stiffness: 1.1,
                true_gap_mm: 37.0,
                ..like()
            },
        },
        Case {
            name: "long and soft",
            gap_error_mm: -2.0,
            spec: PlantSpec {
                line: Line { fill_s: 0.5, empty_s: 1.0 },
                play: play(&[[1e-3, 0.5], [3e-3, 0.3]]),
                swing_hz: 2.5,
                swing_damping: 0.05,
                delay_s: 0.015,
                valve_offset_mpa: -5e-4,
                stiffness: 0.85,
                true_gap_mm: 34.0,
                ..like()
            },
        },
    ]
}

/// Settings from line, play, delay and swing of a plant, as a bench test gives them.
pub fn known(spec: &PlantSpec) -> Settings {
    let (line, play, delay_s) = (spec.line, spec.play.clone(), spec.delay_s + spec.valve_s);
    Settings { line, play, delay_s, ..Settings::default() }.with_swing(spec.swing_hz, spec.swing_damping)
}

/// The plant with the frequency that its stiffness gives, and changes of stiffness, lag and play.
pub fn changed(spec: &PlantSpec, [stiffness, lag, play]: [f64; 3]) -> PlantSpec {
    let mut spec = spec.clone();
    spec.stiffness *= stiffness;
    spec.swing_hz *= spec.stiffness.sqrt();
    spec.line = Line { fill_s: lag * spec.line.fill_s, empty_s: lag * spec.line.empty_s };
    spec.play.iter_mut().for_each(|operator| operator.threshold *= play);
    spec
}

/// Figures of a law on a plant.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Plant.
    pub plant: &'static str,
    /// Law.
    pub law: &'static str,
    /// Change of the plant.
    pub change: &'static str,
    /// Steps of the force.
    pub force: Vec<StepFigures>,
    /// Steps of the tip.
    pub tip: Vec<StepFigures>,
    /// Sine of the tip.
    pub sine: SineFigures,
    /// A fault ended it.
    pub fault: Option<&'static str>,
}

/// Cycles of the force on the first plant, by law, for the picture.
pub type Runs = Vec<(&'static str, Vec<Moment>)>;

/// Changes of the plant that settings do not know of: factors of stiffness, lag and play.
const CHANGES: [(&str, [f64; 3]); 5] = [
    ("as known", [1.0, 1.0, 1.0]),
    ("20 % stiffer", [1.2, 1.0, 1.0]),
    ("20 % softer", [0.8, 1.0, 1.0]),
    ("lag x 2", [1.0, 2.0, 1.0]),
    ("play x 2", [1.0, 1.0, 2.0]),
];

/// The laws of `softtwin hold`.
const LAWS: [(&str, LawKind); 2] = [("inverse", LawKind::Inverse), ("predictive", LawKind::Predictive)];

/// Cycles, steps, and of the tip a sine.
type Followed = (Vec<Moment>, Vec<StepFigures>, SineFigures);

/// All rows: every law on every plant, and the controller on every change.
pub fn measure(bench: &Bench) -> anyhow::Result<(Vec<Row>, Runs)> {
    let (mut rows, mut runs) = (Vec::new(), Runs::new());
    for (index, case) in cases().iter().enumerate() {
        let settings = known(&case.spec);
        let range_mpa = Limits::default().range_mpa;
        for (change, factors) in CHANGES {
            let spec = changed(&case.spec, factors);
            let mut add = |law: &'static str, [force, tip]: [anyhow::Result<Followed>; 2]| {
                let ((moments, force, _), (of_tip, tip, sine)) = (force?, tip?);
                let fault =
                    moments.iter().chain(&of_tip).find_map(|moment| moment.fault).map(|fault| fault.name());
                rows.push(Row { plant: case.name, law, change, force, tip, sine, fault });
                if index == 0 && change == CHANGES[0].0 {
                    runs.push((law, moments));
                }
                anyhow::Ok(())
            };
            let quantities = [Quantity::Force, Quantity::Observable];
            for (name, law) in LAWS {
                let of = |quantity| {
                    run(bench, case, &spec, quantity, |model| {
                        let settings = Settings { law, ..settings.clone() };
                        Controller::new(model, quantity, settings, Limits::default())
                    })
                };
                add(name, quantities.map(of))?;
            }
            if change != CHANGES[0].0 {
                continue;
            }
            let (line, state_mpa) = (settings.line, [0.0; 2]);
            let of = |quantity| {
                run(bench, case, &spec, quantity, |model| InversePi {
                    model,
                    quantity,
                    line,
                    reference_s: 0.3,
                    gains: INVERSE_GAINS,
                    range_mpa,
                    state_mpa,
                })
            };
            add("inverse and PI", quantities.map(of))?;
            let of = |quantity| {
                let gains = PI_GAINS[usize::from(quantity == Quantity::Observable)];
                run(bench, case, &spec, quantity, |_| Pi { gains, range_mpa, sum_mpa: 0.0 })
            };
            add("PI", quantities.map(of))?;
        }
    }
    Ok((rows, runs))
}

/// Steps of one quantity, and for the tip a sine.
fn run<L: Law>(
    bench: &Bench,
    case: &Case,
    spec: &PlantSpec,
    quantity: Quantity,
    law: impl FnOnce(TwinModel) -> L,
) -> anyhow::Result<Followed> {
    let model = TwinModel::new(&bench.model, Tip::REFERENCE).map_err(usage)?;
    let is_tip = quantity == Quantity::Observable;
    let (targets, mut spec) = (if is_tip { &TARGETS_MM[..] } else { &TARGETS_N }, spec.clone());
    if is_tip {
        spec.true_gap_mm = f64::INFINITY; // no plate: the tip moves freely
    }
    let trial = Trial { quantity, is_measured: true, gap_error_mm: case.gap_error_mm, rate_hz: RATE_HZ };
    let mut under_way = Loop::new(law(model), Plant::new(spec, Truth::Table(bench.table.clone())), trial);
    let (mut moments, mut steps): (Vec<Moment>, Vec<StepFigures>) = Default::default();
    for target in targets {
        let begin = moments.len();
        let from = steps.last().map_or(if is_tip { f64::NAN } else { 0.0 }, |step| step.step[1]);
        under_way.hold(*target, HOLD_S, &mut moments);
        let from = if from.is_nan() { moments[begin].truth } else { from };
        steps.extend(step_figures(from, &moments[begin..], |moment| moment.truth));
    }
    let (begin, [mean, amplitude, hz]) = (moments.len(), SINE);
    if is_tip {
        let w = std::f64::consts::TAU * hz;
        let sine = |t_s: f64| Target {
            value: mean + amplitude * (w * t_s).sin(),
            rate: amplitude * w * (w * t_s).cos(),
        };
        under_way.follow(sine, 12.0, &mut moments);
    }
    // The first period is the way to the sine.
    let periods = moments.get(begin + (RATE_HZ / hz) as usize..).unwrap_or_default();
    let sine = sine_figures(hz, periods);
    Ok((moments, steps, sine))
}

impl Row {
    /// As a line of a table.
    pub fn text(&self) -> String {
        let worst = |steps: &[StepFigures], value: &dyn Fn(&StepFigures) -> f64| {
            steps.iter().map(value).fold(0.0, f64::max)
        };
        let settling = |steps: &[StepFigures], is_up: bool| {
            let slow = steps.iter().filter(|step| (step.step[1] > step.step[0]) == is_up);
            slow.map(|step| step.settling_s.unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
        };
        let SineFigures { amplitude, lag_deg, .. } = self.sine;
        format!(
            "| {} | {} | {} | {:.1} | {:.2}, {:.2} | {:.1} | {:.1} | {:.2}, {:.2} | {:.0} | {:.0} | {} |\n",
            self.plant,
            self.law,
            self.change,
            100.0 * worst(&self.force, &|step| step.overshoot),
            settling(&self.force, true),
            settling(&self.force, false),
            1e3 * worst(&self.force, &|step| step.final_error.abs()),
            100.0 * worst(&self.tip, &|step| step.overshoot),
            settling(&self.tip, false),
            settling(&self.tip, true),
            100.0 * amplitude,
            lag_deg,
            self.fault.unwrap_or("-")
        )
    }

    /// Head of the table.
    pub const HEAD: &str = "| plant | law | plant is | force: overshoot, % | settled up, down, s | error at the end, mN | tip: overshoot, % | settled down, up, s | sine: amplitude, % | lag, deg | fault |\n\
        | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";
}
