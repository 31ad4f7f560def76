//! One model as a page shows it.

use crate::frame::{PredictionHead, Shape, bits, encode};
use rom::evaluation::Evaluation;
use rom::inputs::{GAP, InputSpec, Inputs};
use rom::model::{Model, ModelFileError, Nodes, Selection};
use rom::reconstructor::Reconstructor;
use rom::session::{Gaps, Session};
use rom::snapshots::{Footprint, NodeSet};
use serde::Serialize;
use std::collections::BTreeMap;

/// Name of the predicted actuator on the page.
const PREDICTION: &str = "what if";

/// Name of the first cavity; the others are `cavity.NAME`, with the pressure `pressure_mpa.NAME`. Volumes are `material.NAME`.
const CAVITY: &str = "cavity";

/// Fields that a page knows by name; it shows no others.
const FIELDS: [&str; 5] = ["x", "y", "z", "displacement", "von_mises"];

/// A model with its visible surface, ready to predict.
pub struct Figure {
    card: Card,
    /// All inputs, in the model's order.
    inputs: Vec<InputSpec>,
    /// The visible nodes by their numbers in the whole model, ascending.
    visible: Vec<u32>,
    mesh: Option<Vec<u8>>,
    fields: Vec<&'static str>,
    session: Session,
    reconstructor: Reconstructor,
    evaluation: Evaluation,
    values: Vec<f32>,
}

/// Description of a model for the page.
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
    /// Its answers depend on the past: it moves while the sliders stand still.
    moves: bool,
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

impl Figure {
    /// Prepares a model. `facets` are those of its surface that can be seen from outside.
    ///
    /// # Errors
    /// A model that cannot predict.
    pub fn new(model: &Model, id: usize, name: String, facets: &[[u32; 3]]) -> Result<Self, ModelFileError> {
        let numbers = (0..model.header.node_count as u32).collect();
        Self::with_numbers(model, id, name, facets, numbers)
    }

