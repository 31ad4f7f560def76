//! Shared parts of the trials.

use super::trial::{Loop, Trial};
use crate::plant::table::PlantTable;
use crate::plant::{Plant, PlantSpec, Truth};
use control::inverse::Quantity;
use control::law::Settings;
use control::twin_model::{Tip, TwinModel};
use softtwin::failure::usage;

/// Parts of every trial.
pub struct Bench {
    /// The controller's model.
    pub model: rom::model::Model,
    /// The plant's.
    pub table: PlantTable,
    /// The controller's.
    pub settings: Settings,
}

impl Bench {
    /// The model as the controller sees it.
    pub fn model(&self) -> anyhow::Result<TwinModel> {
        TwinModel::new(&self.model, Tip::REFERENCE).map_err(usage)
    }

    /// Controller and plant at rest.
    pub fn start(&self, spec: PlantSpec, trial: Trial) -> anyhow::Result<Loop<TwinModel>> {
        let plant = Plant::new(spec, Truth::Table(self.table.clone()));
        Ok(Loop::new(self.model()?, self.settings, plant, trial))
    }
}

/// A trial at 1 kHz.
pub fn trial(quantity: Quantity, is_measured: bool, gap_error_mm: f64) -> Trial {
    Trial { quantity, is_measured, gap_error_mm, rate_hz: 1000.0 }
}
