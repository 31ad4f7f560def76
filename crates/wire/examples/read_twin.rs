//! Reads one state and one field of a running twin, then asks it two questions.
#![forbid(unsafe_code)]

use std::io::Write;
use std::time::Duration;
use wire::layout::{field_id, query_kind};
use wire::{Bus, Domain, FieldReader, Query, QueryClient, StateReader, Topic, WakeSet, Wakeable};

fn main() -> anyhow::Result<()> {
    let mut out = std::io::stdout();
    let bus = Bus::open(&Domain::from_env())?;

    // One wait for any number of readers; samples are taken until none is left.
    let states = StateReader::open(&bus, &Topic::state("finger")?)?;
    let fields = FieldReader::open(&bus, &Topic::field("finger", None)?)?;
    let mut wake = WakeSet::new([&states as &dyn Wakeable, &fields]);
    let (mut state, mut field) = (None, None);
    while state.is_none() || field.is_none() {
        wake.wait(Duration::from_secs(5))?;
        state = states.newest()?.or(state);
        field = fields.newest()?.or(field); // shared memory, held until it is dropped
    }
    if let (Some(state), Some(field)) = (state, field) {
        writeln!(
            out,
            "state {}: {:.4} N at {:.5} MPa",
            state.seq, state.contact_force_n, state.pressure_mpa
        )?;
        let stress = field.field(field_id::VON_MISES).unwrap_or(&[]);
        let largest = stress.iter().copied().fold(0.0, f32::max);
        writeln!(
            out,
            "field {}: {} nodes, largest stress {largest:.4} MPa",
            field.header().seq,
            stress.len()
        )?;
    }

    let mut twin = QueryClient::open(&bus, "finger")?;
    let whatif = Query { kind: query_kind::WHATIF, pressure_mpa: 0.05, gap_mm: 25.0, ..Query::default() };
    let sample = twin.ask(&whatif, Duration::from_secs(1))?;
    let answer = sample.answer();
    writeln!(out, "what if: {:.4} +- {:.4} N", answer.contact_force_n, answer.force_halfwidth_n)?;
    drop(sample); // gives its memory back

    let inverse = Query { kind: query_kind::PRESSURE, force_n: 1000.0, gap_mm: 25.0, ..Query::default() };
    let sample = twin.ask(&inverse, Duration::from_secs(1))?;
    match sample.answer().refusal() {
        Some(reason) => writeln!(out, "refused: {reason}")?,
        None => writeln!(out, "1000 N: {:.5} MPa", sample.answer().pressure_mpa)?,
    }
    Ok(())
}