    /// As [`Self::new`] for a model that was cut to its visible nodes ([`Model::at_nodes`]); `numbers` are those of its nodes in the whole
    /// model.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_part(model: &Model, name: String, numbers: Vec<u32>) -> Result<Self, ModelFileError> {
        Self::with_numbers(model, 0, name, model.facets(), numbers)
    }

    fn with_numbers(
        model: &Model,
        id: usize,
        name: String,
        facets: &[[u32; 3]],
        numbers: Vec<u32>,
    ) -> Result<Self, ModelFileError> {
        let header = &model.header;
        let undeformed = model.undeformed_nodes_mm();
        let cavities = cavities(&header.node_sets, model.facets(), header.node_count);
        let walls = cavities.iter().flat_map(|(_, walls)| walls.as_flattened());
        let mut visible: Vec<u32> = facets.as_flattened().iter().chain(walls).copied().collect();
        visible.sort_unstable();
        visible.dedup();
        let number = |node: &u32| numbers.get(*node as usize).copied().unwrap_or(*node);
        let names: Vec<u32> = visible.iter().map(number).collect();
        let mesh = undeformed
            .filter(|_| !visible.is_empty())
            .map(|nodes| mesh_message(id, &nodes, &visible, &names, facets, &cavities));
        let nodes = if visible.is_empty() { Nodes::All } else { Nodes::List(visible) };
        let session = Session::new(model, Gaps::Live)?;
        let reconstructor = Reconstructor::new(model, &Selection { fields: None, nodes })?;
        let known = |name: &str| FIELDS.into_iter().find(|field| *field == name).unwrap_or("other");
        Ok(Self {
            card: Card {
                id,
                name,
                inputs: header.inputs.iter().filter_map(InputCard::new).collect(),
                obstacle: model.plate(),
                moves: session.has_memory(),
            },
            inputs: header.inputs.clone(),
            mesh,
            visible: names,
            fields: header.fields.iter().map(|field| known(&field.spec.name)).collect(),
            evaluation: session.evaluation(),
            values: vec![0.0; reconstructor.entries()],
            session,
            reconstructor,
        })
    }

    /// Its description.
    pub fn card(&self) -> &Card {
        &self.card
    }

    /// Its inputs, in the model's order.
    pub fn inputs(&self) -> &[InputSpec] {
        &self.inputs
    }

    /// Its visible nodes, ascending; empty for a model without a surface, whose nodes are all shown as points.
    pub fn visible(&self) -> &[u32] {
        &self.visible
    }

    /// The message with its surface; none for a model without one.
    pub fn mesh(&self) -> Option<&[u8]> {
        self.mesh.as_deref()
    }

    /// The frame of a settled state, from the inputs by key. Without a gap there is no plate.
    ///
    /// # Errors
    /// The refusal for the user: no such input, or values beyond what any such actuator can have.
    pub fn predict(&mut self, values: &BTreeMap<String, f64>) -> Result<Vec<u8>, String> {
        let inputs = self.read(values)?;
        let (shape, values) = self.shape(inputs)?;
        Ok(self.frame(&shape, &values))
    }

    /// The frame of a model with a past, at a time after which the sliders have these values.
    ///
    /// # Errors
    /// As [`Self::predict`]; also a time that is not after the last one.
    pub fn step(&mut self, t_ns: u64, values: &BTreeMap<String, f64>) -> Result<Vec<u8>, String> {
        let inputs = self.read(values)?;
        self.session.step(t_ns, inputs, &mut self.evaluation).map_err(|error| error.to_string())?;
        let (shape, values) = self.reconstructed()?;
        Ok(self.frame(&shape, &values))
    }

    /// The values of a settled state, and what they are. `O(visible nodes x modes)`.
    ///
    /// # Errors
    /// Why the model has no answer there.
    pub fn shape(&mut self, inputs: Inputs) -> Result<(Shape, Vec<u32>), String> {
        self.session.evaluator().evaluate(inputs, &mut self.evaluation);
        self.reconstructed()
    }

    fn reconstructed(&mut self) -> Result<(Shape, Vec<u32>), String> {
        if let Some(why) = self.session.evaluator().refusal(&self.evaluation) {
            return Err(why);
        }
        let values = &mut self.values;
        self.reconstructor.reconstruct_into(&self.evaluation, values).map_err(|error| error.to_string())?;
        let rows = self.reconstructor.rows();
        let stress = self.fields.iter().position(|name| *name == "von_mises");
        let stress = stress.map(|field| &values[field * rows..(field + 1) * rows]);
        let largest = stress.and_then(|all| all.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)));
        let shape = Shape {
            model: self.mesh.is_some().then_some(self.card.id),
            fields: self.fields.clone(),
            count: rows,
            max_von_mises_mpa: largest.map_or(f64::NAN, |(_, value)| f64::from(*value)),
            max_von_mises_node: largest.and_then(|(k, _)| self.visible.get(k).copied()),
        };
        Ok((shape, bits(values.iter().copied())))
    }

    fn frame(&self, shape: &Shape, values: &[u32]) -> Vec<u8> {
        let head = PredictionHead::new(PREDICTION, self.session.evaluator(), &self.evaluation, shape);
        encode(&head, &[values])
    }

    /// The model's inputs from values by key.
    fn read(&self, values: &BTreeMap<String, f64>) -> Result<Inputs, String> {
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
    node_sets: &'a [NodeSet],
    facets: &[[u32; 3]],
    node_count: usize,
) -> Vec<(&'a str, Vec<[u32; 3]>)> {
    let named = node_sets.iter().filter(|set| {
        set.name == CAVITY || ["cavity.", "material."].iter().any(|part| set.name.starts_with(part))
    });
    let walls = |set: &'a NodeSet| {
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
    names: &[u32],
    facets: &[[u32; 3]],
    cavities: &[(&str, Vec<[u32; 3]>)],
) -> Vec<u8> {
    let coordinates = bits(visible.iter().flat_map(|node| nodes[*node as usize]));
    let facets = corners(nodes.len(), visible, facets);
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
    encode(&head, &[&coordinates, &facets, names, &walls])
}
