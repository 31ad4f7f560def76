//! The models the viewer knows: their visible surfaces, and predictions for "what if".

use crate::frame::{FrameHead, bits, encode};
use anyhow::{Context, Result, bail};
use picture::visible::visible_facets;
use rom::inputs::{GAP, InputSpec, Inputs};
use rom::model::{Model, Nodes, Selection};
use rom::model_state::ModelState;
use rom::snapshots::Footprint;
use runtime::config::{ActuatorSpec, BlockSpec, PlaceSpec, Scene};
use runtime::load::PayloadContents;
use runtime::publish::state_of;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use wire::layout::field_id;

/// Name of the predicted actuator on the browser.
const PREDICTION: &str = "what if";

/// Name of the first cavity; the others are `cavity.NAME`, with the pressure `pressure_mpa.NAME`. Volumes are `material.NAME`.
const CAVITY: &str = "cavity";

/// All loaded models, and the positions of actuators and blocks in the scene.
pub struct Catalogue {
    models: Vec<Known>,
    stand: Stand,
}

/// Where things stand, for pages.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Stand {
    /// Actuators by name; without any they stand one behind the other.
    places: BTreeMap<String, PlaceSpec>,
    /// Plates by the actuators above them; below others the one of their model's card.
    plates: BTreeMap<String, Footprint>,
    blocks: Vec<BlockSpec>,
}

impl Stand {
    /// Content of a scene file.
    pub fn of(scene: &Scene) -> Self {
        let is_given = scene.actuators.iter().any(|actuator| actuator.place != PlaceSpec::default());
        let given = scene.actuators.iter().filter(|_| is_given);
        let places = given.map(|actuator| (actuator.name.clone(), actuator.place)).collect();
        let plated = |actuator: &ActuatorSpec| Some((actuator.name.clone(), actuator.plate?));
        Self {
            places,
            plates: scene.actuators.iter().filter_map(plated).collect(),
            blocks: scene.blocks.clone(),
        }
    }
}

/// A model with its file and the hash at the file's end.
pub struct NamedModel {
    pub path: PathBuf,
    pub model: Model,
    pub hash: [u8; 32],
}

/// One model as the browser sees it.
struct Known {
    card: Card,
    /// File of a measured model, whose outputs are drawn as curves.
    measured: Option<PathBuf>,
    hash: [u8; 16],
    /// All inputs, in the model's order.
    inputs: Vec<InputSpec>,
    node_sets: Vec<rom::snapshots::NodeSet>,
    node_count: usize,
    /// The visible nodes, ascending.
    visible: Vec<u32>,
    mesh_message: Option<Vec<u8>>,
    prediction: Mutex<Prediction>,
}

/// Description of a model for the browser.
#[derive(Clone, Debug, Serialize)]
pub struct Card {
    /// Its number.
    id: usize,
    /// Its file's name.
    name: String,
    /// Ranges of the inputs.
    inputs: Vec<InputCard>,
    /// Extent of a plate that suits its nodes.
    obstacle: Footprint,
}

/// One input of a model, as a slider.
#[derive(Clone, Debug, Serialize)]
struct InputCard {
    /// Name and unit as a key (`pressure_mpa`).
    key: String,
    name: String,
    unit: String,
    /// Trained values.
    range: [f64; 2],
    /// Values that are answered.
    limits: [f64; 2],
    /// Nominal value of a parameter.
    nominal: Option<f64>,
}

/// A model's visible nodes at one state, with the names of its fields.
struct Prediction {
    state: ModelState,
    contents: PayloadContents,
    fields: Vec<&'static str>,
}

/// Header of a mesh message: behind it `3 x nodes` coordinates, `3 x facets` node numbers, `nodes` node names, then `3 x facets` node numbers
/// of each cavity and material.
#[derive(Serialize)]
struct MeshHead {
    kind: &'static str,
    model: usize,
    nodes: usize,
    facets: usize,
    cavities: Vec<CavityHead>,
}

