//! Whether a scene's fingers hold their object, published as `softtwin/<scene>/grasp`.
//!
//! Coulomb friction at `n` fingers that push with `F` each carries `n mu F`; the object of mass `m` is held with safety `s`
//! when `n mu F >= s m g` (the paper's section on the gripper, there with `s = 1`). The smallest finger force counts for all.
//! A separate thread reads the fingers' states; the twin's loop is not involved.

use crate::config::{self, ActuatorSpec, ConfigError, GraspSpec, Scene};
use crate::query::Answerer;
use crate::side_service::SideService;
use std::path::Path;
use std::time::Duration;
use wire::layout::{FINGERS_MAX, flags, grasp_status, pack_name};
use wire::{
    Bus, Grasp, GraspWriter, State, StateReader, Topic, WakeSet, Wakeable, WireError, boot_id, now_ns,
};

/// Acceleration of gravity, m/s2, as in the actuators' own finite elements.
pub const GRAVITY_M_S2: f64 = 9.81;
/// Change of the gap, mm, from which on the stop point is computed again.
const GAP_CHANGE_MM: f64 = 0.01;

/// Force that each of `fingers` fingers must bring, N: `s m g / (n mu)`.
pub fn needed_force_n(spec: &GraspSpec, fingers: usize) -> f64 {
    spec.safety * spec.mass_g * 1e-3 * GRAVITY_M_S2 / (fingers as f64 * spec.friction)
}

/// The pressure at which the object is first held, and its half-width, MPa; NaN where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopPoint {
    /// Pressure of all fingers, MPa.
    pub pressure_mpa: f64,
    pub halfwidth_mpa: f64,
}

const NO_STOP: StopPoint = StopPoint { pressure_mpa: f64::NAN, halfwidth_mpa: f64::NAN };

/// Finds a finger's stop point at a gap: the lowest sampled pressure with the needed force.
pub fn stop_point(finger: &mut Answerer, gap_mm: f64, needed_n: f64) -> StopPoint {
    let found = finger.solver().pressure_for_force(gap_mm, needed_n);
    found.map_or(NO_STOP, |found| StopPoint { pressure_mpa: found.value, halfwidth_mpa: found.uncertainty })
}

/// The grasp that follows from the fingers' states; one that is missing or not fresh makes it unknown.
pub fn evaluate(spec: &GraspSpec, states: &[Option<State>]) -> Grasp {
    let needed_n = needed_force_n(spec, states.len());
    let mut grasp = Grasp {
        flags: 0,
        finger_count: states.len().min(FINGERS_MAX) as u32,
        mass_kg: spec.mass_g * 1e-3,
        friction: spec.friction,
        safety: spec.safety,
        needed_force_n: needed_n,
        t_sensor_ns: u64::MAX,
        ..Grasp::default()
    };
    let (mut least_n, mut halfwidth_n) = (f64::INFINITY, 0.0_f64);
    let slots = grasp.forces_n.iter_mut().zip(&mut grasp.pressures_mpa);
    for ((force, pressure), state) in slots.zip(states) {
        let Some(state) = state else {
            grasp.flags |= flags::NO_DATA;
            continue;
        };
        (*force, *pressure) = (state.contact_force_n, state.pressure_mpa);
        grasp.flags |= state.flags;
        grasp.t_sensor_ns = grasp.t_sensor_ns.min(state.t_sensor_ns);
        // A finger without a force makes the grasp unknown, whatever the others bring.
        let is_known = !least_n.is_nan() && !state.contact_force_n.is_nan();
        least_n = if is_known { least_n.min(state.contact_force_n) } else { f64::NAN };
        halfwidth_n = halfwidth_n.max(f64::from(state.force_halfwidth_n)); // NaN (half-widths off) is ignored
    }
    if grasp.t_sensor_ns == u64::MAX {
        grasp.t_sensor_ns = 0;
    }
    let extrapolated = flags::NEAR_EDGE | flags::OUTSIDE_DOMAIN;
    if least_n.is_finite() {
        grasp.least_force_n = least_n;
        grasp.margin = least_n / needed_n - 1.0;
        grasp.needed_friction = spec.friction * needed_n / least_n;
        grasp.force_halfwidth_n = if grasp.flags & extrapolated == 0 { halfwidth_n } else { f64::NAN };
    }
    let unusable = flags::NO_DATA | flags::STALE | flags::HELD;
    grasp.grasp_status = match grasp.flags & unusable {
        0 if least_n.is_nan() => grasp_status::UNKNOWN,
        // Outside the training range a force has no half-width.
        0 if grasp.flags & extrapolated != 0 && least_n >= needed_n => grasp_status::UNKNOWN,
        0 if least_n - halfwidth_n >= needed_n => grasp_status::HELD,
        0 if least_n >= needed_n => grasp_status::MARGINAL,
        0 => grasp_status::NOT_HELD,
        _ => grasp_status::UNKNOWN,
    };
    grasp
}

