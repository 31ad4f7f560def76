//! Topic names: `softtwin/<actuator>/<kind>`.

use crate::error::WireError;
use crate::keyexpr::KeyExpr;
use std::fmt;

/// First chunk of every name.
pub const ROOT: &str = "softtwin";

/// Payload kind of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TopicKind {
    /// Readings: [`crate::SensorSample`].
    Sensor,
    /// Fields: [`crate::FieldHeader`] and `[f32]`.
    Field,
    /// The small state: [`crate::State`].
    State,
    /// Counters and latencies at 1 Hz: [`crate::Health`].
    Health,
    /// Whether a gripper holds its object: [`crate::Grasp`]. The second chunk is the scene's name.
    Grasp,
    /// Pressure wanted by a controller: [`crate::Command`].
    Command,
    /// Estimated quantities: [`crate::Estimate`].
    Estimate,
    /// Setpoint of a valve's owner: [`crate::Setpoint`].
    Setpoint,
    /// Override of a valve by an operator: [`crate::Setpoint`].
    Override,
    /// Target of a held quantity: [`crate::Target`].
    Target,
    /// State and written value of a valve: [`crate::Valve`].
    Valve,
}

impl TopicKind {
    /// All kinds.
    pub const ALL: [Self; 11] = [
        Self::Sensor,
        Self::Field,
        Self::State,
        Self::Health,
        Self::Grasp,
        Self::Command,
        Self::Estimate,
        Self::Setpoint,
        Self::Override,
        Self::Target,
        Self::Valve,
    ];

    /// The chunk in a topic's name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Sensor => "sensor",
            Self::Field => "field",
            Self::State => "state",
            Self::Health => "health",
            Self::Grasp => "grasp",
            Self::Command => "command",
            Self::Estimate => "estimate",
            Self::Setpoint => "setpoint",
            Self::Override => "override",
            Self::Target => "target",
            Self::Valve => "valve",
        }
    }

    /// Meaning of a fourth chunk; `None`: a name has none.
    fn part(self) -> Option<&'static str> {
        match self {
            Self::Field => Some(NODE_SET),
            Self::Setpoint | Self::Override | Self::Valve => Some(CAVITY),
            _ => None,
        }
    }
}

/// Fourth chunk of the names of fields and of valves.
const NODE_SET: &str = "node set";
const CAVITY: &str = "cavity";

/// One topic: a plain key (no wildcard) with its parts.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Topic {
    name: String,
    actuator: String,
    kind: TopicKind,
    part: Option<String>,
}

/// One constructor per kind of topic without a node set.
macro_rules! constructors {
    ($($function:ident: $kind:ident, $name:literal;)+) => {
        impl Topic {
            $(
                #[doc = concat!("`softtwin/<actuator>/", $name, "`.")]
                ///
                /// # Errors
                /// [`WireError::BadName`] when the name is not one chunk of letters, digits, `_` or `-`.
                pub fn $function(actuator: &str) -> Result<Self, WireError> {
                    Self::build(actuator, TopicKind::$kind, None)
                }
            )+
        }
    };
}
constructors! {
    sensor: Sensor, "sensor";
    state: State, "state";
    health: Health, "health";
    grasp: Grasp, "grasp";
    command: Command, "command";
    estimate: Estimate, "estimate";
    setpoint: Setpoint, "setpoint";
    operator: Override, "override";
    target: Target, "target";
    valve: Valve, "valve";
}

impl Topic {
    /// `softtwin/<actuator>/field` for all nodes (`node_set` `None` or `"all"`), else `softtwin/<actuator>/field/<node_set>`.
    ///
    /// # Errors
    /// As [`Topic::sensor`], for both names.
    pub fn field(actuator: &str, node_set: Option<&str>) -> Result<Self, WireError> {
        Self::build(actuator, TopicKind::Field, node_set.filter(|set| *set != "all"))
    }

    /// Reads a topic back from its name; `None` for names that are not ours.
    pub fn parse(name: &str) -> Option<Self> {
        let mut chunks = name.split('/');
        if chunks.next() != Some(ROOT) {
            return None;
        }
        let actuator = chunks.next()?;
        let name = chunks.next()?;
        let kind = TopicKind::ALL.into_iter().find(|kind| kind.as_str() == name)?;
        let part = chunks.next();
        if chunks.next().is_some() || (part.is_some() && kind.part().is_none()) {
            return None;
        }
        Self::build(actuator, kind, part).ok()
    }

    /// This topic of a valve for the cavity of the input `pressure_mpa.<cavity>`, `softtwin/<actuator>/<kind>/<cavity>`; `None`: that of
    /// `pressure_mpa`.
    ///
    /// # Errors
    /// As [`Topic::sensor`], for the cavity; a topic of another kind than those of a valve.
    pub fn of_cavity(&self, cavity: Option<&str>) -> Result<Self, WireError> {
        if self.kind.part() != Some(CAVITY) {
            return Err(WireError::BadName { what: CAVITY, found: self.name.clone() });
        }
        Self::build(&self.actuator, self.kind, cavity)
    }

    fn build(actuator: &str, kind: TopicKind, part: Option<&str>) -> Result<Self, WireError> {
        check_name("actuator", actuator)?;
        let mut name = format!("{ROOT}/{actuator}/{}", kind.as_str());
        if let Some(part) = part {
            check_name(kind.part().unwrap_or_default(), part)?;
            name = format!("{name}/{part}");
        }
        Ok(Self { name, actuator: actuator.into(), kind, part: part.map(Into::into) })
    }

    /// The whole name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The actuator's name (of a grasp: the scene's).
    pub fn actuator(&self) -> &str {
        &self.actuator
    }

    /// Payload kind.
    pub fn kind(&self) -> TopicKind {
        self.kind
    }

    /// The node set of a field topic; `None`: all nodes.
    pub fn node_set(&self) -> Option<&str> {
        self.part.as_deref().filter(|_| self.kind == TopicKind::Field)
    }

    /// The cavity of a valve's topic; `None`: that of `pressure_mpa`.
    pub fn cavity(&self) -> Option<&str> {
        self.part.as_deref().filter(|_| self.kind.part() == Some(CAVITY))
    }

    /// Whether `key` matches this topic's name.
    pub fn matches(&self, key: &KeyExpr) -> bool {
        key.matches(&self.name)
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// Longest name of an actuator or a node set: it travels in a 32-byte field of the headers.
pub const MAX_NAME_LEN: usize = 31;

pub(crate) fn check_name(what: &'static str, name: &str) -> Result<(), WireError> {
    let plain = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-');
    if name.is_empty() || name.len() > MAX_NAME_LEN || !plain {
        return Err(WireError::BadName { what, found: name.to_owned() });
    }
    Ok(())
}
