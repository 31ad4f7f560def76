//! Scenes: what is there, and what is wanted of it. The twin loads and computes exactly that.

use super::error::{ConfigError, read};
use super::estimate::{self, CameraSpec, EstimateSpec, ObservedSpecs, SigmaSpec, Sigmas};
use super::grasp::{BlockSpec, GraspSpec, PlaceSpec, plate_problems};
use super::input::{self, InputSpecs, Measured, WithinSpec};
use crate::problems::Problems;
use crate::source::{Devices, InputNames, PaceSpec, Sensors, Source, SourceSpec, open_sensors, value_mut};
use crate::valve::{self, ValveSpec};
use control::held::{ControlledActuator, MarkerSpec, Sigma, ValveLimits};
use rom::snapshots::Footprint;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use wire::SensorSample;
use wire::layout::{MARKERS_MAX, Marker};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    pub name: String,
    /// The actuators of the scene.
    #[serde(rename = "actuator")]
    pub actuators: Vec<ActuatorSpec>,
    /// Object held by the actuators.
    pub grasp: Option<GraspSpec>,
    /// Rigid blocks, for pictures.
    #[serde(default, rename = "block")]
    pub blocks: Vec<BlockSpec>,
    /// Folder of the file: relative paths in it begin there, and commands run there.
    #[serde(skip)]
    pub folder: PathBuf,
}

/// One actuator: model, gap, source, and what is wanted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSpec {
    /// Second chunk of its topics, `softtwin/<name>/...`.
    pub name: String,
    /// Model file; a relative path begins at the scene file's folder.
    pub model: PathBuf,
    /// Which gaps can occur.
    #[serde(default)]
    pub gap_mm: Gap,
    /// The model's inputs other than pressure and gap by name: given (`"elastomer.law.mu_mpa" = 0.72`) or measured
    /// (`load_n = "measured"`); missing ones have the model's nominal value.
    #[serde(default)]
    pub inputs: InputSpecs,
    /// Largest number of waiting readings that are answered one by one, oldest first; older ones are superseded. 1: only the newest
    /// is answered, for controllers. More: every reading gets its field even after a delay of the twin.
    #[serde(default = "one")]
    pub backlog: usize,
    /// The actuator whose sensor topic counts here too: one pressure source for several fingers. Default: its own.
    pub sensor: Option<String>,
    /// Position in the scene, for pictures.
    #[serde(default)]
    pub place: PlaceSpec,
    /// Extent of the plate below it in its own frame, for pictures; none: one that suits the model's nodes.
    pub plate: Option<Footprint>,
    /// Which questions are answered.
    #[serde(default)]
    pub queries: Queries,
    /// Source of the bridge: one device, a recording or a formula.
    pub source: Option<SourceSpec>,
    /// Instead of `source`: several sensors by name, each with its own values.
    #[serde(default)]
    pub sensors: Sensors,
    /// Pace of the readings of `sensors`.
    pub pace: Option<PaceSpec>,
    /// The pressure source that the bridge drives: that of `pressure_mpa`.
    pub valve: Option<ValveSpec>,
    /// Pressure sources of further cavities: `[actuator.valves.NAME]` is that of the input `pressure_mpa.NAME`.
    #[serde(default)]
    pub valves: BTreeMap<String, ValveSpec>,
    /// Dynamics of the actuator and times of the controller.
    #[serde(default)]
    pub control: control::settings::Settings,
    /// Extras of the state topic.
    #[serde(default)]
    pub state: StateSpec,
    /// Estimated quantities; default: none.
    #[serde(default)]
    pub estimate: EstimateSpec,
    /// Uncertainty of the sensors.
    #[serde(default)]
    pub sigma: SigmaSpec,
    /// Markers that a camera follows.
    #[serde(default, rename = "marker")]
    pub markers: Vec<MarkerSpec>,
    /// The measured outputs of a model learned from measurements, `marker` and `observables`, follow what is measured: each has an offset
    /// that is estimated.
    #[serde(default)]
    pub follow: bool,
    /// Observables of the model that are measured, such as a bending angle by a camera, or scalar outputs of a model learned from
    /// measurements: values of the readings by their names. A force is that of the load cell where readings have none of its name.
    #[serde(default)]
    pub observables: ObservedSpecs,
    #[serde(default)]
    pub camera: CameraSpec,
    /// Field topics, one for each entry; none: state only, and no basis is loaded.
    #[serde(default, rename = "output")]
    pub outputs: Vec<OutputSpec>,
}