/// Models of a scene's grasp, loaded before any topic is created.
#[derive(Debug)]
pub struct GraspModel {
    scene: String,
    spec: GraspSpec,
    fingers: Vec<(String, Answerer)>,
    /// The sensor that each finger listens to.
    sensors: Vec<String>,
}

impl GraspModel {
    /// Loads the fingers' small models; `None` for a scene without a grasp.
    ///
    /// # Errors
    /// The problems of all fingers at once.
    pub fn load(scene: &Scene, path: &Path) -> Result<Option<Self>, ConfigError> {
        let Some(spec) = &scene.grasp else { return Ok(None) };
        let named = scene.fingers(spec);
        let load = |finger: &ActuatorSpec| {
            let small = ActuatorSpec { outputs: Vec::new(), ..finger.clone() };
            let mut model = Answerer::load(&small, &finger.model)?;
            if !model.solver().has_forces() {
                return Err(vec![
                    "grasp: expected a model trained on contact forces, found one without".into(),
                ]);
            }
            Ok((finger.name.clone(), model))
        };
        let fingers = config::collect(path, named.iter().map(|finger| (finger.name.as_str(), load(finger))))?;
        let sensors = named.iter().map(|finger| finger.sensor().to_owned()).collect();
        Ok(Some(Self { scene: scene.name.clone(), spec: spec.clone(), fingers, sensors }))
    }

    /// Force that each finger must bring, N.
    pub fn needed_force_n(&self) -> f64 {
        needed_force_n(&self.spec, self.fingers.len())
    }

    /// The grasp with all fingers at one pressure; `gap_mm` is the default as in [`Self::stop_point`].
    pub fn at(&mut self, pressure_mpa: f64, gap_mm: f64) -> Grasp {
        let gaps_mm = vec![gap_mm; self.fingers.len()];
        let states: Vec<Option<State>> = self
            .fingers
            .iter_mut()
            .map(|(_, finger)| {
                let gap_mm = finger.default_gap_mm().unwrap_or(gap_mm);
                Some(finger.state(pressure_mpa, gap_mm))
            })
            .collect();
        let stop = self.stop_point(&gaps_mm);
        Grasp {
            stop_pressure_mpa: stop.pressure_mpa,
            stop_pressure_halfwidth_mpa: stop.halfwidth_mpa,
            scene: pack_name(&self.scene),
            ..evaluate(&self.spec, &states)
        }
    }

    /// The pressure at which all fingers hold the object, at the gap each of them has: the highest of their stop points.
    /// `gaps_mm` are the defaults for fingers whose gap is fixed neither by the scene nor by the model.
    pub fn stop_point(&mut self, gaps_mm: &[f64]) -> StopPoint {
        let needed_n = self.needed_force_n();
        let mut stop = StopPoint { pressure_mpa: f64::NEG_INFINITY, halfwidth_mpa: 0.0 };
        for ((_, finger), measured_mm) in self.fingers.iter_mut().zip(gaps_mm) {
            let gap_mm = finger.default_gap_mm().unwrap_or(*measured_mm);
            let own = stop_point(finger, gap_mm, needed_n);
            if own.pressure_mpa.is_nan() {
                return NO_STOP;
            }
            if own.pressure_mpa > stop.pressure_mpa {
                stop = own;
            }
        }
        stop
    }
}

