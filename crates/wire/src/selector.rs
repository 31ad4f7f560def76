//! Selectors: a key expression with parameters, as Zenoh's `get` takes them.
//!
//! `softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30`: the key names actuator and kind of question, the parameters are
//! `name=value` pairs separated by `;` (Zenoh's way) or `&` (a browser's way). Any other name is a
//! parameter of the model; the twin refuses those that its model does not have.

use crate::keyexpr::{KeyExpr, KeyExprError};
use crate::layout::{PARAMETERS_MAX, Query, pack_name, query_kind, unpack_name};
use crate::topic::{MAX_NAME_LEN, ROOT, Topic};

/// A question with the actuators it goes to.
#[derive(Debug, Clone, PartialEq)]
pub struct Selector {
    key: KeyExpr,
    parameters: Query,
}

/// Error in a selector.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum SelectorError {
    /// The part before `?`.
    #[error("{0}")]
    Key(#[from] KeyExprError),
    /// The key matches no kind of question.
    #[error(
        "`{found}` asks nothing: expected softtwin/<actuator>/whatif, .../pressure or .../gap, with parameters after `?`"
    )]
    NoQuestion { found: String },
    /// A parameter without a name, or too many parameters.
    #[error(
        "`{found}`: expected name=value with one of the names pressure_mpa, gap_mm, force_n, force_halfwidth_n, field, or the \
         name of a parameter of the model (at most {PARAMETERS_MAX} of them)"
    )]
    Parameter { found: String },
    /// A value that is no finite number.
    #[error("{name}={found}: expected a finite number")]
    Value { name: String, found: String },
    /// A parameter given twice.
    #[error("{name} is given twice")]
    Twice { name: String },
    /// A parameter that the kind of question needs.
    #[error("a question for `{kind}` needs {missing}{}", taken_for_parameters(.parameters))]
    Missing {
        kind: &'static str,
        missing: String,
        /// The names given that are taken for parameters of the model: one may be a misspelling of a missing one.
        parameters: Vec<String>,
    },
    /// A node set's name that cannot be one.
    #[error(
        "field={found}: expected the name of a node set, 1 to {MAX_NAME_LEN} letters, digits, `_` or `-`"
    )]
    NodeSet { found: String },
}

impl Selector {
    /// Parses a selector and checks that every kind it asks for has what it needs.
    ///
    /// # Errors
    /// [`SelectorError`] says what is wrong and what was expected.
    pub fn parse(text: &str) -> Result<Self, SelectorError> {
        let (key, parameters) = text.split_once('?').unwrap_or((text, ""));
        let key = KeyExpr::new(key)?;
        let mut query = Query::default();
        let mut seen: Vec<&str> = Vec::new();
        for pair in parameters.split([';', '&']).filter(|pair| !pair.is_empty()) {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            if seen.contains(&name) {
                return Err(SelectorError::Twice { name: name.into() });
            }
            seen.push(name);
            set(&mut query, pair, name, value)?;
        }
        let selector = Self { key, parameters: query };
        selector.check()?;
        Ok(selector)
    }

    /// The questions this selector asks of one actuator.
    pub fn questions(&self, actuator: &str) -> Vec<Query> {
        query_kind::ALL
            .iter()
            .filter(|kind| self.key.matches(&format!("{ROOT}/{actuator}/{}", kind.name)))
            .map(|kind| Query { kind: kind.number, ..self.parameters })
            .collect()
    }

    /// The one actuator it names; `None`: it has a wildcard there, so that twins have to be looked for.
    pub fn actuator(&self) -> Option<&str> {
        self.key.as_str().split('/').nth(1).filter(|name| Topic::state(name).is_ok())
    }

    /// The key expression.
    pub fn key(&self) -> &KeyExpr {
        &self.key
    }

    fn check(&self) -> Result<(), SelectorError> {
        let asked = self.questions(self.actuator().unwrap_or("any"));
        if asked.is_empty() {
            return Err(SelectorError::NoQuestion { found: self.key.to_string() });
        }
        asked.iter().try_for_each(needs)
    }
}

fn set(query: &mut Query, pair: &str, name: &str, value: &str) -> Result<(), SelectorError> {
    let number: Option<f64> = value.parse().ok().filter(|number: &f64| number.is_finite());
    let number = || number.ok_or_else(|| SelectorError::Value { name: name.into(), found: value.into() });
    let slot = match name {
        "pressure_mpa" => &mut query.pressure_mpa,
        "gap_mm" => &mut query.gap_mm,
        "force_n" => &mut query.force_n,
        "force_halfwidth_n" => &mut query.force_halfwidth_n,
        "field" => {
            let set = if value.is_empty() { "all" } else { value };
            if Topic::field("any", Some(set)).is_err() {
                return Err(SelectorError::NodeSet { found: value.into() });
            }
            (query.want_field, query.node_set) = (1, pack_name(set));
            return Ok(());
        }
        _ if !name.is_empty() && query.set_parameter(name, number()?) => return Ok(()),
        _ => return Err(SelectorError::Parameter { found: pair.into() }),
    };
    *slot = number()?;
    Ok(())
}

fn taken_for_parameters(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; taken for parameters of the model: {}", names.join(", ")),
    }
}

fn needs(query: &Query) -> Result<(), SelectorError> {
    // A fixed gap needs not be given: the twin then takes its own (see the scene), and says so when there is none. Nor need the
    // pressure beside inputs by name: only the twin knows whether its model has one.
    let needed: &[(&str, f64)] = match query.kind {
        query_kind::WHATIF if query.parameter_count > 0 => &[],
        query_kind::WHATIF => &[("pressure_mpa", query.pressure_mpa)],
        query_kind::PRESSURE => &[("force_n", query.force_n)],
        _ => &[("pressure_mpa", query.pressure_mpa), ("force_n", query.force_n)],
    };
    let missing: Vec<&str> =
        needed.iter().filter(|(_, value)| value.is_nan()).map(|(name, _)| *name).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let (kind, missing) = (query_kind::as_str(query.kind), missing.join(" and "));
    let parameters = query.parameters().map(|(name, _)| unpack_name(name)).collect();
    Err(SelectorError::Missing { kind, missing, parameters })
}