/// Which gaps can occur. What cannot occur is neither loaded nor computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Gap {
    /// `gap_mm = "measured"`: every reading has it, any value can occur.
    Measured(Measured),
    /// `gap_mm = 40.0`: fixed, the readings' gap is ignored.
    Fixed(f64),
    /// `gap_mm = { min = 30.0, max = 60.0 }`: measured, within a range.
    Range {
        /// Smallest gap that can occur, mm.
        min: f64,
        /// Largest gap that can occur, mm.
        max: f64,
    },
}

impl Default for Gap {
    fn default() -> Self {
        Self::Measured(Measured::Measured)
    }
}

impl Gap {
    /// Smallest and largest gap that can occur, mm.
    pub fn range_mm(&self) -> (f64, f64) {
        match *self {
            Self::Measured(_) => (0.0, f64::INFINITY),
            Self::Fixed(gap) => (gap, gap),
            Self::Range { min, max } => (min, max),
        }
    }
}

/// Which questions a twin answers for an actuator, see [`crate::query`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Queries {
    /// None.
    Off,
    /// State and force; a second evaluator in memory, a few hundred kilobytes.
    #[default]
    State,
    /// The fields of the outputs too; a second basis in memory.
    Fields,
}

/// Extras of the state topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StateSpec {
    /// Publish dF/dP and dF/dgap.
    pub gradients: bool,
    /// Publish half-widths of force, displacement and stress.
    pub half_widths: bool,
    /// Publish the modal coefficients: they are then interpolated before the state is sent, and all of them.
    pub coefficients: bool,
}

impl Default for StateSpec {
    fn default() -> Self {
        Self { gradients: true, half_widths: true, coefficients: false }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputSpec {
    /// Last chunk of the topic, `softtwin/<actuator>/field/<name>`; `"all"` or absent with all nodes: `.../field`.
    pub name: Option<String>,
    #[serde(default)]
    pub nodes: NodesSpec,
    /// Which fields, in this order; empty: all of the model's, in its order.
    #[serde(default)]
    pub fields: Vec<String>,
    /// Largest rate, samples per second; 0: one for every reading.
    #[serde(default)]
    pub rate_hz: f64,
}

/// Which nodes: a name from the model, a box, or a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum NodesSpec {
    /// `"all"`, or one of the model's node sets (`surface`, `tip`, `contact-face`, ...).
    Named(String),
    /// A box or a list.
    Fixed(FixedNodes),
}

/// Nodes that the scene itself names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum FixedNodes {
    /// `{ box = { min = [x, y, z], max = [x, y, z] } }`: undeformed coordinates, mm.
    Box {
        /// Lower corner, mm.
        min: [f64; 3],
        /// Upper corner, mm.
        max: [f64; 3],
    },
    /// `{ list = [0, 17, 4] }`: node numbers, from 0.
    List(Vec<u32>),
}

impl Default for NodesSpec {
    fn default() -> Self {
        Self::Named("all".into())
    }
}

impl OutputSpec {
    /// Last chunk of the topic; `None`: the plain `field` topic.
    pub fn topic_name(&self) -> Option<&str> {
        let name = match (&self.name, &self.nodes) {
            (Some(name), _) => Some(name.as_str()),
            (None, NodesSpec::Named(set)) => Some(set.as_str()),
            (None, NodesSpec::Fixed(_)) => None,
        };
        name.filter(|name| *name != "all")
    }
}

