//! From Modbus registers to a physical quantity. Pure functions: the fuzz targets feed them anything.

use serde::{Deserialize, Serialize};

/// Where a quantity stands in a device, and how it is written there.
///
/// value = (registers in `encoding` and `word_order`) x `scale` + `offset`, in `unit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegisterSpec {
    /// Unit identifier ("slave address") of the device, 1-247; gateways on TCP often ignore it.
    #[serde(default = "first_unit")]
    pub unit_id: u8,
    /// Address of the first register, from 0.
    pub register: u16,
    /// Which table it stands in.
    #[serde(default)]
    pub table: Table,
    /// How the number is written.
    #[serde(default)]
    pub encoding: Encoding,
    /// Which of two registers comes first.
    #[serde(default)]
    pub word_order: WordOrder,
    /// Factor on the raw number.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after the factor, in `unit`.
    #[serde(default)]
    pub offset: f64,
    /// Unit of the result: Pa, kPa, MPa, mbar, bar, psi; um, mm, m; mN, N, gf, kgf. Default: MPa, mm or N.
    #[serde(default)]
    pub unit: Option<String>,
}

/// Where a number stands in a device, and how it is written there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegisterAt {
    /// Unit identifier ("slave address") of the device, 1-247; gateways on TCP often ignore it.
    #[serde(default = "first_unit")]
    pub unit_id: u8,
    /// Address of the first register, from 0.
    pub register: u16,
    /// Which table it stands in.
    #[serde(default)]
    pub table: Table,
    /// How the number is written.
    #[serde(default)]
    pub encoding: Encoding,
    /// Which of two registers comes first.
    #[serde(default)]
    pub word_order: WordOrder,
}

fn first_unit() -> u8 {
    1
}

fn one() -> f64 {
    1.0
}

/// Modbus tables that hold numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Table {
    /// Input registers, function 4.
    #[default]
    Input,
    /// Holding registers, function 3.
    Holding,
}

/// How a number is written into registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// One register, unsigned.
    U16,
    /// One register, two's complement.
    #[default]
    I16,
    /// Two registers, unsigned.
    U32,
    /// Two registers, two's complement.
    I32,
    /// Two registers, IEEE 754.
    F32,
}

/// Which of two registers comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WordOrder {
    /// The high half first, as Modbus itself orders bytes.
    #[default]
    Big,
    /// The low half first.
    Little,
}

/// What is measured; each has its base unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// MPa.
    Pressure,
    /// mm.
    Gap,
    /// N.
    Force,
}

impl Quantity {
    /// Units by name with their size in the base unit.
    pub fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Pressure => &[
                ("MPa", 1.0),
                ("kPa", 1e-3),
                ("Pa", 1e-6),
                ("bar", 0.1),
                ("mbar", 1e-4),
                ("psi", 0.006_894_757_293_168),
            ],
            Self::Gap => &[("mm", 1.0), ("um", 1e-3), ("m", 1e3)],
            Self::Force => &[("N", 1.0), ("mN", 1e-3), ("gf", 0.009_806_65), ("kgf", 9.806_65)],
        }
    }

    /// Size of `unit` in the base unit; the base unit itself when none is named.
    pub fn factor(self, unit: Option<&str>) -> Option<f64> {
        let Some(unit) = unit else { return Some(1.0) };
        self.units().iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor)
    }

    /// Notes a problem when the unit is none of this quantity.
    pub fn check_unit(self, key: &str, unit: Option<&str>, problems: &mut Vec<String>) {
        if self.factor(unit).is_none() {
            let known: Vec<&str> = self.units().iter().map(|(name, _)| *name).collect();
            let found = unit.unwrap_or_default();
            problems.push(format!("{key}: expected one of {}, found `{found}`", known.join(", ")));
        }
    }
}

impl RegisterAt {
    /// How many registers to ask for.
    pub fn count(&self) -> u16 {
        match self.encoding {
            Encoding::U16 | Encoding::I16 => 1,
            Encoding::U32 | Encoding::I32 | Encoding::F32 => 2,
        }
    }

