//! `modelDescription.xml`.

use crate::variables::{ChosenNode, FIRST_INPUT, FIRST_OUTPUT, TIME, outputs, start};
use rom::model::{BlockKind, Model, ModelFileError};
use rom::observable::Observables;
use std::collections::BTreeSet;
use std::fmt::Write;

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
    let has_memory =
        model.blocks.iter().any(|(kind, _)| matches!(kind, BlockKind::Memory | BlockKind::Inertia));
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
        header.database_hash.iter().map(|byte| format!("{byte:02x}")).collect::<String>()
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
    for (at, input) in header.taken_inputs() {
        let start = start[at];
        let _ = writeln!(
            xml,
            "    <Float64 name=\"{}\" valueReference=\"{}\" causality=\"input\" variability=\"continuous\" \
             unit=\"{}\" start=\"{start:?}\" \
             description=\"Trained from {} to {}\"/>",
            escaped(&input.key()),
            FIRST_INPUT + at as u32,
            escaped(&input.unit),
            input.range[0],
            input.range[1]
        );
    }
    for (at, output) in outputs.iter().enumerate() {
        let (name, about) = (escaped(&output.name), escaped(output.about));
        let number = FIRST_OUTPUT + at as u32;
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
