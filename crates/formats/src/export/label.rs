//! Name of a state and its scalar inputs and results.

use std::fmt::{self, Display};

/// Name and scalars of a state; all states of a series have the same names of scalars in the same order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Label {
    /// Name of a case; may be empty.
    pub name: String,
    /// Names with unit (`pressure_mpa`) and values; a value that is not finite is absent (`gap_mm` without an obstacle).
    pub numbers: Vec<(String, f64)>,
}

impl Label {
    /// Label of a state of the actuator: pressure, gap (`None` without an obstacle), further inputs, contact force.
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

    /// Finite scalars.
    pub(crate) fn present(&self) -> impl Iterator<Item = (&str, f64)> {
        self.numbers
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(name, value)| (name.as_str(), *value))
    }
}

/// One line: `A: pressure_mpa = 0.05, gap_mm = 40`.
impl Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.present().map(|(name, value)| format!("{name} = {value}")).collect();
        let between = if self.name.is_empty() || numbers.is_empty() { "" } else { ": " };
        write!(f, "{}{between}{}", self.name, numbers.join(", "))
    }
}
