//! The values of a reading by their place and name, and how a sensor's thread hands them over.

use wire::layout::{AGES_MAX, MARKERS_MAX};

/// Values of one reading: pressure, gap, force, then x, y, z of each marker.
pub(super) const SLOTS: usize = 3 + 3 * MARKERS_MAX;
/// Place of the pressure.
pub(super) const PRESSURE: usize = 0;
/// Place of the gap.
pub(super) const GAP: usize = 1;
/// Place of the measured force.
pub(crate) const FORCE: usize = 2;
/// Place of the first marker's x.
pub(super) const MARKERS: usize = 3;

/// Names of the values by their place, as in scenes; those of the markers are also columns of traces.
pub(crate) const QUANTITIES: [&str; SLOTS] = [
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

/// The place of a value by its name.
pub(crate) fn slot(name: &str) -> Option<usize> {
    QUANTITIES.iter().position(|known| *known == name)
}

/// What has one age and one flag: pressure, gap, force, or a whole marker; also the bit's number in
/// [`wire::layout::value_bits`].
pub(super) fn group(slot: usize) -> usize {
    if slot < MARKERS { slot } else { (MARKERS + (slot - MARKERS) / 3).min(AGES_MAX - 1) }
}

/// What a sensor said at one time: some of the values, in their base units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Update {
    /// When its answer came, ns.
    pub(super) t_ns: u64,
    /// The values by their place.
    pub(super) values: [f64; SLOTS],
    /// Bit `slot`: the sensor has said something about this value.
    pub(super) which: u32,
    /// Bit `slot`: the value is absent because of a fault.
    pub(super) faulty: u32,
    /// Fault code of these, as in [`wire::SensorSample::status`].
    pub(super) code: u32,
}

impl Update {
    /// Nothing said.
    pub(super) fn at(t_ns: u64) -> Self {
        Self { t_ns, values: [f64::NAN; SLOTS], which: 0, faulty: 0, code: 0 }
    }
}