/// One of several cavities or materials.
#[derive(Serialize)]
struct CavityHead {
    name: String,
    /// Key of its pressure in the inputs; no input has that of a material.
    input: String,
    facets: usize,
}

impl Catalogue {
    /// Where actuators and blocks stand.
    pub fn stand(&self) -> &Stand {
        &self.stand
    }

    /// Prepares the models for viewing.
    ///
    /// # Errors
    /// A model that cannot be made ready to predict.
    pub fn new(models: &[NamedModel], stand: Stand) -> Result<Self> {
        let models = models.iter().enumerate().map(|(id, named)| Known::new(id, named));
        Ok(Self { models: models.collect::<Result<_>>()?, stand })
    }

    /// First message to the browser.
    pub fn cards(&self) -> Vec<&Card> {
        self.models.iter().map(|known| &known.card).collect()
    }

    /// Mesh messages, one a model that has a surface.
    pub fn meshes(&self) -> impl Iterator<Item = &[u8]> {
        self.models.iter().filter_map(|known| known.mesh_message.as_deref())
    }

    /// Files of the measured models.
    pub fn measured(&self) -> impl Iterator<Item = &Path> {
        self.models.iter().filter_map(|known| known.measured.as_deref())
    }

    /// The model with this hash, if it is known.
    pub fn find(&self, hash: [u8; 16]) -> Option<usize> {
        self.models.iter().position(|known| known.hash == hash)
    }

    pub fn inputs(&self, model: usize) -> &[InputSpec] {
        self.models.get(model).map_or(&[], |known| &known.inputs)
    }

    /// For each visible node of a model its place in a sample of a node set; none when some are not in it.
    pub fn places(&self, model: usize, node_set: &str) -> Option<Vec<u32>> {
        let known = self.models.get(model).filter(|known| known.mesh_message.is_some())?;
        if node_set.is_empty() || node_set == "all" {
            return Some(known.visible.clone());
        }
        let set = known.node_sets.iter().find(|set| set.name == node_set)?;
        let mut place = vec![u32::MAX; known.node_count];
        for (k, node) in set.nodes.iter().enumerate() {
            place[*node as usize] = k as u32;
        }
        let places: Vec<u32> = known.visible.iter().map(|node| place[*node as usize]).collect();
        (!places.contains(&u32::MAX)).then_some(places)
    }

    /// Predicts a state and makes a frame of it, from the inputs by key. Without a gap there is no plate.
    ///
    /// # Errors
    /// The refusal for the user: no such model or input, or values beyond what any such actuator can have.
    pub fn predict(&self, model: usize, values: &BTreeMap<String, f64>) -> Result<Vec<u8>, String> {
        let known = self
            .models
            .get(model)
            .ok_or_else(|| format!("there is no model {model}; start `softtwin view` with its FILE.twin"))?;
        let inputs = known.inputs(values)?;
        let mut prediction = known.prediction.lock().unwrap_or_else(PoisonError::into_inner);
        prediction.answer(inputs, known).map_err(|error| error.to_string())
    }

    /// The largest von Mises stress (MPa) of a recorded state; none when the model cannot say it.
    pub fn largest_stress_mpa(&self, model: usize, inputs: Inputs) -> Option<f64> {
        let known = self.models.get(model)?;
        let mut prediction = known.prediction.lock().unwrap_or_else(PoisonError::into_inner);
        let mut head = FrameHead::empty(PREDICTION);
        prediction.shape(inputs, known, &mut head).ok()?;
        Some(head.max_von_mises_mpa).filter(|stress| stress.is_finite())
    }

