//! Cycles of the experiment and constants with their intervals.

use serde::Serialize;
use std::collections::BTreeMap;

/// One control cycle.
#[derive(Debug, Clone, Copy)]
pub struct ActuationCycle {
    /// Time, s.
    pub time_s: f64,
    /// Pressure that was commanded.
    pub command_mpa: f64,
    /// Pressure that the gauge showed.
    pub gauge_mpa: f64,
    /// The quantity that is controlled; NaN: not measured.
    pub measured: f64,
}

/// Constants by name.
pub type Constants = BTreeMap<&'static str, ConstantInterval>;

/// A constant with its 90 % interval.
#[derive(Debug, Clone, Copy, Serialize)]
#[allow(missing_docs)] // the names say what the values are
pub struct ConstantInterval {
    pub value: f64,
    pub interval: [f64; 2],
    pub unit: &'static str,
}
