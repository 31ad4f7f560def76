//! A model learned from measurements beside its sensors: where it predicts the markers, and offsets of its outputs that follow what is
//! measured. Such a model has no mesh; a marker's coordinates are outputs, as are angles and forces.

use super::{NamedValue, NewValues, SensorModel};
use crate::config::{ActuatorSpec, CameraSpec, MarkerSpec};
use crate::named_outputs::NamedOutputs;
use rom::evaluation::Evaluation;
use rom::model::Model;
use rom::session::Session;
use wire::SensorSample;

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
}

impl LearnedMarkers {
    /// `None` for another model.
    ///
    /// # Errors
    /// Markers at nodes of which the model has no coordinate.
    pub(crate) fn new(spec: &ActuatorSpec, model: &Model) -> Result<Option<Self>, Vec<String>> {
        if model.header.learned.is_none() {
            return Ok(None);
        }
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
        Ok(Some(Self { outputs, camera: spec.camera }))
    }

    /// Predicted places of the markers in the camera's frame; NaN for a coordinate that was not learned.
    pub(crate) fn places(&self, answered: &Evaluation) -> impl Iterator<Item = [f64; 3]> {
        self.outputs.iter().map(|outputs| {
            let value = |at: &Option<usize>| at.and_then(|at| answered.coefficients.get(at)).copied();
            self.camera.in_camera_mm(outputs.each_ref().map(|at| value(at).unwrap_or(f64::NAN)))
        })
    }
}

/// The measured outputs of a model learned from measurements, whose offsets a session follows (`follow` of a scene): coordinates of the
/// markers, and the outputs that `[actuator.observables]` names.
#[derive(Debug, Clone)]
pub struct FollowedOutputs {
    markers: LearnedMarkers,
    named: Vec<(NamedValue, usize)>,
    /// Measured minus freely predicted values by output.
    errors: Vec<f64>,
}

impl FollowedOutputs {
    /// Those of the scene: `measured` are the positions of its observables among the named outputs.
    ///
    /// # Errors
    /// A model that cannot follow, or a scene that measures none of its outputs.
    pub(crate) fn new(
        spec: &ActuatorSpec,
        model: &Model,
        outputs: &NamedOutputs,
        measured: &[usize],
    ) -> Result<Self, Vec<String>> {
        let (Some(map), Some(markers)) = (&model.header.learned, LearnedMarkers::new(spec, model)?) else {
            return Err(vec![
                "follow: expected a model learned from measurements (`softtwin learn`), found one of finite elements"
                    .into(),
            ]);
        };
        let named = spec.observables.keys().zip(measured);
        let named: Vec<_> = named
            .filter_map(|(name, at)| Some((NamedValue::new(name), outputs.learned_output(*at)?)))
            .collect();
        if spec.markers.is_empty() && named.is_empty() {
            let known: Vec<&str> = outputs.names().collect();
            return Err(vec![format!(
                "follow: expected a measured output, [[actuator.marker]] or one of the model's other outputs ({}) under \
                 [actuator.observables]; found none",
                known.join(", ")
            )]);
        }
        Ok(Self { markers, named, errors: vec![f64::NAN; map.outputs()] })
    }

    /// Lets a session follow what a reading measures, as far as it is new; `answered` is the session's answer to the reading.
    pub(crate) fn follow(
        &mut self,
        sample: &SensorSample,
        new: &NewValues,
        answered: &Evaluation,
        session: &mut Session,
    ) {
        let Self { markers: LearnedMarkers { outputs, camera }, named, errors } = self;
        errors.fill(f64::NAN);
        let mut set = |output: usize, measured: f64| {
            if let Some(error) = errors.get_mut(output) {
                *error = session.free_error(output, measured, answered);
            }
        };
        if sample.marker_values > 0 {
            let measured = outputs.iter().zip(&sample.markers_mm).zip(new.markers);
            for ((outputs, marker), _) in measured.filter(|(_, is_new)| *is_new) {
                for (measured_mm, output) in camera.in_actuator_mm(*marker).into_iter().zip(outputs) {
                    output.iter().for_each(|output| set(*output, measured_mm));
                }
            }
        }
        for (value, output) in named {
            value.new_in(sample, new).iter().for_each(|measured| set(*output, *measured));
        }
        session.follow(sample.t_sensor_ns, errors);
    }
}

/// Outputs that are a marker's coordinates.
fn outputs_of(model: &Model, marker: &MarkerSpec) -> [Option<usize>; 3] {
    [0, 1, 2].map(|axis| model.learned_output(model.header.coordinate_field(axis)?, marker.node? as usize))
}
