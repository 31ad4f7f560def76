//! What belongs to a state as a whole: its name, and its inputs and results that are one number each.

use std::fmt::{self, Display};

/// A state's name and numbers; every state of a series has the same names of numbers in the same order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Label {
    /// The name of a case; empty where a state has none.
    pub name: String,
    /// Names with unit (`pressure_mpa`) and values; a value that is not finite is absent (`gap_mm` without an obstacle).
    pub numbers: Vec<(String, f64)>,
}

impl Label {
    /// A state of the actuator by the names that every file gives them: pressure, gap (none without an obstacle), the further inputs,
    /// contact force.
    pub fn of_state(
        pressure_mpa: f64,
        gap_mm: Option<f64>,
        parameters: impl IntoIterator<Item = (String, f64)>,
        contact_force_n: f64,
    ) -> Self {
        let named = |name: &str, value| (name.to_owned(), value);
        let mut numbers =
            vec![named("pressure_mpa", pressure_mpa), named("gap_mm", gap_mm.unwrap_or(f64::INFINITY))];
        numbers.extend(parameters);
        numbers.push(named("contact_force_n", contact_force_n));
        Self { name: String::new(), numbers }
    }

    /// The numbers that are there.
    pub(crate) fn present(&self) -> impl Iterator<Item = (&str, f64)> {
        self.numbers
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(name, value)| (name.as_str(), *value))
    }
}

/// One line for people: `A: pressure_mpa = 0.05, gap_mm = 40`.
impl Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.present().map(|(name, value)| format!("{name} = {value}")).collect();
        let between = if self.name.is_empty() || numbers.is_empty() { "" } else { ": " };
        write!(f, "{}{between}{}", self.name, numbers.join(", "))
    }
}
