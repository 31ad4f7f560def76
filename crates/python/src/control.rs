//! The controller in a loop of Python's.

use crate::refused;
use control::ahead::TargetSeries;
use control::held::Stepping;
use control::law::{Cycle, Limited, Reading, Target};
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A controller of one quantity.
#[pyclass(frozen, module = "softtwin._native")]
pub struct Control {
    stepping: Mutex<Stepping>,
}

/// Setpoint, target, reference, held quantity, correction, error of the valve; limits that bind; whether the target is out of reach, the command is
/// the first law's, and the commands oscillate; fault.
type PythonCycle = ([f64; 6], Vec<&'static str>, [bool; 3], Option<&'static str>);

impl Control {
    pub fn new(
        model: &rom::model::Model,
        held: &str,
        scene: Option<&str>,
        actuator: Option<&str>,
    ) -> PyResult<Self> {
        let stepping = Stepping::open(model, scene, actuator, held).map_err(refused)?;
        Ok(Self { stepping: Mutex::new(stepping) })
    }

    fn stepping(&self) -> MutexGuard<'_, Stepping> {
        self.stepping.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read([pressure_mpa, gap_mm, measured, written_mpa]: [f64; 4]) -> Reading {
    Reading { pressure_mpa, gap_mm, measured, written_mpa }
}

fn in_python(cycle: Cycle) -> PythonCycle {
    let Limited { by_force, by_range, by_rate, by_correction, by_valve, by_supply } = cycle.limited;
    let limits = [
        (by_force, "force"),
        (by_range, "range"),
        (by_rate, "rate"),
        (by_correction, "correction"),
        (by_valve, "valve"),
        (by_supply, "supply"),
    ];
    let numbers = [
        cycle.pressure_mpa,
        cycle.target,
        cycle.reference_mpa,
        cycle.followed,
        cycle.correction_mpa,
        cycle.bias_mpa,
    ];
    let binding = limits.into_iter().filter(|(binds, _)| *binds).map(|(_, name)| name).collect();
    let marks = [cycle.limited.is_limited(), cycle.is_fallback, cycle.is_oscillating];
    (numbers, binding, marks, cycle.fault.map(|fault| fault.name()))
}

#[pymethods]
impl Control {
    /// One cycle: time, target and its rate, then gauge, gap, measured quantity and written pressure.
    fn step(&self, py: Python<'_>, t_ns: u64, target: [f64; 2], reading: [f64; 4]) -> PyResult<PythonCycle> {
        let target = Target { value: target[0], rate: target[1] };
        let cycle = py.detach(|| self.stepping().step(t_ns, target, read(reading)));
        cycle.map(in_python).map_err(refused)
    }

    /// The same with targets that are known ahead, and the time from one to the next.
    fn step_ahead(
        &self,
        py: Python<'_>,
        t_ns: u64,
        targets: Vec<f64>,
        interval_s: f64,
        reading: [f64; 4],
    ) -> PyResult<PythonCycle> {
        let series = TargetSeries { values: &targets, interval_s };
        let cycle = py.detach(|| self.stepping().step_ahead(t_ns, series, read(reading)));
        cycle.map(in_python).map_err(refused)
    }

    /// Begins again where the actuator is: gauge, gap, measured quantity.
    fn start(&self, pressure_mpa: f64, gap_mm: f64, measured: f64) -> PyResult<()> {
        if !pressure_mpa.is_finite() || !gap_mm.is_finite() {
            return Err(refused("expected a finite pressure_mpa and gap_mm to start from"));
        }
        let reading = Reading { pressure_mpa, gap_mm, measured, written_mpa: f64::NAN };
        self.stepping().controller_mut().start(reading);
        Ok(())
    }

    /// Releases a fault.
    fn release(&self) {
        self.stepping().controller_mut().release();
    }

    /// Sets inputs of the model, one value for each of the header's; NaN: the model's.
    fn set_inputs(&self, inputs: Vec<f64>) -> PyResult<()> {
        self.stepping().set_inputs(&inputs).map_err(refused)
    }
}
