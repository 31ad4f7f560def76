//! The card of a model: inputs, outputs, training range and accuracy, for catalogues and other machines (docs/card.schema.json).

use formats::{FormatError, file};
use rom::inputs::{InputAxis, InputMap, Point};
use rom::model::{Model, RegimeModel, hex};
use rom::observable::{Correction, Observables};
use rom::statistics::ends;
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Licence of a model whose maker did not state one.
const NOT_STATED: &str = "not stated";

/// The card's place: beside the model, `.card.json` instead of `.twin`.
pub fn place(model: &Path) -> PathBuf {
    model.with_extension("card.json")
}

/// Writes the card of a model beside it. Without a licence that of the card that lies there stays.
///
/// # Errors
/// I/O errors.
pub fn save(
    path: &Path,
    model: &Model,
    file_hash: &[u8],
    licence: Option<&str>,
) -> Result<PathBuf, FormatError> {
    let text = format!("{:#}\n", card(path, model, file_hash, licence));
    let place = place(path);
    file::replace(&place, text.as_bytes())?;
    Ok(place)
}

/// The card of the model in this file; `file_hash` is the hash at the file's end.
pub fn card(path: &Path, model: &Model, file_hash: &[u8], licence: Option<&str>) -> Value {
    let header = &model.header;
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    let mut card = json!({
        "schema": "softtwin model card 1",
        "actuator": header.actuator,
        "file": name,
        "file_hash": hex(file_hash),
        "licence": licence.map_or_else(|| kept_licence(path), str::to_owned),
        "provenance": {
            "tool": concat!("softtwin ", env!("CARGO_PKG_VERSION")),
            "method": "proper orthogonal decomposition of finite-element snapshots, interpolated by radial basis functions",
            "database_hash": hex(&header.database_hash),
        },
        "inputs": header.taken_inputs().map(|(_, input)| json!({
            "name": input.key(), "unit": input.unit, "min": finite(input.range[0]), "max": finite(input.range[1]),
            "value": input.value })).collect::<Vec<_>>(),
        "outputs": outputs(model),
        "nodes": header.node_count,
        "node_sets": header.node_sets.iter().map(|set| (set.name.clone(), json!(set.nodes.len()))).collect::<Map<_, _>>(),
        "regimes": header.regimes.iter().map(|regime| (regime.kind.name().to_owned(), regime_of(model, regime)))
            .collect::<Map<_, _>>(),
    });
    if let Some(limit) = &header.limit {
        card["pressure_limit"] = json!({ "largest_mpa": limit.pressure_mpa, "reason": limit.reason });
    }
    card
}

fn outputs(model: &Model) -> Vec<Value> {
    let mut all = Vec::new();
    if model.header.has_forces() {
        all.push(json!({ "name": "contact_force_n", "unit": "N", "per": "state" }));
        all.extend(model.header.taken_inputs().map(|(_, input)| {
            json!({ "name": format!("force_by_{}", input.key()), "unit": format!("N/{}", input.unit), "per": "state" })
        }));
    }
    if model.header.onset.is_some() {
        all.push(json!({ "name": "onset_pressure_mpa", "unit": "MPa", "per": "state" }));
    }
    // Observables that do not fit are refused where the model is read.
    let observables = Observables::of(model).unwrap_or_default();
    let named = observables.names().zip(observables.units()).enumerate();
    all.extend(named.map(|(index, (name, unit))| {
        let mut one = json!({ "name": name, "unit": unit, "per": "state" });
        let own = observables.corrections().iter().filter(|(corrected, _)| *corrected == index);
        let offsets: Vec<Value> = own.map(|(_, correction)| offset_of(model, correction)).collect();
        if !offsets.is_empty() {
            one["measured_offset"] = offsets.into();
        }
        one
    }));
    all.extend(model.header.fields.iter().enumerate().map(|(index, field)| {
        let mut one = json!({ "name": field.spec.name, "unit": field.spec.unit, "per": "node" });
        let offsets: Vec<Value> =
            model.header.regimes.iter().filter_map(|regime| offset_of_field(model, regime, index)).collect();
        if !offsets.is_empty() {
            one["measured_offset"] = offsets.into();
        }
        one
    }));
    all
}

