//! The soak test's judge: takes fields and states off the wire and computes each again from its own copy of the model.
//!
//! A sample is wrong when a single bit of it differs. `soak_reader MODEL ACTUATOR SECONDS EVERY_MS` looks at the newest
//! field each EVERY_MS milliseconds and at every state, and ends with one JSON object. SOFTTWIN_DOMAIN and SOFTTWIN_ROOT
//! say where. It runs on the machine of the twin: another processor may round a fused product otherwise.

use rom::evaluation::{Evaluation, Input};
use rom::model::Model;
use rom::predict::{Nodes, Predictor, Selection};
use rom::regime::RegimeSwitch;
use std::time::{Duration, Instant};
use wire::layout::{COEFFICIENTS_MAX, flags};
use wire::{Bus, Domain, FieldReader, FieldSample, State, StateReader, Topic, WakeSet, Wakeable};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let usage = "usage: soak_reader MODEL ACTUATOR SECONDS EVERY_MS";
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, actuator, seconds, every_ms] = arguments.as_slice() else { return Err(usage.into()) };
    let mut judge = Judge::new(&Model::from_bytes(&std::fs::read(model)?)?)?;
    let bus = Bus::open(&Domain::from_env())?;
    let fields = FieldReader::attach(&bus, &Topic::field(actuator, None)?)?;
    let states = StateReader::attach(&bus, &Topic::state(actuator)?)?;
    let end = Instant::now() + Duration::from_secs_f64(seconds.parse()?);
    let every = Duration::from_millis(every_ms.parse()?);
    let mut next = Instant::now();
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);
    while Instant::now() < end {
        wake.wait([&states as &dyn Wakeable], every)?;
        while let Some(state) = states.next()? {
            judge.state(&state);
        }
        if Instant::now() >= next {
            next = Instant::now() + every;
            if let Some(sample) = fields.newest()? {
                judge.field(&sample);
            }
        }
    }
    println!("{}", judge.report());
    Ok(())
}

/// What was checked and what was wrong.
struct Judge {
    predictor: Predictor,
    evaluation: Evaluation,
    expected: Vec<f32>,
    fields: u64,
    wrong_fields: u64,
    states: u64,
    wrong_states: u64,
    /// States that came out of order within a run of the twin.
    disordered: u64,
    /// Run and number of the newest state.
    newest: (u64, u64),
}

impl Judge {
    fn new(model: &Model) -> Result<Self, rom::predict::PredictError> {
        let predictor = Predictor::new(model, &Selection { fields: None, nodes: Nodes::All })?;
        Ok(Self {
            evaluation: predictor.evaluation(),
            expected: vec![0.0; predictor.entries()],
            predictor,
            fields: 0,
            wrong_fields: 0,
            states: 0,
            wrong_states: 0,
            disordered: 0,
            newest: (0, 0),
        })
    }

    fn evaluate(&mut self, pressure_mpa: f64, gap_mm: f64) {
        // Only the label has a memory; values follow pressure and gap alone.
        let mut switch = RegimeSwitch::default();
        self.predictor.evaluate(Input { pressure_mpa, gap_mm }, &mut switch, &mut self.evaluation);
    }

    fn state(&mut self, state: &State) {
        let (run, seq) = self.newest;
        self.disordered += u64::from(state.boot_id == run && state.seq <= seq);
        self.newest = (state.boot_id, state.seq);
        if state.flags & flags::NO_DATA != 0 {
            return;
        }
        self.evaluate(state.pressure_mpa, state.gap_mm);
        let coefficients = self.evaluation.coefficients.iter().take(COEFFICIENTS_MAX);
        let coefficients = coefficients.map(|a| (*a as f32).to_bits());
        let same = state.contact_force_n.to_bits() == self.evaluation.contact_force_n.to_bits()
            && state.coefficients().iter().map(|a| a.to_bits()).eq(coefficients);
        self.states += 1;
        self.wrong_states += u64::from(!same);
    }

    fn field(&mut self, sample: &FieldSample) {
        let header = sample.header();
        self.evaluate(header.pressure_mpa, header.gap_mm);
        let computed = self.predictor.reconstruct_into(&self.evaluation, &mut self.expected).is_ok();
        let same = sample.values().len() == self.expected.len()
            && sample
                .values()
                .iter()
                .zip(&self.expected)
                .all(|(found, wanted)| found.to_bits() == wanted.to_bits());
        self.fields += 1;
        self.wrong_fields += u64::from(!(computed && same));
    }

    fn report(&self) -> serde_json::Value {
        serde_json::json!({
            "fields_checked": self.fields, "wrong_fields": self.wrong_fields,
            "states_checked": self.states, "wrong_states": self.wrong_states,
            "states_out_of_order": self.disordered,
        })
    }
}
