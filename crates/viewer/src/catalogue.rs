//! The models the viewer knows: their visible surfaces, and predictions for "what if".

use crate::frame::FrameHead;
use anyhow::{Context, Error, Result};
use page::frame::encode;
use page::{Card, Figure};
use picture::visible::visible_facets;
use rom::inputs::{InputSpec, Inputs};
use rom::model::Model;
use rom::snapshots::Footprint;
use runtime::config::{ActuatorSpec, BlockSpec, PlaceSpec, Scene};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

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
    mesh: Option<Vec<u8>>,
    figure: Mutex<Figure>,
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
        self.models.iter().filter_map(|known| known.mesh.as_deref())
    }

    /// Files of the measured models.
    pub fn measured(&self) -> impl Iterator<Item = &Path> {
        self.models.iter().filter_map(|known| known.measured.as_deref())
    }

    /// The model with this hash, if it is known.
    pub fn find(&self, hash: [u8; 16]) -> Option<usize> {
        self.models.iter().position(|known| known.hash == hash)
    }

    /// The visible nodes of a model, ascending.
    pub fn visible(&self, model: usize) -> &[u32] {
        self.models.get(model).map_or(&[], |known| &known.visible)
    }

    pub fn inputs(&self, model: usize) -> &[InputSpec] {
        self.models.get(model).map_or(&[], |known| &known.inputs)
    }

    /// For each visible node of a model its place in a sample of a node set; none when some are not in it.
    pub fn places(&self, model: usize, node_set: &str) -> Option<Vec<u32>> {
        let known = self.models.get(model).filter(|known| known.mesh.is_some())?;
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
        known.figure().predict(values)
    }

    /// The largest von Mises stress (MPa) of a recorded state; none when the model cannot say it.
    pub fn largest_stress_mpa(&self, model: usize, inputs: Inputs) -> Option<f64> {
        let known = self.models.get(model)?;
        let (shape, _) = known.figure().shape(inputs).ok()?;
        Some(shape.max_von_mises_mpa).filter(|stress| stress.is_finite())
    }

    /// Makes a frame of a recorded state: its numbers are in `head`, its shape is computed. `O(visible nodes x modes)`.
    ///
    /// # Errors
    /// When the model cannot reconstruct the state's regime.
    pub fn replay(&self, model: usize, inputs: Inputs, mut head: FrameHead) -> Result<Vec<u8>> {
        let known = self.models.get(model).context("no such model")?;
        let (shape, values) = known.figure().shape(inputs).map_err(Error::msg)?;
        head.shape = shape;
        Ok(encode(&head, &[&values]))
    }
}

impl Known {
    fn new(id: usize, NamedModel { path, model, hash }: &NamedModel) -> Result<Self> {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let undeformed = model.undeformed_nodes_mm();
        let facets = undeformed.map_or_else(Vec::new, |nodes| visible_facets(&nodes, model.facets()));
        let figure = Figure::new(model, id, name, &facets)
            .with_context(|| format!("cannot predict with the model: {}", path.display()))?;
        Ok(Self {
            card: figure.card().clone(),
            inputs: figure.inputs().to_vec(),
            visible: figure.visible().to_vec(),
            mesh: figure.mesh().map(<[u8]>::to_vec),
            measured: model.is_measured().then(|| path.clone()),
            hash: std::array::from_fn(|k| hash[k]),
            node_sets: model.header.node_sets.clone(),
            node_count: model.header.node_count,
            figure: Mutex::new(figure),
        })
    }

    fn figure(&self) -> MutexGuard<'_, Figure> {
        self.figure.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
#[path = "../tests/unit/catalogue.rs"]
mod tests;