/// Where an observable's measured offset was measured, and its largest size there.
fn offset_of(model: &Model, correction: &Correction) -> Value {
    let sizes = correction.centres.iter().map(|centre| correction.at_scaled(centre).0.abs());
    json!({ "regime": correction.regime.name(), "measured": measured(model, &correction.inputs, &correction.centres),
        "largest": sizes.fold(0.0, f64::max), "half_width": correction.residual })
}

/// The same of a coordinate that the modes' measured difference moves: the largest at any node. The half-width is the displacement's.
fn offset_of_field(model: &Model, regime: &RegimeModel, field: usize) -> Option<Value> {
    let (difference, group) = (regime.difference.as_ref()?, regime.group_of(field)?);
    let is_moved = difference.coefficients.iter().any(|at| group.coefficients.contains(at));
    let modes = model.modes(regime.kind, field as u32).ok().filter(|_| is_moved)?;
    let mut largest: f64 = 0.0;
    for centre in &difference.centres {
        let mut all = vec![0.0; regime.coefficient_count()];
        difference.add(centre, &mut all, &mut Default::default());
        let own = &all[group.coefficients.clone()];
        for node in 0..modes.nodes() {
            let moved: f64 = own.iter().enumerate().map(|(mode, a)| a * modes.value(mode, node)).sum();
            largest = largest.max(moved.abs());
        }
    }
    Some(
        json!({ "regime": regime.kind.name(), "measured": measured(model, &regime.inputs, &difference.centres),
        "largest": largest, "half_width": difference.residual_mm }),
    )
}

/// Range of each input over the centres.
fn measured(model: &Model, inputs: &InputMap, centres: &[Point]) -> Map<String, Value> {
    let range = |(index, axis): (usize, &InputAxis)| {
        let values = centres.iter().map(|centre| axis.min + centre[index] * (axis.max - axis.min));
        (model.header.inputs[axis.input].key(), json!(ends(values)))
    };
    inputs.axes.iter().enumerate().map(range).collect()
}

/// Training range of a regime and the coverage of its half-widths there.
fn regime_of(model: &Model, regime: &RegimeModel) -> Value {
    let inputs = &model.header.inputs;
    let halfwidths = model.header.known_halfwidths(regime.halfwidths);
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    json!({
        "trained": regime.inputs.axes.iter()
            .map(|axis| (inputs[axis.input].key(), json!([axis.min, axis.max]))).collect::<Map<_, _>>(),
        "modes": regime.coefficient_count(),
        "accuracy": {
            "method": "conformal half-widths of the worst node, from errors of states that the fit did not see: left out one by one, or never trained on",
            "share_of_states": halfwidths.coverage,
            "displacement_mm": halfwidths.displacement_mm,
            "von_mises_mpa": finite(halfwidths.stress_mpa),
            "contact_force_n": finite(halfwidths.force_n),
        },
    })
}

/// The licence of the card that lies beside a model.
fn kept_licence(path: &Path) -> String {
    let text = file::read_text(&place(path), file::MAX_TEXT_BYTES).unwrap_or_default();
    let card: Value = serde_json::from_str(&text).unwrap_or_default();
    card["licence"].as_str().unwrap_or(NOT_STATED).to_owned()
}

/// A string or a number of the card; `-` for null.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "-".into(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