    /// Makes a frame of a recorded state: its numbers are in `head`, its shape is computed. `O(visible nodes x modes)`.
    ///
    /// # Errors
    /// When the model cannot reconstruct the state's regime.
    pub fn replay(&self, model: usize, inputs: Inputs, mut head: FrameHead) -> Result<Vec<u8>> {
        let known = self.models.get(model).context("no such model")?;
        let mut prediction = known.prediction.lock().unwrap_or_else(PoisonError::into_inner);
        let values = prediction.shape(inputs, known, &mut head)?;
        Ok(encode(&head, &[&values]))
    }
}

impl Known {
    /// The model's inputs from values by key.
    fn inputs(&self, values: &BTreeMap<String, f64>) -> Result<Inputs, String> {
        let cards = &self.card.inputs;
        if let Some(key) = values.keys().find(|key| cards.iter().all(|card| card.key != **key)) {
            let known: Vec<&str> = cards.iter().map(|card| card.key.as_str()).collect();
            return Err(format!("expected inputs of the model ({}), found {key:?}", known.join(", ")));
        }
        let mut inputs = Inputs::new(f64::NAN, f64::INFINITY);
        for card in cards {
            let [low, high] = card.limits;
            match (values.get(&card.key), self.inputs.iter().position(|input| input.key() == card.key)) {
                (Some(value), Some(at)) if (low..=high).contains(value) => inputs = inputs.with(at, *value),
                (None, Some(GAP)) => {}
                (found, _) => {
                    let found = found.map_or("none".into(), f64::to_string);
                    let (name, unit) = (&card.name, &card.unit);
                    return Err(format!("expected a {name} of {low} to {high:.2} {unit}, found {found}"));
                }
            }
        }
        Ok(inputs)
    }

    fn new(id: usize, NamedModel { path, model, hash }: &NamedModel) -> Result<Self> {
        let header = &model.header;
        let undeformed = model.undeformed_nodes_mm();
        let facets = model.facets();
        let visible_facets = undeformed.as_ref().map_or_else(Vec::new, |nodes| visible_facets(nodes, facets));
        let cavities = cavities(&header.node_sets, facets, header.node_count);
        let walls = cavities.iter().flat_map(|(_, walls)| walls.as_flattened());
        let mut visible: Vec<u32> = visible_facets.as_flattened().iter().chain(walls).copied().collect();
        visible.sort_unstable();
        visible.dedup();
        let corners = corners(header.node_count, &visible, &visible_facets);
        let mesh_message = undeformed
            .filter(|_| !visible.is_empty())
            .map(|nodes| mesh_message(id, &nodes, &visible, &corners, &cavities));
        let nodes = if visible.is_empty() { Nodes::All } else { Nodes::List(visible.clone()) };
        Ok(Self {
            card: Card {
                id,
                name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                inputs: header.inputs.iter().filter_map(InputCard::new).collect(),
                obstacle: model.plate(),
            },
            measured: model.is_measured().then(|| path.clone()),
            hash: std::array::from_fn(|k| hash[k]),
            inputs: header.inputs.clone(),
            node_sets: header.node_sets.clone(),
            node_count: header.node_count,
            visible,
            mesh_message,
            prediction: Mutex::new(
                Prediction::new(model, nodes)
                    .with_context(|| format!("cannot predict with the model: {}", path.display()))?,
            ),
        })
    }
}

impl InputCard {
    /// `None` if the model was not trained over the input.
    fn new(spec: &InputSpec) -> Option<Self> {
        let [low, high] = spec.range;
        let beyond = 10.0 * (high - low).max(high.abs());
        let least = if low >= 0.0 { 0.0 } else { low - beyond };
        let (key, name, unit) = (spec.key(), spec.name.clone(), spec.unit.clone());
        let card =
            Self { key, name, unit, range: spec.range, limits: [least, high + beyond], nominal: spec.value };
        beyond.is_finite().then_some(card)
    }
}

/// The corners of facets as places among the visible nodes.
fn corners(node_count: usize, visible: &[u32], facets: &[[u32; 3]]) -> Vec<u32> {
    let mut place = vec![0; node_count];
    for (k, node) in visible.iter().enumerate() {
        place[*node as usize] = k as u32;
    }
    facets.as_flattened().iter().map(|node| place[*node as usize]).collect()
}

