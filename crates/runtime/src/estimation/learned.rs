//! Markers of a model learned from measurements: their coordinates are outputs of the model, which has no mesh.

use super::SensorModel;
use crate::config::{ActuatorSpec, CameraSpec, MarkerSpec};
use rom::evaluation::Evaluation;
use rom::model::Model;
use rom::session::Session;
use wire::layout::Marker;

/// What predicts the markers of an actuator.
#[derive(Debug)]
pub enum MarkerModel {
    /// Modes of finite elements at the markers.
    Mesh(Box<SensorModel>),
    /// Outputs of a model learned from measurements.
    Learned(LearnedMarkers),
}

/// Which outputs of the model the scene's markers measure.
#[derive(Debug, Clone)]
pub struct LearnedMarkers {
    outputs: Vec<[Option<usize>; 3]>,
    camera: CameraSpec,
    /// Measured minus freely predicted values by output.
    errors: Vec<f64>,
}

impl LearnedMarkers {
    /// `None` for another model.
    ///
    /// # Errors
    /// Markers at nodes of which the model has no coordinate.
    pub(crate) fn new(spec: &ActuatorSpec, model: &Model) -> Result<Option<Self>, Vec<String>> {
        let Some(map) = &model.header.learned else { return Ok(None) };
        let outputs: Vec<[Option<usize>; 3]> =
            spec.markers.iter().map(|marker| outputs_of(model, marker)).collect();
        let unknown = spec.markers.iter().zip(&outputs).filter(|(_, of)| of.iter().all(Option::is_none));
        let known = model
            .header
            .node_sets
            .iter()
            .flat_map(|set| set.nodes.first().map(|node| format!("`node = {node}` for {}", set.name)));
        let known = known.collect::<Vec<_>>().join(", ");
        let problem = |(marker, _): (&MarkerSpec, _)| {
            format!(
                "marker `{}`: expected the node of a learned marker ({known}), found another place",
                marker.name
            )
        };
        let problems: Vec<String> = unknown.map(problem).collect();
        if !problems.is_empty() {
            return Err(problems);
        }
        Ok(Some(Self { outputs, camera: spec.camera, errors: vec![f64::NAN; map.outputs()] }))
    }

    /// Predicted places of the markers in the camera's frame; NaN for a coordinate that was not learned.
    pub(crate) fn places(&self, answered: &Evaluation) -> impl Iterator<Item = [f64; 3]> {
        self.outputs.iter().map(|outputs| {
            let value = |at: &Option<usize>| at.and_then(|at| answered.coefficients.get(at)).copied();
            self.camera.in_camera_mm(outputs.each_ref().map(|at| value(at).unwrap_or(f64::NAN)))
        })
    }

    /// Lets a session follow measured markers, as far as they are new.
    pub(crate) fn follow(
        &mut self,
        t_ns: u64,
        measured: impl Iterator<Item = (Marker, bool)>,
        answered: &Evaluation,
        session: &mut Session,
    ) {
        self.errors.fill(f64::NAN);
        for (outputs, (marker, _)) in self.outputs.iter().zip(measured).filter(|(_, (_, is_new))| *is_new) {
            for (measured_mm, at) in self.camera.in_actuator_mm(marker).into_iter().zip(outputs) {
                let value = at.and_then(|at| Some((at, answered.coefficients.get(at)?)));
                if let Some((at, value)) = value
                    && let Some(error) = self.errors.get_mut(at)
                {
                    *error = measured_mm - (value - session.offset(at));
                }
            }
        }
        session.follow(t_ns, &self.errors);
    }
}

/// Outputs that are a marker's coordinates.
fn outputs_of(model: &Model, marker: &MarkerSpec) -> [Option<usize>; 3] {
    [0, 1, 2].map(|axis| model.learned_output(model.header.coordinate_field(axis)?, marker.node? as usize))
}
