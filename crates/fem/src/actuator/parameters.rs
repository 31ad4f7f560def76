//! Quantities of `actuator.toml` by name: every number has its dotted key (`elastomer.law.mu_mpa`), one of a list its
//! place behind it (`loads.gravity_mm_s2.1`).

use super::file::Actuator;
use formats::Diagnostic;
use toml::{Table, Value};

/// Quantity and its new value.
pub type Setting = (String, f64);

/// Section of the mesh's making. Its quantities are no parameters: variants keep the elements of the given mesh.
const FIXED: [&str; 3] = ["layout", "mesh.", "chambers.count"];

impl Actuator {
    /// Names and values of all quantities that can be set, in the file's order.
    pub fn quantities(&self) -> Vec<Setting> {
        let mut found = Vec::new();
        // A value of plain numbers, words and lists always has a form in TOML.
        Value::try_from(self).iter().for_each(|value| collect("", value, &mut found));
        found.retain(|(name, _)| !FIXED.iter().any(|fixed| name.starts_with(fixed)));
        found
    }

    /// The value of a quantity.
    ///
    /// # Errors
    /// An unknown name, with the nearest known one.
    pub fn quantity(&self, name: &str) -> Result<f64, Diagnostic> {
        let known = self.quantities();
        let found = known.iter().find(|(key, _)| key == name).map(|(_, value)| *value);
        found.ok_or_else(|| {
            if FIXED.iter().any(|fixed| name.starts_with(fixed)) {
                let expected = "a quantity that does not change the elements of the mesh";
                return Diagnostic::new(
                    "parameter",
                    expected,
                    format!("`{name}`: another mesh and another model"),
                );
            }
            let nearest =
                known.iter().min_by_key(|(key, _)| (!key.starts_with(name), strsim::levenshtein(key, name)));
            let nearest = nearest.map_or(String::new(), |(key, _)| format!(", such as {key}"));
            Diagnostic::new(
                "parameter",
                format!("the dotted key of a number in actuator.toml{nearest}"),
                format!("`{name}`"),
            )
        })
    }

    /// This actuator with some quantities changed, checked like a file.
    ///
    /// # Errors
    /// Unknown names, or all errors in the values; never empty.
    pub fn with(&self, settings: &[Setting]) -> Result<Self, Vec<Diagnostic>> {
        let unknown: Vec<_> = settings.iter().filter_map(|(name, _)| self.quantity(name).err()).collect();
        if !unknown.is_empty() {
            return Err(unknown);
        }
        let wrong = |error: &dyn std::fmt::Display| vec![Diagnostic::new("parameters", "an actuator", error)];
        let mut table = Table::try_from(self).map_err(|error| wrong(&error))?;
        for (name, value) in settings {
            if let Some(slot) = slot(&mut table, name) {
                *slot = match slot {
                    Value::Integer(_) if value.fract() == 0.0 => Value::Integer(*value as i64),
                    _ => Value::Float(*value),
                };
            }
        }
        let changed: Self = table.try_into().map_err(|error| wrong(&error))?;
        let diagnostics = changed.diagnostics();
        if diagnostics.is_empty() { Ok(changed) } else { Err(diagnostics) }
    }
}

/// Unit of a quantity, from the end of its name; empty for a dimensionless one.
pub fn unit(name: &str) -> &'static str {
    let units = [
        ("_t_per_mm3", "t/mm3"),
        ("_mpa_per_mm", "MPa/mm"),
        ("_n_per_mm", "N/mm"),
        ("_mm_s2", "mm/s2"),
        ("_mpa", "MPa"),
        ("_mm", "mm"),
        ("_n", "N"),
        ("_s", "s"),
    ];
    let known_unit = |key: &str| units.iter().find(|(end, _)| key.ends_with(end)).map(|(_, unit)| *unit);
    // A place in a list (`gravity_mm_s2.1`) and the name of a cavity (`pressure_mpa.left`) are behind the unit.
    name.rsplit('.').find_map(known_unit).unwrap_or("")
}

fn collect(name: &str, value: &Value, found: &mut Vec<Setting>) {
    let below = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    match value {
        Value::Table(table) => table.iter().for_each(|(key, value)| collect(&below(key), value, found)),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, value)| collect(&below(&i.to_string()), value, found));
        }
        Value::Float(number) => found.push((name.into(), *number)),
        Value::Integer(number) => found.push((name.into(), *number as f64)),
        _ => {}
    }
}

fn slot<'a>(table: &'a mut Table, name: &str) -> Option<&'a mut Value> {
    let mut parts = name.split('.');
    let mut value = table.get_mut(parts.next()?)?;
    for part in parts {
        value = match value {
            Value::Table(table) => table.get_mut(part)?,
            Value::Array(list) => list.get_mut(part.parse::<usize>().ok()?)?,
            _ => return None,
        };
    }
    Some(value)
}
