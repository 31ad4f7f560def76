//! The soak test's judge: takes fields and states off the wire and computes each again from its own copy of the model.
//!
//! A sample is wrong when a single bit of it differs. `soak_reader MODEL ACTUATOR SECONDS EVERY_MS` looks at the newest
//! field each EVERY_MS milliseconds and at every state, and ends with one JSON object. SOFTTWIN_DOMAIN and SOFTTWIN_ROOT
//! say where.

use std::time::{Duration, Instant};
use tests::judge::Judge;
use wire::{Bus, Domain, FieldReader, StateReader, Topic, WakeSet, Wakeable};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let usage = "usage: soak_reader MODEL ACTUATOR SECONDS EVERY_MS";
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, actuator, seconds, every_ms] = arguments.as_slice() else { return Err(usage.into()) };
    let mut judge = Judge::new(&std::fs::read(model)?);
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
