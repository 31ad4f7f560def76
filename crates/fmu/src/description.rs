//! Variables of an FMU, inputs and outputs with their value references, and `modelDescription.xml`, which names them.

use rom::evaluation::NUMBERS;
use rom::inputs::{GAP, InputSpec};
use rom::model::{BlockKind, Model, ModelFileError, ModelHeader, hex};
use rom::observable::Observables;
use std::collections::BTreeSet;
use std::fmt::Write;

/// The model in an FMU's resources.
pub const MODEL_FILE: &str = "model.twin";
/// The chosen nodes in an FMU's resources: a line `NAME NUMBER` each.
pub const NODES_FILE: &str = "nodes.txt";

/// Value reference of the time.
pub(crate) const TIME: u32 = 0;
/// Value reference of the first input.
pub(crate) const FIRST_INPUT: u32 = 1;
/// Value reference of the first output.
pub(crate) const FIRST_OUTPUT: u32 = 100;

/// A node whose fields are outputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChosenNode {
    /// Name before the field's (`tip`).
    pub name: String,
    /// Its number in the model, from 0.
    pub node: u32,
}

/// Content of [`NODES_FILE`].
pub fn nodes_text(nodes: &[ChosenNode]) -> String {
    nodes.iter().map(|chosen| format!("{} {}\n", chosen.name, chosen.node)).collect()
}

/// Instantiation token, which identifies a description's resources: the hash at the end of the model file, and the nodes.
pub fn token(model_file: &[u8], nodes: &[ChosenNode]) -> String {
    let hash = model_file.last_chunk::<32>().copied().unwrap_or_default();
    nodes.iter().fold(hex(&hash), |token, chosen| format!("{token};{} {}", chosen.name, chosen.node))
}

/// Parses [`NODES_FILE`].
pub(crate) fn read_nodes(text: &str) -> Result<Vec<ChosenNode>, String> {
    let chosen = |(index, line): (usize, &str)| {
        let parts = line.split_once(' ').and_then(|(name, node)| Some((name, node.parse().ok()?)));
        let (name, node) =
            parts.ok_or(format!("{NODES_FILE}, line {}: expected NAME NUMBER, found {line:?}", index + 1))?;
        Ok(ChosenNode { name: name.into(), node })
    };
    text.lines().enumerate().map(chosen).collect()
}

/// Quantity of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputQuantity {
    /// One of [`NUMBERS`], by its position.
    Number(usize),
    /// Derivative of the force with respect to the input at this position.
    ForceBy(usize),
    MaxStress,
    /// An observable of the model, by its position.
    Observable(usize),
    ObservableHalfwidth(usize),
    /// A field at a chosen node, by their positions.
    AtNode {
        field: usize,
        chosen: usize,
    },
}

