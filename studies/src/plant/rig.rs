//! A test rig as Modbus devices: gauge, gap sensor, load cell and a valve with its own time-out, in front of a plant.
//!
//! | unit | registers | what |
//! | --- | --- | --- |
//! | 1 | input 0-1, f32 | gauge, MPa |
//! | 2 | input 0-1, f32 | gap sensor, mm |
//! | 3 | input 0-1, f32 | load cell, N |
//! | 4 | holding 0-1, f32 | valve, MPa |
//! | 4 | holding 10 | time without a write to the valve, ms, after which it closes by itself; 0: never |

use super::Truth;
use control::plant::{Plant, PlantReading};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use tokio_modbus::server::Service;
use tokio_modbus::{ExceptionCode, Request, Response, SlaveRequest};
use wire::now_ns;

/// Names of the sensors, by unit less 1.
pub const SENSORS: [&str; 3] = ["gauge", "gap", "cell"];
/// The valve's unit.
const VALVE: u8 = 4;

/// Cause of a closed or opened valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// When, ns of the wire's clock.
    pub t_ns: u64,
    /// Kind: `driven`, `safe written` or `safe watchdog`.
    pub what: &'static str,
}

/// The rig's memory, shared by its connections.
#[derive(Debug)]
struct Inner {
    plant: Plant<Truth>,
    shown: Option<PlantReading>,
    shown_gap_mm: f64,
    pulled: [bool; 3],
    valve_mpa: f64,
    written_ns: u64,
    watchdog_ns: u64,
    events: Vec<Event>,
    /// Since the valve was driven last: time in s, true force in N.
    points: Vec<(f64, f64)>,
    driven_ns: Option<u64>,
}

/// The rig.
#[derive(Debug, Clone)]
pub struct Rig(Arc<Mutex<Inner>>);

impl Rig {
    /// A rig at rest whose gap sensor shows `shown_gap_mm`.
    pub fn new(plant: Plant<Truth>, shown_gap_mm: f64) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            plant,
            shown: None,
            shown_gap_mm,
            pulled: [false; 3],
            valve_mpa: 0.0,
            written_ns: 0,
            watchdog_ns: 0,
            events: Vec::new(),
            points: Vec::new(),
            driven_ns: None,
        })))
    }

    /// Moves the plant on by `dt_s` and closes the valve when its time-out is over; returns the new events.
    pub fn turn(&self, dt_s: f64) -> Vec<Event> {
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = now_ns();
        if inner.valve_mpa > 0.0
            && inner.watchdog_ns > 0
            && now.saturating_sub(inner.written_ns) > inner.watchdog_ns
        {
            inner.set(0.0, now, "safe watchdog");
        }
        let reading = inner.plant.step(dt_s);
        inner.shown = Some(reading);
        if let Some(driven_ns) = inner.driven_ns {
            inner.points.push((now.saturating_sub(driven_ns) as f64 * 1e-9, reading.true_force_n));
        }
        std::mem::take(&mut inner.events)
    }

    /// Unplugs a sensor of [`SENSORS`], or plugs it in again; `false`: there is none of that name.
    pub fn pull(&self, name: &str, is_pulled: bool) -> bool {
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = SENSORS.iter().position(|sensor| *sensor == name);
        found.map(|at| inner.pulled[at] = is_pulled).is_some()
    }

    /// Time in s and true force in N since the valve was driven last.
    pub fn points(&self) -> Vec<(f64, f64)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).points.clone()
    }
}

impl Inner {
    fn set(&mut self, pressure_mpa: f64, now_ns: u64, safe: &'static str) {
        match (self.valve_mpa > 0.0, pressure_mpa > 0.0) {
            (true, false) => self.events.push(Event { t_ns: now_ns, what: safe }),
            (false, true) => {
                self.driven_ns = Some(now_ns);
                self.points.clear();
                self.events.push(Event { t_ns: now_ns, what: "driven" });
            }
            _ => {}
        }
        self.valve_mpa = pressure_mpa;
        self.plant.command(pressure_mpa);
    }

    /// The answer; none: the device does not answer.
    fn answer(&mut self, unit: u8, request: Request<'_>) -> Option<Result<Response, ExceptionCode>> {
        let sensor = usize::from(unit).wrapping_sub(1);
        if self.pulled.get(sensor) == Some(&true) {
            return None;
        }
        let shown = self.shown?;
        let now = now_ns();
        Some(match (unit, request) {
            (1..=3, Request::ReadInputRegisters(0, 2)) => {
                let value = [shown.pressure_mpa, self.shown_gap_mm, shown.force_n][sensor];
                Ok(Response::ReadInputRegisters(words(value)))
            }
            (VALVE, Request::WriteMultipleRegisters(0, values)) if values.len() == 2 => {
                let pressure_mpa = f32::from_bits(u32::from(values[0]) << 16 | u32::from(values[1]));
                self.written_ns = now;
                self.set(f64::from(pressure_mpa), now, "safe written");
                Ok(Response::WriteMultipleRegisters(0, 2))
            }
            (VALVE, Request::WriteSingleRegister(10, ms)) => {
                self.watchdog_ns = u64::from(ms) * 1_000_000;
                Ok(Response::WriteSingleRegister(10, ms))
            }
            _ => Err(ExceptionCode::IllegalDataAddress),
        })
    }
}

/// A number as two registers, the high half first.
fn words(value: f64) -> Vec<u16> {
    let bits = (value as f32).to_bits();
    vec![(bits >> 16) as u16, bits as u16]
}

impl Service for Rig {
    type Request = SlaveRequest<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = Pin<Box<dyn Future<Output = Result<Response, ExceptionCode>> + Send>>;

    fn call(&self, SlaveRequest { slave, request }: Self::Request) -> Self::Future {
        let answer = self.0.lock().unwrap_or_else(PoisonError::into_inner).answer(slave, request);
        Box::pin(async move {
            match answer {
                Some(answer) => answer,
                None => std::future::pending().await,
            }
        })
    }
}