    /// The number; `None` when the device sent another number of registers than was asked for.
    pub fn raw(&self, registers: &[u16]) -> Option<f64> {
        Some(match (self.encoding, registers) {
            (Encoding::U16, [word]) => f64::from(*word),
            (Encoding::I16, [word]) => f64::from(word.cast_signed()),
            (Encoding::U32, [a, b]) => f64::from(self.join(*a, *b)),
            (Encoding::I32, [a, b]) => f64::from(self.join(*a, *b).cast_signed()),
            (Encoding::F32, [a, b]) => f64::from(f32::from_bits(self.join(*a, *b))),
            _ => return None,
        })
    }

    fn join(&self, first: u16, second: u16) -> u32 {
        let (high, low) = match self.word_order {
            WordOrder::Big => (first, second),
            WordOrder::Little => (second, first),
        };
        u32::from(high) << 16 | u32::from(low)
    }

    /// Everything that is wrong with it; `key` is its place in the file.
    pub fn problems(&self, key: &str, problems: &mut Vec<String>) {
        if !(1..=247).contains(&self.unit_id) {
            problems.push(format!("{key}.unit_id: expected 1-247, found {}", self.unit_id));
        }
        if self.register.checked_add(self.count() - 1).is_none() {
            problems
                .push(format!("{key}.register: expected room for two registers, found {}", self.register));
        }
    }
}

impl RegisterSpec {
    /// Where the number stands.
    pub fn at(&self) -> RegisterAt {
        let Self { unit_id, register, table, encoding, word_order, .. } = *self;
        RegisterAt { unit_id, register, table, encoding, word_order }
    }

    /// How many registers to ask for.
    pub fn count(&self) -> u16 {
        self.at().count()
    }

    /// The quantity in its base unit (MPa, mm, N); `None` when the device sent another number of registers than was
    /// asked for, or the unit is unknown.
    pub fn decode(&self, quantity: Quantity, registers: &[u16]) -> Option<f64> {
        let raw = self.at().raw(registers)?;
        Some((raw * self.scale + self.offset) * quantity.factor(self.unit.as_deref())?)
    }

    /// The registers that [`Self::decode`] reads as this value in the base unit; `None` when it does not fit, or the unit is
    /// unknown. Whole numbers are rounded to the nearest.
    pub fn encode(&self, quantity: Quantity, value: f64) -> Option<Vec<u16>> {
        let raw = (value / quantity.factor(self.unit.as_deref())? - self.offset) / self.scale;
        let whole = |min: f64, max: f64| {
            let rounded = raw.round();
            (min..=max).contains(&rounded).then_some(rounded as i64)
        };
        Some(match self.encoding {
            Encoding::U16 => vec![whole(0.0, f64::from(u16::MAX))? as u16],
            Encoding::I16 => vec![(whole(f64::from(i16::MIN), f64::from(i16::MAX))? as i16).cast_unsigned()],
            Encoding::U32 => self.split(whole(0.0, f64::from(u32::MAX))? as u32),
            Encoding::I32 => {
                self.split((whole(f64::from(i32::MIN), f64::from(i32::MAX))? as i32).cast_unsigned())
            }
            Encoding::F32 => self.split(Some(raw as f32).filter(|raw| raw.is_finite())?.to_bits()),
        })
    }

    fn split(&self, bits: u32) -> Vec<u16> {
        let (high, low) = ((bits >> 16) as u16, bits as u16);
        match self.word_order {
            WordOrder::Big => vec![high, low],
            WordOrder::Little => vec![low, high],
        }
    }

    /// Everything that is wrong with the specification; `key` is its place in the file.
    pub fn problems(&self, key: &str, quantity: Quantity, problems: &mut Vec<String>) {
        self.at().problems(key, problems);
        if !(self.scale.is_finite() && self.scale != 0.0) {
            problems
                .push(format!("{key}.scale: expected a finite number other than 0, found {}", self.scale));
        }
        if !self.offset.is_finite() {
            problems.push(format!("{key}.offset: expected a finite number, found {}", self.offset));
        }
        quantity.check_unit(&format!("{key}.unit"), self.unit.as_deref(), problems);
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_register.rs"]
mod tests;
