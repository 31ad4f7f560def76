//! The newest readings of every actuator, for the strip charts: all of them, however few frames a page draws.

use page::frame::{bits, encode};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use wire::{Estimate, FieldHeader, State};

/// Readings of one actuator that wait for pages: eight seconds at 1 kHz.
const KEPT: usize = 8192;
/// Values sent for a state or a field, in this order; NaN if unknown.
const COLUMNS: [&str; 6] =
    ["pressure_mpa", "contact_force_n", "measured_force_n", "gap_mm", "max_von_mises_mpa", "latency_ms"];

/// One published state, field or estimate, as the strip charts draw it.
#[derive(Clone, Debug)]
pub struct Reading {
    t_s: f64,
    values: Vec<f32>,
    /// Names of an estimate's quantities.
    unknowns: Option<Vec<String>>,
}

impl Reading {
    /// Values of a state.
    pub fn of_state(state: &State) -> Self {
        let latency_ns = state.t_publish_ns.saturating_sub(state.t_sensor_ns);
        let latency_ms = if state.t_sensor_ns > 0 { latency_ns as f64 * 1e-6 } else { f64::NAN };
        let values = [
            state.pressure_mpa,
            state.contact_force_n,
            state.measured_force_n,
            state.gap_mm,
            f64::NAN,
            latency_ms,
        ];
        Self::new(state.t_publish_ns, &values)
    }

    /// Values of a field's header; only its stress if there are states.
    pub fn of_field(header: &FieldHeader, has_states: bool) -> Self {
        let known = |value: f64| if has_states { f64::NAN } else { value };
        let values = [
            known(header.pressure_mpa),
            known(header.contact_force_n),
            f64::NAN,
            known(header.gap_mm),
            header.max_von_mises_mpa,
            f64::NAN,
        ];
        Self::new(header.t_publish_ns, &values)
    }

    /// Values of an estimate: the quantities, then their standard deviations.
    pub fn of_estimate(estimate: &Estimate) -> Self {
        let count = estimate.unknown_count.min(wire::layout::UNKNOWNS_MAX as u32) as usize;
        let values = estimate.values.iter().take(count).chain(estimate.sigmas.iter().take(count)).copied();
        let values: Vec<f64> = values.collect();
        let unknowns = Some((0..count).map(|at| estimate.name(at)).collect());
        Self { unknowns, ..Self::new(estimate.t_publish_ns, &values) }
    }

    fn new(t_publish_ns: u64, values: &[f64]) -> Self {
        let values = values.iter().map(|value| *value as f32).collect();
        Self { t_s: t_publish_ns as f64 * 1e-9, values, unknowns: None }
    }

    /// Names of the values.
    fn columns(&self) -> Vec<String> {
        let Some(unknowns) = &self.unknowns else { return COLUMNS.map(str::to_owned).to_vec() };
        let named = |prefix: &'static str| unknowns.iter().map(move |name| format!("{prefix} {name}"));
        named("estimate").chain(named("sigma")).collect()
    }
}

/// An actuator, and whether its estimates are meant.
type Source = (String, bool);

/// The newest readings by source, with how many there were before them.
#[derive(Debug, Default)]
pub struct Readings(BTreeMap<Source, (u64, VecDeque<Reading>)>);

/// For each source how many readings a page has.
pub type Cursors = BTreeMap<Source, u64>;

/// Header of a message of readings: behind it the seconds after `origin_s`, then the columns, `count` numbers each.
#[derive(Serialize)]
struct Head<'a> {
    kind: &'static str,
    actuator: &'a str,
    columns: Vec<String>,
    count: usize,
    origin_s: f64,
}

impl Readings {
    /// Adds a reading; the oldest of a full list goes.
    pub fn push(&mut self, actuator: &str, reading: Reading) {
        let source = (actuator.to_owned(), reading.unknowns.is_some());
        let (gone, kept) = self.0.entry(source).or_default();
        if kept.len() == KEPT {
            kept.pop_front();
            *gone += 1;
        }
        kept.push_back(reading);
    }

    /// One message for each actuator that has readings which the browser has not, and the browser has them.
    pub fn since(&self, cursors: &mut Cursors) -> Vec<Vec<u8>> {
        let mut messages = Vec::new();
        for (source @ (actuator, _), (gone, kept)) in &self.0 {
            let had = cursors.insert(source.clone(), gone + kept.len() as u64).unwrap_or(0);
            let new: Vec<&Reading> = kept.iter().skip(had.saturating_sub(*gone) as usize).collect();
            let Some(first) = new.first() else { continue };
            let columns = first.columns();
            let width = columns.len();
            let head = Head { kind: "readings", actuator, columns, count: new.len(), origin_s: first.t_s };
            let times = bits(new.iter().map(|reading| (reading.t_s - first.t_s) as f32));
            // After a reload there may be fewer quantities.
            let value = |reading: &Reading, k: usize| reading.values.get(k).copied().unwrap_or(f32::NAN);
            let values = (0..width).flat_map(|k| new.iter().map(move |reading| value(reading, k)));
            messages.push(encode(&head, &[&times, &bits(values)]));
        }
        messages
    }
}

#[cfg(test)]
#[path = "../tests/unit/readings.rs"]
mod tests;
