//! Lines of pressure, gap and force as the source of an actuator, from a serial line or standard input.

use super::calibration::Channel;
use super::devices::Devices;
use super::filter::{Filter, FilterSpec};
use super::mixed::Mixed;
use super::register::Quantity;
use super::serial::SerialSpec;
use super::stream::{LineSensor, LinesPath, Pick};
use crate::source::reading::Source;
use crate::source::value::{FORCE, GAP, PRESSURE};
use serde::{Deserialize, Serialize};

/// A line sensor as written in a scene file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinesSpec {
    /// The serial line; without it, standard input is read.
    pub serial: Option<SerialSpec>,
    /// A comma between digits separates two numbers, although it may look like a decimal comma.
    pub comma_separates: bool,
    /// Unit of the pressure; default MPa.
    pub pressure_unit: Option<String>,
    /// Unit of the gap; default mm.
    pub gap_unit: Option<String>,
    /// Unit of the force; default N.
    pub force_unit: Option<String>,
    /// Smoothing of the pressure.
    pub filter: FilterSpec,
}

impl LinesSpec {
    /// Everything that is wrong with it.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if let Some(serial) = &self.serial {
            serial.problems("source.serial", &mut problems);
        }
        Quantity::Pressure.check_unit("source.pressure_unit", self.pressure_unit.as_deref(), &mut problems);
        Quantity::Gap.check_unit("source.gap_unit", self.gap_unit.as_deref(), &mut problems);
        Quantity::Force.check_unit("source.force_unit", self.force_unit.as_deref(), &mut problems);
        self.filter.problems("source.filter", &mut problems);
        problems
    }

    /// A source that is not started.
    ///
    /// # Errors
    /// [`Self::problems`].
    pub(crate) fn open(&self, devices: &Devices) -> Result<Box<dyn Source>, Vec<String>> {
        let problems = self.problems();
        if !problems.is_empty() {
            return Err(problems);
        }
        let given = [
            (PRESSURE, Quantity::Pressure, &self.pressure_unit),
            (GAP, Quantity::Gap, &self.gap_unit),
            (FORCE, Quantity::Force, &self.force_unit),
        ];
        let channel = |(slot, quantity, unit): (usize, Quantity, &Option<String>)| {
            Channel::plain(slot, quantity.factor(unit.as_deref()).unwrap_or(f64::NAN))
        };
        let mut channels: Vec<Channel> = given.into_iter().map(channel).collect();
        if let Some(pressure) = channels.first_mut() {
            pressure.filter = Filter::new(self.filter);
        }
        let path = self.serial.clone().map_or(LinesPath::Stdin, LinesPath::Serial);
        let comma_separates = self.comma_separates;
        let inbox = devices.read_lines(&path, channels, "", |feed| LineSensor {
            feed,
            pick: Pick::Three,
            comma_separates,
        });
        let inbox = inbox.map_err(|problem| vec![format!("source: {problem}")])?;
        Ok(Mixed::single(inbox, devices))
    }
}