impl Scene {
    /// Reads and checks a scene file. Models and traces are opened later, where they are needed.
    ///
    /// # Errors
    /// All problems at once.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let mut scene: Self = read(path)?;
        let resolved = scene.resolve_paths(path);
        resolved.map_err(|error| ConfigError { path: path.into(), problems: vec![error.to_string()] })?;
        ConfigError::unless(path, scene.problems())?;
        Ok(scene)
    }

    /// All errors in the scene itself.
    pub fn problems(&self) -> Vec<String> {
        let mut list = Vec::new();
        let mut problems = Problems::new(&mut list, "");
        problems.expect(!self.actuators.is_empty(), "actuator", "at least one [[actuator]]", "none");
        let (mut names, devices) = (BTreeSet::new(), Devices::default());
        for (index, actuator) in self.actuators.iter().enumerate() {
            let mut problems = problems.part(format_args!("actuator[{index}] `{}`", actuator.name));
            if !names.insert(&actuator.name) {
                problems.part("name").add("another actuator has this name already");
            }
            actuator.problems(&mut problems);
            actuator.sensor_problems(&self.folder, &devices, &mut problems);
            self.listener_problems(actuator, &mut problems);
            for (topic, valve) in actuator.all_valves().filter_map(Result::ok) {
                problems.extend(valve::open(&topic, valve, &devices).err().into_iter().flatten());
            }
        }
        if let Some(grasp) = &self.grasp {
            let names: Vec<&str> = self.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
            grasp.problems(&self.name, &names, &mut problems);
        }
        for (index, block) in self.blocks.iter().enumerate() {
            block.problems(&format!("block[{index}]"), &mut problems);
        }
        list
    }

    /// An actuator that listens to another's sensor measures what that one does.
    fn listener_problems(&self, actuator: &ActuatorSpec, problems: &mut Problems) {
        let other = self.actuators.iter().find(|other| other.name == actuator.sensor());
        let Some(other) = other.filter(|other| other.name != actuator.name) else { return };
        let known = other.input_names();
        for name in actuator.input_names().iter().filter(|name| known.iter().all(|known| known != *name)) {
            let other = &other.name;
            problems.add(format_args!(
                "expected {name} measured by `{other}` too, whose readings count here, found it is not"
            ));
        }
    }

    /// The actuators that are fingers of `grasp`, in the order named.
    pub fn fingers(&self, grasp: &GraspSpec) -> Vec<&ActuatorSpec> {
        if grasp.fingers.is_empty() {
            return self.actuators.iter().collect();
        }
        let named = |name: &String| self.actuators.iter().find(|actuator| actuator.name == *name);
        grasp.fingers.iter().filter_map(named).collect()
    }
}

fn one() -> usize {
    1
}

impl ActuatorSpec {
    /// All valves with their topics.
    ///
    /// # Errors
    /// Names of actuator or cavity that a topic cannot have.
    pub fn all_valves(&self) -> impl Iterator<Item = Result<(wire::Topic, &ValveSpec), wire::WireError>> {
        let further = self.valves.iter().map(|(cavity, valve)| (Some(cavity.as_str()), valve));
        let all = self.valve.iter().map(|valve| (None, valve)).chain(further);
        all.map(|(cavity, valve)| Ok((wire::Topic::valve(&self.name)?.of_cavity(cavity)?, valve)))
    }

    /// The actuator whose sensor topic counts.
    pub fn sensor(&self) -> &str {
        self.sensor.as_deref().unwrap_or(&self.name)
    }

    /// Source of the bridge, not started; `None` if another program publishes the readings. Device paths are shared through
    /// `devices`; paths of commands and traces are relative to `folder`.
    ///
    /// # Errors
    /// All errors of the source or the sensors.
    pub fn open_source(
        &self,
        folder: &Path,
        devices: &Devices,
    ) -> Option<Result<Box<dyn Source>, Vec<String>>> {
        match &self.source {
            Some(source) => Some(source.open(folder, &self.input_names())),
            None if self.sensors.is_empty() => None,
            None => {
                Some(open_sensors(&self.sensors, self.pace.as_ref(), folder, devices, &self.input_names()))
            }
        }
    }

    /// The values of inputs that the scene gives, by name.
    pub fn given_inputs(&self) -> impl Iterator<Item = (&str, f64)> {
        self.inputs.iter().filter_map(|(name, from)| Some((name.as_str(), from.given()?)))
    }

    /// Measured inputs other than pressure and gap, by name.
    pub fn measured_inputs(&self) -> impl Iterator<Item = (&str, WithinSpec)> {
        self.inputs.iter().filter_map(|(name, from)| Some((name.as_str(), from.measured()?)))
    }

    /// The names of these inputs, then of the measured observables, in the order in which readings carry them.
    pub fn input_names(&self) -> InputNames {
        let inputs = InputNames::new(self.measured_inputs().map(|(name, _)| name));
        inputs.with_observables(self.observables.keys().map(String::as_str))
    }