#[derive(Debug)]
pub struct GraspService {
    model: GraspModel,
    readers: Vec<StateReader>,
    states: Vec<Option<State>>,
    wake: WakeSet,
    writer: GraspWriter,
    boot_id: u64,
    seq: u64,
    stop: StopPoint,
    /// Gaps that the stop point was found for, mm.
    stop_gaps_mm: Vec<f64>,
}

impl SideService for GraspService {
    type Model = GraspModel;

    const NAME: &'static str = "grasp";

    fn start(bus: &Bus, mut model: GraspModel) -> Result<Self, WireError> {
        let writer = GraspWriter::create(bus, &Topic::grasp(&model.scene)?)?;
        let readers = model
            .fingers
            .iter()
            .map(|(name, _)| StateReader::attach(bus, &Topic::state(name)?))
            .collect::<Result<Vec<_>, WireError>>()?;
        let wake = WakeSet::new(readers.iter().map(|reader| reader as &dyn Wakeable));
        let stop_gaps_mm = vec![f64::NAN; readers.len()];
        let stop = model.stop_point(&stop_gaps_mm);
        let states = vec![None; readers.len()];
        Ok(Self { model, readers, states, wake, writer, boot_id: boot_id(), seq: 0, stop, stop_gaps_mm })
    }

    fn replace(&mut self, model: GraspModel) -> bool {
        let names = |model: &GraspModel| -> Vec<String> {
            model.fingers.iter().map(|(name, _)| name.clone()).chain(model.sensors.clone()).collect()
        };
        let same = self.model.scene == model.scene && names(&self.model) == names(&model);
        if same {
            self.model = model;
            // The stop point depends on the model: it is computed again with the next states.
            self.stop_gaps_mm.fill(f64::NAN);
        }
        same
    }

    /// Waits for states and publishes one grasp when there is a new one.
    fn turn(&mut self, max_wait: Duration) -> Result<(), WireError> {
        self.wake.wait(max_wait)?;
        let mut is_new = false;
        for (reader, state) in self.readers.iter().zip(&mut self.states) {
            if let Some(newest) = reader.newest()? {
                (*state, is_new) = (Some(newest), true);
            }
        }
        if !is_new || !self.is_coherent() {
            return Ok(());
        }
        self.update_stop_point();
        self.seq += 1;
        self.writer.publish(Grasp {
            boot_id: self.boot_id,
            seq: self.seq,
            t_publish_ns: now_ns(),
            stop_pressure_mpa: self.stop.pressure_mpa,
            stop_pressure_halfwidth_mpa: self.stop.halfwidth_mpa,
            scene: pack_name(&self.model.scene),
            ..evaluate(&self.model.spec, &self.states)
        })
    }
}

impl GraspService {
    /// Whether fingers on the same sensor show the same reading; while they do not, the other one is about to come.
    fn is_coherent(&self) -> bool {
        let shown = |i: usize| {
            let state = self.states.get(i)?.as_ref()?;
            Some((state.sensor_boot_id, state.sensor_seq))
        };
        let sensors = &self.model.sensors;
        sensors.iter().enumerate().all(|(i, sensor)| {
            let first = sensors.iter().position(|other| other == sensor).unwrap_or(i);
            shown(first) == shown(i)
        })
    }

    /// The stop point moves with the measured gaps.
    fn update_stop_point(&mut self) {
        let gaps = self.states.iter().map(|state| state.map_or(f64::NAN, |state| state.gap_mm));
        let moved =
            |(old, new): (&f64, f64)| (old - new).abs() > GAP_CHANGE_MM || old.is_nan() != new.is_nan();
        if self.stop_gaps_mm.iter().zip(gaps.clone()).any(moved) {
            self.stop_gaps_mm.clear();
            self.stop_gaps_mm.extend(gaps);
            self.stop = self.model.stop_point(&self.stop_gaps_mm);
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/grasp.rs"]
mod tests;