impl OutputQuantity {
    /// True for an Int32.
    pub(crate) fn is_integer(self) -> bool {
        matches!(self, Self::Number(at) if NUMBERS[at].unit.is_empty())
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Output {
    pub name: String,
    pub unit: String,
    pub about: &'static str,
    pub quantity: OutputQuantity,
}

/// The outputs in the order of their value references.
pub(crate) fn outputs(header: &ModelHeader, observables: &Observables, nodes: &[ChosenNode]) -> Vec<Output> {
    let mut all = Vec::new();
    let mut add = |name: String, unit: String, about: &'static str, quantity| {
        all.push(Output { name, unit, about, quantity });
    };
    for (index, number) in NUMBERS.iter().enumerate().filter(|(_, number)| header.has_number(number)) {
        add(number.key.into(), number.unit.into(), number.about, OutputQuantity::Number(index));
    }
    for (index, input) in header.taken_inputs().filter(|_| header.has_forces()) {
        let (name, unit) = (format!("force_by_{}", input.key()), format!("N/{}", input.unit));
        add(name, unit, "Derivative of the contact force", OutputQuantity::ForceBy(index));
    }
    if header.has_stress() {
        let (name, about) = ("max_von_mises_mpa", "Largest von Mises stress of all nodes");
        add(name.into(), "MPa".into(), about, OutputQuantity::MaxStress);
    }
    for (index, (name, unit)) in observables.names().zip(observables.units()).enumerate() {
        add(name.into(), unit.into(), "Observable of the shape", OutputQuantity::Observable(index));
        let halfwidth = format!("{name}_halfwidth");
        add(
            halfwidth,
            unit.into(),
            "Its half-width; NaN outside the training states",
            OutputQuantity::ObservableHalfwidth(index),
        );
    }
    for (chosen, node) in nodes.iter().enumerate() {
        for (field, output) in header.fields.iter().enumerate() {
            let (name, unit) = (format!("{}.{}", node.name, output.spec.name), output.spec.unit.clone());
            add(name, unit, "Field at a chosen node", OutputQuantity::AtNode { field, chosen });
        }
    }
    all
}

/// Initial values of the inputs: pressure 0, the largest training gap, the model's parameters.
pub(crate) fn start(model: &Model) -> Vec<f64> {
    let start = |(index, input): (usize, &InputSpec)| match input.value {
        Some(value) => value,
        None if index == GAP && input.range[1].is_finite() => input.range[1],
        None => 0.0,
    };
    model.header.inputs.iter().enumerate().map(start).collect()
}

/// Name of the library in `binaries/PLATFORM`, without its ending.
pub const IDENTIFIER: &str = "softtwin";

/// Units that FMI can express in SI base units.
const UNITS: [(&str, &str); 9] = [
    ("1", "<BaseUnit/>"),
    ("mm", "<BaseUnit m=\"1\" factor=\"1e-3\"/>"),
    ("MPa", "<BaseUnit kg=\"1\" m=\"-1\" s=\"-2\" factor=\"1e6\"/>"),
    ("N", "<BaseUnit kg=\"1\" m=\"1\" s=\"-2\"/>"),
    ("N/MPa", "<BaseUnit m=\"2\" factor=\"1e-6\"/>"),
    ("N/mm", "<BaseUnit kg=\"1\" s=\"-2\" factor=\"1e3\"/>"),
    ("kg/m3", "<BaseUnit kg=\"1\" m=\"-3\"/>"),
    ("1/mm", "<BaseUnit m=\"-1\" factor=\"1e3\"/>"),
    ("deg", "<BaseUnit rad=\"1\" factor=\"0.017453292519943295\"/>"),
];

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Description of a model's FMU. `token` identifies the library's resources and must be the same at instantiation.
///
/// # Errors
/// Observables that do not fit the model.
pub fn describe(model: &Model, nodes: &[ChosenNode], token: &str) -> Result<String, ModelFileError> {
    let header = &model.header;
    let outputs = outputs(header, &Observables::of(model)?, nodes);
    let name = escaped(&header.actuator);
    let version = env!("CARGO_PKG_VERSION");
    let units: BTreeSet<&str> = header
        .taken_inputs()
        .map(|(_, input)| input.unit.as_str())
        .chain(outputs.iter().map(|o| o.unit.as_str()))
        .collect();
    // Memory and motion are stepped inside: they are no differential equations that an importer could integrate.
    let has_memory = header.learned.as_ref().is_some_and(|map| map.has_memory())
        || model.blocks.iter().any(|(kind, _)| matches!(kind, BlockKind::Memory | BlockKind::Inertia));
    let exchange = if has_memory {
        String::new()
    } else {
        format!("<ModelExchange modelIdentifier=\"{IDENTIFIER}\" canGetAndSetFMUState=\"true\"/>\n  ")
    };
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"{name}\" \
         instantiationToken=\"{token}\" generationTool=\"softtwin {version}\" variableNamingConvention=\"flat\" \
         description=\"Digital twin of a soft pneumatic actuator; database {}\">\n  \
         {exchange}<CoSimulation modelIdentifier=\"{IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" \
         canGetAndSetFMUState=\"true\"/>\n  <UnitDefinitions>\n",
        hex(&header.database_hash)
    );
    for unit in units.iter().filter(|unit| !unit.is_empty()) {
        let base = UNITS.iter().find(|(known, _)| known == unit).map_or("", |(_, base)| base);
        let _ = writeln!(xml, "    <Unit name=\"{}\">{base}</Unit>", escaped(unit));
    }
    let _ = writeln!(
        xml,
        "  </UnitDefinitions>\n  <DefaultExperiment startTime=\"0\" stopTime=\"1\" stepSize=\"0.001\"/>\n  <ModelVariables>\n    \
         <Float64 name=\"time\" valueReference=\"{TIME}\" causality=\"independent\" variability=\"continuous\"/>"
    );
    let start = start(model);
    for (index, input) in header.taken_inputs() {
        let start = start[index];
        let _ = writeln!(
            xml,
            "    <Float64 name=\"{}\" valueReference=\"{}\" causality=\"input\" variability=\"continuous\" \
             unit=\"{}\" start=\"{start:?}\" \
             description=\"Trained from {} to {}\"/>",
            escaped(&input.key()),
            FIRST_INPUT + index as u32,
            escaped(&input.unit),
            input.range[0],
            input.range[1]
        );
    }
    for (index, output) in outputs.iter().enumerate() {
        let (name, about) = (escaped(&output.name), escaped(output.about));
        let number = FIRST_OUTPUT + index as u32;
        let (kind, unit) = match output.quantity.is_integer() {
            true => ("Int32", "variability=\"discrete\"".to_owned()),
            false => ("Float64", format!("variability=\"continuous\" unit=\"{}\"", escaped(&output.unit))),
        };
        let _ = writeln!(
            xml,
            "    <{kind} name=\"{name}\" valueReference=\"{number}\" causality=\"output\" {unit} \
             initial=\"calculated\" description=\"{about}\"/>"
        );
    }
    xml += "  </ModelVariables>\n  <ModelStructure>\n";
    for kind in ["Output", "InitialUnknown"] {
        for at in 0..outputs.len() as u32 {
            let _ = writeln!(xml, "    <{kind} valueReference=\"{}\"/>", FIRST_OUTPUT + at);
        }
    }
    Ok(xml + "  </ModelStructure>\n</fmiModelDescription>\n")
}
