//! Series of a transient and the checkpoint from which it continues.

use super::motion::{Energy, Figures, StepSettings};
use super::trace::{Trace, TraceRow};
use crate::cases::VOLUME;
use crate::dynamics::Dynamics;
use crate::problem::Problem;
use crate::run::fingerprint;
use formats::table::to_text;
use formats::trace::SERIES_COLUMNS;
use formats::{FormatError, file};
use std::path::Path;

/// First bytes of a checkpoint.
const MAGIC: [u8; 8] = *b"STWNDYN4";
const HASH: usize = 32;
/// Leading numbers of a record that are in the series.
const SERIES: usize = SERIES_COLUMNS.len() + 1;
/// Numbers of a record.
const NUMBERS: usize = 15;

/// Columns of the table of energies.
const ENERGY_COLUMNS: [&str; 7] =
    ["t_s", "external_mj", "kinetic_mj", "strain_mj", "damping_mj", "viscous_mj", "numerical_mj"];

/// Inputs and figures of an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record {
    /// Time (s).
    pub t_s: f64,
    /// Cavity pressure (MPa).
    pub pressure_mpa: f64,
    /// Distance of the obstacle (mm); `None` without an obstacle.
    pub gap_mm: Option<f64>,
    /// What the motion has at this time: lowest point, tip, force, stress.
    pub figures: Figures,
}

impl Record {
    /// Record of an instant.
    pub fn new(inputs: &TraceRow, figures: Figures) -> Self {
        let TraceRow { t_s, pressure_mpa, gap_mm, .. } = *inputs;
        Self { t_s, pressure_mpa, gap_mm, figures }
    }

    fn values(&self) -> [f64; NUMBERS] {
        let (mut copy, mut gap_mm) = (*self, self.gap_mm.unwrap_or(f64::NAN));
        copy.numbers(&mut gap_mm).map(|number| *number)
    }

    fn of_values(values: &[f64; NUMBERS]) -> Self {
        let (mut record, mut gap_mm) = (Self::default(), f64::NAN);
        record.numbers(&mut gap_mm).into_iter().zip(values).for_each(|(to, from)| *to = *from);
        Self { gap_mm: (!gap_mm.is_nan()).then_some(gap_mm), ..record }
    }

    /// Numbers in the order of the columns; the gap, NaN without an obstacle, is a separate number.
    fn numbers<'a>(&'a mut self, gap_mm: &'a mut f64) -> [&'a mut f64; NUMBERS] {
        let Figures {
            lowest_y_mm,
            tip_x_mm,
            tip_y_mm,
            contact_force_n,
            max_stress_mpa,
            tip_z_mm,
            volume_mm3,
            energy,
        } = &mut self.figures;
        let Energy { external_mj, kinetic_mj, strain_mj, damping_mj, viscous_mj } = energy;
        [
            &mut self.t_s,
            &mut self.pressure_mpa,
            gap_mm,
            lowest_y_mm,
            tip_x_mm,
            tip_y_mm,
            contact_force_n,
            max_stress_mpa,
            tip_z_mm,
            volume_mm3,
            external_mj,
            kinetic_mj,
            strain_mj,
            damping_mj,
            viscous_mj,
        ]
    }
}

/// Series as a table, with further inputs of its trace; `gap_mm` is empty without an obstacle.
pub fn series_csv(records: &[Record], trace: &Trace) -> String {
    let cell = |value: &f64| if value.is_nan() { String::new() } else { value.to_string() };
    let columns: Vec<&str> =
        SERIES_COLUMNS.into_iter().chain([VOLUME]).chain(trace.further().map(|(_, name)| name)).collect();
    let row = |record: &Record| {
        let inputs = trace.inputs_at(record.t_s);
        let further = trace.further().map(|(index, _)| &inputs[index]);
        record.values()[..SERIES].iter().chain(further).map(cell).collect::<Vec<_>>()
    };
    to_text(&columns, records.iter().map(row))
}

/// Energies as a table.
pub fn energy_csv(records: &[Record]) -> String {
    let row = |record: &Record| {
        let energy = record.figures.energy;
        let values = record.values();
        [&values[..1], &values[SERIES..], &[energy.numerical_mj()]].concat()
    };
    to_text(&ENERGY_COLUMNS, records.iter().map(row))
}

/// Records so far and the motion at the last of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Records so far, in order of time.
    pub records: Vec<Record>,
    /// Numbers of the motion.
    pub motion: Vec<f64>,
}

impl Checkpoint {
    /// Replaces the checkpoint in `path`.
    ///
    /// # Errors
    /// The operating system's.
    pub fn save(&self, path: &Path, run: &[u8; HASH]) -> Result<(), FormatError> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(run);
        bytes.extend((self.records.len() as u64).to_le_bytes());
        let records = self.records.iter().flat_map(Record::values);
        records.chain(self.motion.iter().copied()).for_each(|value| bytes.extend(value.to_le_bytes()));
        let hash = blake3::hash(&bytes);
        bytes.extend(hash.as_bytes());
        file::replace(path, &bytes)
    }

    /// The checkpoint of that run; `None` without one, and for a damaged one or one of another run.
    pub fn load(path: &Path, run: &[u8; HASH]) -> Option<Self> {
        let bytes = file::read_bytes(path, file::MAX_DATA_BYTES).ok()?;
        let (body, hash) = bytes.split_last_chunk::<HASH>()?;
        let content = body.strip_prefix(&MAGIC)?.strip_prefix(run)?;
        let (count, content) = content.split_first_chunk()?;
        let numbers = usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(NUMBERS)?;
        if blake3::hash(body).as_bytes() != hash || !content.len().is_multiple_of(8) {
            return None;
        }
        let values: Vec<f64> = content.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let (records, motion) = values.split_at_checked(numbers)?;
        let records = records.as_chunks().0.iter().map(Record::of_values).collect();
        Some(Self { records, motion: motion.to_vec() })
    }
}

/// Mark of a run: problem, constants of motion, step control, trace and instants. A checkpoint continues no other run.
pub fn run_mark(
    problem: &Problem,
    dynamics: &Dynamics,
    settings: &StepSettings,
    trace: &Trace,
    instants: &[f64],
) -> [u8; HASH] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&fingerprint(problem));
    // The debug form prints floats so that they can be read back.
    hasher.update(format!("{dynamics:?} {settings:?} {trace:?} {instants:?}").as_bytes());
    *hasher.finalize().as_bytes()
}
