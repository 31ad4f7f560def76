//! Simulated actuators of `control::plant` with bodies of the repository, in shared memory and behind Modbus.

pub mod modbus;
pub mod on_wire;
pub mod report;
mod rig;
pub mod table;

use control::plant::RestingBody;
use runtime::query::Solver;
use table::PlantTable;

/// Source of true force and tip.
#[derive(Debug)]
pub enum Truth {
    /// A second finite-element mesh.
    Table(PlantTable),
    /// A trained model of nominal stiffness; its tip is not followed.
    Model(Box<Solver>),
}

impl RestingBody for Truth {
    fn answer(&mut self, pressure_mpa: f64, gap_mm: f64, stiffness: f64) -> [f64; 2] {
        match self {
            Self::Table(table) => table.at(pressure_mpa, gap_mm, stiffness).into(),
            Self::Model(solver) => [solver.evaluate(pressure_mpa, gap_mm).contact_force_n, f64::NAN],
        }
    }
}
