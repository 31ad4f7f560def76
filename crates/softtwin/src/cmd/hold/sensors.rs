//! Gauge and the sensor of the held quantity: the load cell, whose value states carry, or a marker, whose place the readings carry.

use super::held::Held;
use control::inverse::Quantity;
use runtime::config::{ActuatorSpec, CameraSpec};
use wire::{Bus, SensorReader, SensorSample, State, Topic, Waking};

pub(super) struct Sensors {
    pub(super) name: String,
    /// Readings, where a marker or the gauge before the memory is taken of them.
    readings: Option<SensorReader>,
    last: SensorSample,
    marker: Option<Marker>,
    has_memory: bool,
    quantity: Quantity,
}

struct Marker {
    /// Position in the scene and in the readings.
    at: usize,
    camera: CameraSpec,
    /// When the marker was seen last, ns.
    seen_ns: u64,
    /// Its last height, mm.
    height_mm: f64,
}

/// Longest time that a marker's height counts without a new one, ns.
const KEPT_NS: u64 = 100_000_000;

impl Sensors {
    pub(super) fn open(bus: &Bus, spec: &ActuatorSpec, held: &Held) -> anyhow::Result<Self> {
        let (quantity, has_memory) = (held.quantity, held.has_memory);
        let marker = held.marker.and_then(|at| Some((at, spec.markers.get(at)?)));
        let name = match (&marker, quantity) {
            (Some((_, marker)), _) => format!("marker {}", marker.name),
            (None, Quantity::Pressure) => "gauge".into(),
            (None, _) => "load cell".into(),
        };
        let camera = spec.camera;
        let marker = marker.map(|(at, _)| Marker { at, camera, seen_ns: 0, height_mm: f64::NAN });
        let topic = Topic::sensor(spec.sensor())?;
        let is_read = marker.is_some() || has_memory;
        let readings = is_read.then(|| SensorReader::attach_as(bus, &topic, Waking::Never)).transpose()?;
        Ok(Self { name, readings, last: SensorSample::default(), marker, has_memory, quantity })
    }

    /// Takes the reading behind a state; false if it is not there.
    pub(super) fn take(&mut self, state: &State) -> anyhow::Result<bool> {
        let Some(readings) = &self.readings else { return Ok(true) };
        let is_before =
            |last: &SensorSample| last.boot_id != state.sensor_boot_id || last.seq < state.sensor_seq;
        while is_before(&self.last) {
            let Some(sample) = readings.next()? else { break };
            self.last = sample;
        }
        Ok((self.last.boot_id, self.last.seq) == (state.sensor_boot_id, state.sensor_seq))
    }

    /// The gauge, MPa: of a twin with memory that of the reading, whose state has the pressure behind the memory.
    pub(super) fn pressure_mpa(&self, state: &State) -> f64 {
        if self.has_memory { self.last.pressure_mpa } else { state.pressure_mpa }
    }

    /// Measured value of the quantity in the reading behind a state; NaN if it has none.
    pub(super) fn measured(&mut self, state: &State) -> f64 {
        match (&mut self.marker, self.quantity) {
            (Some(marker), _) => marker.height_mm(&self.last, state.t_sensor_ns),
            (None, Quantity::Force) => state.measured_force_n,
            (None, Quantity::Pressure) => state.pressure_mpa,
            (None, Quantity::Observable) => f64::NAN,
        }
    }
}

impl Marker {
    /// The last height while it is young enough: a slow camera's value is in no reading in between.
    fn height_mm(&mut self, reading: &SensorSample, now_ns: u64) -> f64 {
        let age_ns = reading.ages_ns.markers.get(self.at).filter(|_| reading.age_count > 0);
        let taken_ns = reading.t_sensor_ns.saturating_sub(age_ns.copied().unwrap_or(0));
        let place_mm = reading.markers_mm.get(self.at).map(|marker| self.camera.in_actuator_mm(*marker));
        if let Some([_, y, _]) =
            place_mm.filter(|place_mm| place_mm[1].is_finite() && taken_ns > self.seen_ns)
        {
            (self.height_mm, self.seen_ns) = (y, taken_ns);
        }
        if now_ns.saturating_sub(self.seen_ns) <= KEPT_NS { self.height_mm } else { f64::NAN }
    }
}