    /// The part of it that concerns its controller.
    pub fn controlled(&self) -> ControlledActuator {
        let valve = |valve: &ValveSpec| {
            let ValveSpec { range_mpa, rate_mpa_per_s, force_max_n, .. } = *valve;
            ValveLimits { range_mpa, rate_mpa_per_s, force_max_n }
        };
        ControlledActuator {
            name: self.name.clone(),
            control: self.control.clone(),
            valve: self.valve.as_ref().map(valve),
            valves: self.valves.iter().map(|(name, spec)| (name.clone(), valve(spec))).collect(),
            sigma: Sigma { force_n: self.force_sigma_n() },
            inputs: self.given_inputs().map(|(name, value)| (name.to_owned(), value.into())).collect(),
            markers: self.markers.clone(),
        }
    }

    /// Whether one of its sensors has a value of this name.
    pub(crate) fn has_sensor_of(&self, name: &str) -> bool {
        self.sensors.values().flat_map(|sensor| sensor.values()).any(|(value, _)| value == name)
    }

    /// Standard deviation of the noise of a measured input or observable: its sensor's own where it has one, otherwise the scene's.
    pub(crate) fn named_sigma(&self, name: &str) -> Option<f64> {
        let mut of_sensors = self.sensors.values().flat_map(|sensor| sensor.values());
        let own = of_sensors.find(|(value, _)| *value == name).and_then(|(_, sigma)| sigma);
        let of_input = || self.inputs.get(name)?.measured()?.sigma;
        own.or_else(of_input).or_else(|| Some(self.observables.get(name)?.sigma))
    }

    /// Where the readings come from, in words; one text for each device.
    pub fn describe_sources(&self) -> Vec<String> {
        let sensors = self.sensors.iter().map(|(name, sensor)| format!("{name}: {}", sensor.describe()));
        self.source.iter().map(|source| format!("from {}", source.describe())).chain(sensors).collect()
    }

    /// Standard deviation of the load cell's noise, N.
    pub fn force_sigma_n(&self) -> f64 {
        self.sigmas().force_n
    }

    /// Standard deviations of the noise of the markers' coordinates, mm.
    pub(crate) fn marker_sigmas_mm(&self) -> [Marker; MARKERS_MAX] {
        self.sigmas().markers_mm
    }

    /// Standard deviations of the sensors' noise: the sensor's own if it has one, otherwise that of `sigma`.
    pub(crate) fn sigmas(&self) -> Sigmas {
        let SigmaSpec { pressure_mpa, gap_mm, force_n, marker_mm, .. } = self.sigma;
        let mut sigmas =
            SensorSample { pressure_mpa, gap_mm, measured_force_n: force_n, ..SensorSample::default() };
        sigmas.markers_mm = [Marker { x: marker_mm, y: marker_mm, z: marker_mm }; MARKERS_MAX];
        let names = self.input_names();
        for (name, sigma) in self.sensors.values().flat_map(|sensor| sensor.values()) {
            let value = names.slot(name).and_then(|slot| value_mut(&mut sigmas, slot));
            if let (Some(value), Some(sigma)) = (value, sigma) {
                *value = sigma;
            }
        }
        let SensorSample { pressure_mpa, gap_mm, measured_force_n: force_n, markers_mm, .. } = sigmas;
        Sigmas { pressure_mpa, gap_mm, force_n, markers_mm }
    }

    /// Errors in the sensors and in their use of devices.
    fn sensor_problems(&self, folder: &Path, devices: &Devices, problems: &mut Problems) {
        if self.sensors.is_empty() {
            problems.expect(self.pace.is_none(), "pace", "[actuator.sensors.NAME] with it", "none");
            return;
        }
        if self.source.is_some() {
            problems.add("expected either source or sensors, found both");
        }
        if self.sensor.as_ref().is_some_and(|sensor| *sensor != self.name) {
            problems.add("has its own sensors and listens to another's; leave one out");
        }
        let names = self.input_names();
        let found = open_sensors(&self.sensors, self.pace.as_ref(), folder, devices, &names).err();
        problems.extend(found.into_iter().flatten());
    }