/// Walls of each of several cavities, surface of each material: facets whose nodes are all in the node set with its name.
fn cavities<'a>(
    node_sets: &'a [rom::snapshots::NodeSet],
    facets: &[[u32; 3]],
    node_count: usize,
) -> Vec<(&'a str, Vec<[u32; 3]>)> {
    let named = node_sets.iter().filter(|set| {
        set.name == CAVITY || ["cavity.", "material."].iter().any(|part| set.name.starts_with(part))
    });
    let walls = |set: &'a rom::snapshots::NodeSet| {
        let mut is_in = vec![false; node_count];
        set.nodes.iter().for_each(|node| is_in[*node as usize] = true);
        let inside = |facet: &&[u32; 3]| facet.iter().all(|node| is_in[*node as usize]);
        (set.name.as_str(), facets.iter().filter(inside).copied().collect())
    };
    named.map(walls).collect()
}

fn mesh_message(
    id: usize,
    nodes: &[[f32; 3]],
    visible: &[u32],
    facets: &[u32],
    cavities: &[(&str, Vec<[u32; 3]>)],
) -> Vec<u8> {
    let coordinates = bits(visible.iter().flat_map(|node| nodes[*node as usize]));
    let walls: Vec<u32> =
        cavities.iter().flat_map(|(_, walls)| corners(nodes.len(), visible, walls)).collect();
    let cavities = cavities.iter().map(|(name, walls)| CavityHead {
        name: (*name).into(),
        input: name.replacen(CAVITY, "pressure_mpa", 1),
        facets: walls.len(),
    });
    let head = MeshHead {
        kind: "mesh",
        model: id,
        nodes: visible.len(),
        facets: facets.len() / 3,
        cavities: cavities.collect(),
    };
    encode(&head, &[&coordinates, facets, visible, &walls])
}

impl Prediction {
    fn new(model: &Model, nodes: Nodes) -> Result<Self> {
        let state = ModelState::new(model, &Selection { fields: None, nodes })?;
        let names = model.header.fields.iter().map(|field| field.spec.name.as_str());
        let known = |name| field_id::from_name(name).map_or("other", field_id::as_str);
        let contents = PayloadContents::new(model, state.evaluator())?;
        Ok(Self { state, contents, fields: names.map(known).collect() })
    }

    /// The values to send and their description in the header.
    fn shape(&mut self, inputs: Inputs, known: &Known, head: &mut FrameHead) -> Result<Vec<u32>> {
        let updated = self.state.update(inputs);
        if let Some(why) = self.state.evaluator().refusal(self.state.evaluation()) {
            bail!(why);
        }
        updated?;
        let (rows, values) = (self.state.reconstructor().rows(), self.state.fields());
        head.model = known.mesh_message.is_some().then_some(known.card.id);
        head.fields.clone_from(&self.fields);
        head.count = rows;
        if let Some(field) = self.fields.iter().position(|name| *name == "von_mises") {
            let stress = &values[field * rows..(field + 1) * rows];
            let largest = stress.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            head.max_von_mises_mpa = largest.map_or(f64::NAN, |(_, value)| f64::from(*value));
            head.max_von_mises_node = largest.and_then(|(k, _)| known.visible.get(k).copied());
        }
        Ok(bits(values.iter().copied()))
    }

    fn answer(&mut self, inputs: Inputs, known: &Known) -> Result<Vec<u8>> {
        let mut head = FrameHead::empty(PREDICTION);
        let values = self.shape(inputs, known, &mut head)?;
        head.predicted = true;
        head.set_state(&state_of(self.state.evaluation(), &self.contents));
        Ok(encode(&head, &[&values]))
    }
}

#[cfg(test)]
#[path = "../tests/unit/catalogue.rs"]
mod tests;
