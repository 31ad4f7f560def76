//! One reading.

use super::payload::payload;
use super::{PARAMETERS_MAX, set_slot, slot, value_bits};

/// Most markers of one actuator.
pub const MARKERS_MAX: usize = 8;
/// Values with an age of their own: pressure, gap, force, each marker.
pub const AGES_MAX: usize = 3 + MARKERS_MAX;

payload! {
    /// One reading of the sensors of one actuator, stamped by the bridge.
    SensorSample "softtwin.Sensor" 672 {
        /// The run of the bridge that sent it.
        0 boot_id: u64 = 0, "", Show::Hex;
        /// Counts up by one per reading within a run, beginning at 1.
        8 seq: u64 = 0, "";
        /// When the reading was taken: of several sensors, the one that sets the pace.
        16 t_sensor_ns: u64 = 0, "ns";
        /// Gauge pressure in the chambers.
        24 pressure_mpa: f64 = f64::NAN, "MPa";
        /// Distance from the underside of the undeformed base to the plate.
        32 gap_mm: f64 = f64::NAN, "mm";
        /// Measured contact force; NaN without a load cell.
        40 measured_force_n: f64 = f64::NAN, "N";
        /// Time in the source's own trace (replays); NaN when there is none.
        48 t_trace_s: f64 = f64::NAN, "s";
        /// 0: good; up to 255 a fault code that the sensor itself gives; 256: the pressure is too old;
        /// 257: the pressure lies outside its calibration.
        56 status: u32 = 0, "";
        /// Coordinates below: three for each marker of the scene, 0 without markers.
        60 marker_values: u32 = 0, "";
        /// Measured x, y, z of the first marker, of the second, ..., in the camera's frame; NaN where one was not seen.
        64 markers_mm: [f64; 3 * MARKERS_MAX] = [f64::NAN; 3 * MARKERS_MAX], "mm", Show::Counted("marker_values");
        /// Ages below: 0, all values were taken at `t_sensor_ns`; 11 where they come from several sensors.
        256 age_count: u32 = 0, "";
        /// Values that are absent because they are older than the scene allows.
        260 stale_values: u32 = 0, "", Show::Flags(value_bits::ALL);
        /// Values that are absent because their sensor says that it is faulty, or because they lie outside its calibration.
        264 fault_values: u32 = 0, "", Show::Flags(value_bits::ALL);
        /// Named inputs below; 0: none.
        268 input_count: u32 = 0, "";
        /// Age at `t_sensor_ns` of pressure, gap, force, first marker, second, ...; of an absent value that of the last one.
        272 ages_ns: [u64; AGES_MAX] = [0; AGES_MAX], "ns", Show::Counted("age_count");
        /// Values that were left out because of their age since the start of the bridge.
        360 stale_total: u64 = 0, "";
        /// Zero; for later values.
        368 reserved_more: [u64; 2] = [0; 2], "";
        /// Measured values of further model inputs, in the unit at the end of their names; NaN where one is absent.
        384 inputs: [f64; PARAMETERS_MAX] = [f64::NAN; PARAMETERS_MAX], "", Show::Counted("input_count");
        /// Names of these inputs, 32 bytes each, zero-padded; a longer name is cut from the left. A twin takes those of its model by name.
        432 input_names: [u8; 32 * PARAMETERS_MAX] = [0; 32 * PARAMETERS_MAX], "", Show::Names("input_count");
        /// Age at `t_sensor_ns` of these inputs; of an absent value that of the last one.
        624 input_ages_ns: [u64; PARAMETERS_MAX] = [0; PARAMETERS_MAX], "ns", Show::Counted("input_count");
    }
    json [
        seq, t_sensor_ns, pressure_mpa, gap_mm, measured_force_n, markers_mm, t_trace_s, status, ages_ns, stale_values,
        fault_values, stale_total, input_names, inputs, input_ages_ns, boot_id,
    ]
}

impl SensorSample {
    /// The named inputs with their values.
    pub fn inputs(&self) -> impl Iterator<Item = (String, f64)> {
        let values = self.inputs.iter().take(self.input_count as usize);
        values.enumerate().map(|(at, value)| (slot(&self.input_names, at), *value))
    }

    /// Adds a named input; false when there are as many as fit already. Of a name of more than 31 bytes the end is kept.
    pub fn add_input(&mut self, name: &str, value: f64) -> bool {
        let at = self.input_count as usize;
        let Some(to) = self.inputs.get_mut(at) else { return false };
        *to = value;
        set_slot(&mut self.input_names, at, name);
        self.input_count += 1;
        true
    }
}