    fn problems(&self, problems: &mut Problems) {
        if let Err(error) = wire::Topic::state(&self.name) {
            problems.part("name").add(error);
        }
        problems.expect(!self.model.as_os_str().is_empty(), "model", "a model file", "nothing");
        if let Some(sensor) = &self.sensor {
            if let Err(error) = wire::Topic::sensor(sensor) {
                problems.part("sensor").add(error);
            }
            if self.source.is_some() && *sensor != self.name {
                problems.add(format_args!(
                    "has its own source and listens to the sensor of `{sensor}`; leave one out"
                ));
            }
        }
        self.place.problems(problems);
        if let Some(plate) = &self.plate {
            plate_problems(plate, problems);
        }
        if let Some(valve) = &self.valve {
            valve.problems(&mut problems.part("valve"));
        }
        for (cavity, valve) in &self.valves {
            let mut problems = problems.part(ValveSpec::key(Some(cavity)));
            valve.problems(&mut problems);
            if let Err(error) = wire::Topic::valve("a").and_then(|topic| topic.of_cavity(Some(cavity))) {
                problems.add(error);
            }
            let input = format!("pressure_mpa.{cavity}");
            if self.inputs.get(&input).is_none_or(|from| from.measured().is_none())
                && !self.estimate.contains_key(&input)
            {
                problems.add(format_args!(
                    "expected the pressure that it changes as an input, inputs.\"{input}\" = \"measured\"; found it given or missing"
                ));
            }
        }
        problems.extend(self.control.problems("control"));
        if let Some(cavity) = self.control.cavity.as_ref().filter(|name| !self.valves.contains_key(*name)) {
            let known: Vec<&str> = self.valves.keys().map(String::as_str).collect();
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            let expected = format!("a cavity with a valve, [actuator.valves.NAME] ({known})");
            problems.expect(false, "control.cavity", &expected, format_args!("`{cavity}`"));
        }
        let Self { estimate, sigma, markers, observables, camera, .. } = self;
        estimate::problems(estimate, sigma, markers, observables, camera, problems);
        let (min, max) = self.gap_mm.range_mm();
        let found = format!("{min} .. {max}");
        problems.expect(0.0 <= min && min <= max, "gap_mm", "0 <= min <= max in mm", found);
        let is_estimated = |name: &str| estimate.contains_key(name);
        input::problems(&self.inputs, is_estimated, observables.keys(), problems);
        let waiting = wire::qos::of(wire::TopicKind::Sensor).buffer;
        let fits = (1..=waiting).contains(&self.backlog);
        problems.expect(fits, "backlog", &format!("1 to {waiting}"), self.backlog);
        let mut topics = BTreeSet::new();
        for (index, output) in self.outputs.iter().enumerate() {
            let mut problems = problems.part(format_args!("output[{index}]"));
            output.problems(&self.name, &mut problems);
            if !topics.insert(output.topic_name()) {
                let topic = output.topic_name().unwrap_or("all");
                problems.add(format_args!("the node set `{topic}` has a topic already; give one a `name`"));
            }
        }
    }
}

impl OutputSpec {
    fn problems(&self, actuator: &str, problems: &mut Problems) {
        if self.topic_name().is_none() && matches!(self.nodes, NodesSpec::Fixed(_)) {
            problems.part("name").add("a box or a list of nodes needs a name for its topic");
        }
        if let (Some(name), Ok(_)) = (self.topic_name(), wire::Topic::state(actuator))
            && let Err(error) = wire::Topic::field(actuator, Some(name))
        {
            problems.part("name").add(error);
        }
        // 0: a field for each reading.
        if self.rate_hz != 0.0 {
            problems.rate_hz("rate_hz", self.rate_hz);
        }
        let (count, most) = (self.fields.len(), wire::layout::FIELD_SLOTS);
        problems.expect(count <= most, "fields", &format!("at most {most} fields"), count);
        let mut seen = BTreeSet::new();
        for field in self.fields.iter().filter(|field| !seen.insert(*field)) {
            problems.part("fields").add(format_args!("`{field}` is named twice"));
        }
        match &self.nodes {
            NodesSpec::Fixed(FixedNodes::Box { min, max }) => {
                let fits = min.iter().zip(max).all(|(min, max)| min <= max);
                problems.expect(fits, "nodes.box", "min <= max", format_args!("{min:?} .. {max:?}"));
            }
            NodesSpec::Fixed(FixedNodes::List(nodes)) => {
                problems.expect(!nodes.is_empty(), "nodes.list", "at least one node", "none");
            }
            NodesSpec::Named(_) => {}
        }
    }
}
