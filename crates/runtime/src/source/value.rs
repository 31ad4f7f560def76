//! The values of a reading by their place and name, and how a sensor's thread hands them over.

use wire::layout::{AGES_MAX, MARKERS_MAX, PARAMETERS_MAX};

/// Values of one reading: pressure, gap, force, x, y, z of each marker, then the named inputs.
pub(super) const SLOTS: usize = NAMED + PARAMETERS_MAX;
/// Place of the pressure.
pub(super) const PRESSURE: usize = 0;
/// Place of the gap.
pub(super) const GAP: usize = 1;
/// Place of the measured force.
pub(crate) const FORCE: usize = 2;
/// Place of the first marker's x.
pub(super) const MARKERS: usize = 3;

/// Place of the first named input; its name is the scene's, see [`super::InputNames`].
pub(super) const NAMED: usize = MARKERS + 3 * MARKERS_MAX;
/// What has an age of its own, named inputs included.
pub(super) const GROUPS: usize = AGES_MAX + PARAMETERS_MAX;

/// Names of the values by their place, as in scenes; those of the markers are also columns of traces.
pub(crate) const QUANTITIES: [&str; NAMED] = [
    "pressure_mpa",
    "gap_mm",
    "force_n",
    "marker1_x_mm",
    "marker1_y_mm",
    "marker1_z_mm",
    "marker2_x_mm",
    "marker2_y_mm",
    "marker2_z_mm",
    "marker3_x_mm",
    "marker3_y_mm",
    "marker3_z_mm",
    "marker4_x_mm",
    "marker4_y_mm",
    "marker4_z_mm",
    "marker5_x_mm",
    "marker5_y_mm",
    "marker5_z_mm",
    "marker6_x_mm",
    "marker6_y_mm",
    "marker6_z_mm",
    "marker7_x_mm",
    "marker7_y_mm",
    "marker7_z_mm",
    "marker8_x_mm",
    "marker8_y_mm",
    "marker8_z_mm",
];

/// The place of a value that every reading has by its name.
pub(crate) fn slot(name: &str) -> Option<usize> {
    QUANTITIES.iter().position(|known| *known == name)
}

/// What has one age and one flag: pressure, gap, force, a whole marker, or a named input; also the bit's number in
/// [`wire::layout::value_bits`].
pub(super) fn group(slot: usize) -> usize {
    match slot {
        ..MARKERS => slot,
        MARKERS..NAMED => MARKERS + (slot - MARKERS) / 3,
        _ => (AGES_MAX + slot - NAMED).min(GROUPS - 1),
    }
}

/// What a sensor said at one time: some of the values, in their base units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Update {
    /// When its answer came, ns.
    pub(super) t_ns: u64,
    /// The values by their place.
    pub(super) values: [f64; SLOTS],
    /// Bit `slot`: the sensor has said something about this value.
    pub(super) which: u64,
    /// Bit `slot`: the value is absent because of a fault.
    pub(super) faulty: u64,
    /// Fault code of these, as in [`wire::SensorSample::status`].
    pub(super) code: u32,
}

impl Update {
    /// Nothing said.
    pub(super) fn at(t_ns: u64) -> Self {
        Self { t_ns, values: [f64::NAN; SLOTS], which: 0, faulty: 0, code: 0 }
    }
}