fn each(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The card as a page.
pub fn markdown(card: &Value) -> String {
    let line = |key: &str| shown(&card[key]);
    let mut page = format!(
        "# {}\n\nModel file `{}`, hash `{}`; licence: {}. Made by {} from the database `{}`.\n\n| input | unit | smallest | largest | value \
         |\n| --- | --- | --- | --- | --- |\n",
        line("actuator"),
        line("file"),
        line("file_hash"),
        line("licence"),
        shown(&card["provenance"]["tool"]),
        shown(&card["provenance"]["database_hash"])
    );
    for input in each(&card["inputs"]) {
        let cells = ["name", "unit", "min", "max", "value"].map(|key| shown(&input[key]));
        let _ = writeln!(page, "| {} |", cells.join(" | "));
    }
    if let Some(limit) = card.get("pressure_limit") {
        let _ = writeln!(
            page,
            "\nLargest pressure that was found possible: {} MPa ({}).",
            shown(&limit["largest_mpa"]),
            shown(&limit["reason"])
        );
    }
    page += "\n| output | unit | per |\n| --- | --- | --- |\n";
    for output in each(&card["outputs"]) {
        let cells = ["name", "unit", "per"].map(|key| shown(&output[key]));
        let _ = writeln!(page, "| {} |", cells.join(" | "));
    }
    page += "\n| regime | modes | share of states | displacement, mm | stress, MPa | force, N |\n| --- | --- | --- | --- | --- | --- |\n";
    for (name, regime) in card["regimes"].as_object().into_iter().flatten() {
        let keys = ["share_of_states", "displacement_mm", "von_mises_mpa", "contact_force_n"];
        let cells = keys.map(|key| shown(&regime["accuracy"][key]));
        let _ = writeln!(page, "| {name} | {} | {} |", shown(&regime["modes"]), cells.join(" | "));
    }
    page + "\nHalf-widths of the worst node from leave-one-out; they hold among the training states only.\n"
}

/// The card as a submodel of the Asset Administration Shell after the template Provision of Simulation Models (IDTA 02005).
pub fn submodel(card: &Value) -> Value {
    let property = |id: &str, value: &Value| json!({ "modelType": "Property", "idShort": id, "valueType": "xs:string", "value": shown(value) });
    let collection = |id: &str, value: Vec<Value>| json!({ "modelType": "SubmodelElementCollection", "idShort": id, "value": value });
    let said = |id: &str, text: String| json!({ "modelType": "MultiLanguageProperty", "idShort": id, "value": [{ "language": "en", "text": text }] });
    let port = |(index, (variable, causality)): (usize, (&Value, &str))| {
        let range = format!("{} .. {}", shown(&variable["min"]), shown(&variable["max"]));
        let range = if variable.get("min").is_some() { json!(range) } else { Value::Null };
        let facts = [
            property("VariableName", &variable["name"]),
            property("Range", &range),
            property("VariableType", &json!("Real")),
            property("UnitName", &variable["unit"]),
            property("VariableCausality", &json!(causality)),
        ];
        collection(&format!("VariablePort{index:02}"), facts.to_vec())
    };
    let variables = each(&card["inputs"]).iter().map(|input| (input, "input"));
    let variables = variables.chain(each(&card["outputs"]).iter().map(|output| (output, "output")));
    let file = json!({ "modelType": "File", "idShort": "DigitalFile", "contentType": "application/octet-stream",
        "value": card["file"] });
    let version = vec![property("ModelVersionId", &card["file_hash"]), file];
    let files =
        vec![property("ModelFileType", &json!("softtwin model")), collection("ModelFileVersion", version)];
    let actuator = shown(&card["actuator"]);
    let model = vec![
        said("Summary", format!("Reduced-order model of the soft pneumatic actuator {actuator}")),
        property("TypeOfModel", &card["provenance"]["method"]),
        property("LicenseModel", &card["licence"]),
        property(
            "ScopeOfModel",
            &json!("deformation, von Mises stress and contact force from pressure and gap"),
        ),
        collection("ModelFile", files),
        collection("Ports", variables.enumerate().map(port).collect()),
    ];
    json!({
        "modelType": "Submodel",
        "idShort": "SimulationModels",
        "id": format!("urn:softtwin:model:{}", shown(&card["file_hash"])),
        "semanticId": { "type": "ExternalReference", "keys": [{ "type": "GlobalReference",
            "value": "https://admin-shell.io/idta/SimulationModels/SimulationModels/1/0" }] },
        "submodelElements": [collection("SimulationModel00", model)],
    })
}
