//! Gauge and the sensor of the held quantity: the load cell, whose value states carry; a marker or the sensor of an observable, whose values
//! the readings carry.

use control::held::Held;
use control::inverse::Quantity;
use rom::inputs::PRESSURE;
use runtime::config::{ActuatorSpec, CameraSpec};
use wire::layout::pack_slot;
use wire::{Bus, SensorReader, SensorSample, State, Topic, Waking};

pub(super) struct Sensors {
    pub(super) name: String,
    /// Readings, where the quantity or the gauge before the memory is taken of them.
    readings: Option<SensorReader>,
    last: SensorSample,
    by: By,
    gauge: Gauge,
}

/// Source of the measured quantity.
enum By {
    LoadCell,
    Gauge,
    Marker(Marker),
    /// A named value of the readings.
    Named([u8; 32]),
    /// No sensor: the model's value is held.
    Model,
}

/// Source of the driven pressure.
#[derive(Clone, Copy)]
enum Gauge {
    State,
    /// The state's input at this position.
    Input(usize),
    /// The reading, before the model's memory.
    Reading,
    /// Its named value.
    Named([u8; 32]),
}

impl Gauge {
    fn new(held: &Held) -> Self {
        match (&held.settings.cavity, held.has_memory) {
            (Some(cavity), true) => Self::Named(pack_slot(&format!("pressure_mpa.{cavity}"))),
            (None, true) => Self::Reading,
            (Some(_), false) => Self::Input(held.slot),
            (None, false) => Self::State,
        }
    }
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

/// The driven pressure of a state, MPa: behind the memory of a model that has one.
pub(super) fn driven_mpa(state: &State, held: &Held) -> f64 {
    if held.driven == PRESSURE { state.pressure_mpa } else { state.inputs[held.slot] }
}

impl Sensors {
    pub(super) fn open(bus: &Bus, spec: &ActuatorSpec, held: &Held) -> anyhow::Result<Self> {
        let marker = held.marker.and_then(|at| Some((at, spec.markers.get(at)?)));
        let camera = spec.camera;
        let (name, by) = match (marker, held.quantity) {
            (Some((at, marker)), _) => {
                let by = By::Marker(Marker { at, camera, seen_ns: 0, height_mm: f64::NAN });
                (format!("marker {}", marker.name), by)
            }
            (None, Quantity::Pressure) => ("gauge".into(), By::Gauge),
            (None, Quantity::Force) => ("load cell".into(), By::LoadCell),
            (None, Quantity::Observable) if spec.observables.contains_key(&held.name) => {
                (format!("sensor of {}", held.name), By::Named(pack_slot(&held.name)))
            }
            (None, Quantity::Observable) => ("model".into(), By::Model),
        };
        let topic = Topic::sensor(spec.sensor())?;
        let is_read = matches!(by, By::Marker(_) | By::Named(_)) || held.has_memory;
        let readings = is_read.then(|| SensorReader::attach_as(bus, &topic, Waking::Never)).transpose()?;
        Ok(Self { name, readings, last: SensorSample::default(), by, gauge: Gauge::new(held) })
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
        match self.gauge {
            Gauge::State => state.pressure_mpa,
            Gauge::Input(at) => state.inputs[at],
            Gauge::Reading => self.last.pressure_mpa,
            Gauge::Named(name) => self.named(&name),
        }
    }

    /// Measured value of the quantity in the reading behind a state; NaN if it has none.
    pub(super) fn measured(&mut self, state: &State) -> f64 {
        match &mut self.by {
            By::Marker(marker) => marker.height_mm(&self.last, state.t_sensor_ns),
            By::Named(name) => {
                let name = *name;
                self.named(&name)
            }
            By::LoadCell => state.measured_force_n,
            By::Gauge => self.pressure_mpa(state),
            By::Model => f64::NAN,
        }
    }

    fn named(&self, name: &[u8; 32]) -> f64 {
        self.last.input(name).map_or(f64::NAN, |(_, value)| value)
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
