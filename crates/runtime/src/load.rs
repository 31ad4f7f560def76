//! From scene to memory: which regimes, fields and nodes are needed, and nothing else.

use crate::config::{
    self, ActuatorSpec, ConfigError, FixedNodes, Gap, NodesSpec, OutputSpec, PRESSURE_BIAS, Scene,
};
use crate::estimation::{
    Estimator, FollowedOutputs, LearnedMarkers, MarkerModel, SensorModel, measured_observables,
};
use crate::named_outputs::NamedOutputs;
use rom::branch::{self, VOLUME};
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, InputSpec, MAX_INPUTS, Needs, PARAMETERS, PRESSURE};
use rom::model::{
    BlockData, BlockEntry, BlockKind, Model, ModelFileError, ModelHeader, ModelReader, Nodes, RegimeModel,
    Selection,
};
use rom::reconstructor::{Basis, Reconstructor};
use rom::session::{Gaps, Session};
use rom::snapshots::{FieldKind, RegimeKind};
use std::io::{Read, Seek};
use std::path::Path;
use wire::State;
use wire::layout::{FIELD_SLOTS, GROUPS_MAX, INPUTS_MAX, OBSERVABLES_MAX, field_id, input_source, set_slot};

/// What the payloads of a model contain beside the numbers of an evaluation: names and places of its inputs and named outputs.
#[derive(Debug, Clone)]
pub struct PayloadContents {
    pub(crate) count: u32,
    pub(crate) names: [u8; 32 * INPUTS_MAX],
    /// Position of each of them in the model's inputs.
    positions: [usize; INPUTS_MAX],
    pub(crate) needs: Needs,
    /// Coefficients of each group, by regime.
    pub(crate) group_sizes: Vec<(RegimeKind, [u8; GROUPS_MAX])>,
    pub(crate) outputs: NamedOutputs,
    pub(crate) observable_names: [u8; 32 * OBSERVABLES_MAX],
}

impl PayloadContents {
    /// Takes a model with its record of observables, or a learned model with its modes, loaded, and its evaluator.
    ///
    /// # Errors
    /// Observables that do not fit the model.
    pub fn new(model: &Model, evaluator: &Evaluator) -> Result<Self, ModelFileError> {
        let (mut names, mut positions, mut count) = ([0; 32 * INPUTS_MAX], [0; INPUTS_MAX], 0);
        for ((to, position), (at, input)) in positions.iter_mut().enumerate().zip(evaluator.taken_inputs()) {
            *position = at;
            set_slot(&mut names, to, &input.key());
            count += 1;
        }
        let needs = evaluator.needs();
        let outputs = NamedOutputs::new(model)?;
        let mut observable_names = [0; 32 * OBSERVABLES_MAX];
        outputs.names().enumerate().for_each(|(index, name)| set_slot(&mut observable_names, index, name));
        let sizes = |regime: &RegimeModel| {
            let sizes: Vec<u8> = regime.groups.iter().map(|group| group.coefficients.len() as u8).collect();
            (regime.kind, first(&sizes))
        };
        let group_sizes = model.header.regimes.iter().map(sizes).collect();
        Ok(Self { count, names, positions, needs, group_sizes, outputs, observable_names })
    }

    /// Positions in the model's inputs, in the order of the payload's.
    fn positions(&self) -> impl Iterator<Item = usize> {
        self.positions.into_iter().take(self.count as usize)
    }

    /// Values by position as the payload has them.
    pub(crate) fn of_inputs(&self, values: &[f64; MAX_INPUTS]) -> [f64; INPUTS_MAX] {
        let mut out = [f64::NAN; INPUTS_MAX];
        let given = self.positions().filter_map(|at| values.get(at));
        out.iter_mut().zip(given).for_each(|(to, value)| *to = *value);
        out
    }

    /// Position in the model's inputs of the one with this packed name.
    pub(crate) fn position(&self, name: &[u8; 32]) -> Option<usize> {
        let mut named = self.names.as_chunks::<32>().0.iter().zip(self.positions());
        named.find(|(known, _)| *known == name).map(|(_, at)| at)
    }

    /// Packed name of the input at this position in the model's inputs; empty without one.
    pub(crate) fn name(&self, input: usize) -> [u8; 32] {
        let mut named = self.names.as_chunks::<32>().0.iter().zip(self.positions());
        named.find(|(_, position)| *position == input).map_or([0; 32], |(name, _)| *name)
    }

    /// Where the value of each input comes from in this scene: numbers of [`input_source`].
    pub(crate) fn sources(&self, spec: &ActuatorSpec, inputs: &[InputSpec]) -> [u8; INPUTS_MAX] {
        let mut sources = [input_source::UNKNOWN; INPUTS_MAX];
        for (source, at) in sources.iter_mut().zip(self.positions()) {
            *source = inputs.get(at).map_or(input_source::UNKNOWN, |input| input_source_of(spec, at, input));
        }
        sources
    }

    /// A state of a model with these inputs and no values.
    pub(crate) fn state(&self) -> State {
        State { input_count: self.count, input_names: self.names, ..State::default() }
    }
}

/// Where the value of an input comes from in this scene: a number of [`input_source`].
pub(crate) fn input_source_of(spec: &ActuatorSpec, position: usize, input: &InputSpec) -> u8 {
    let key = input.key();
    let is_estimated = spec.estimate.contains_key(&key)
        || (position == PRESSURE && spec.estimate.contains_key(PRESSURE_BIAS));
    let from = spec.inputs.get(&key);
    let is_given = (position == GAP && matches!(spec.gap_mm, Gap::Fixed(_)))
        || from.is_some_and(|from| from.given().is_some());
    match (is_estimated, is_given) {
        (true, _) => input_source::ESTIMATED,
        (false, true) => input_source::GIVEN,
        // A volume without an entry follows the measured pressure.
        (false, false) if position < PARAMETERS || from.is_some() || key == VOLUME => input_source::MEASURED,
        (false, false) => input_source::NOMINAL,
    }
}

/// One actuator of a scene with everything it needs in memory.
#[derive(Debug)]
pub struct LoadedActuator {
    /// Its part of the scene.
    pub spec: ActuatorSpec,
    /// First 16 bytes of the model file's hash.
    pub model_hash: [u8; 16],
    /// The model without a past. It gives the coefficients of the fields whose modes were read, all where states carry them.
    pub session: Session,
    /// Content of states beside their evaluation.
    pub contents: PayloadContents,
    /// One for each field topic.
    pub outputs: Vec<LoadedOutput>,
    /// Estimator, if the scene has one.
    pub estimator: Option<Estimator>,
    /// Predictions of the markers, if the scene has some.
    pub markers: Option<MarkerModel>,
    /// Positions of the measured observables among the model's named outputs.
    pub observed: Vec<usize>,
    /// What the session follows, if the scene wants it.
    pub followed: Option<FollowedOutputs>,
    /// Regimes that can occur.
    pub regimes: Vec<RegimeKind>,
    /// Blocks read from the model file.
    pub read: Vec<ReadBlock>,
    /// Bytes of all blocks of the file.
    pub file_block_bytes: u64,
}

/// One field topic, ready to compute.
#[derive(Debug)]
pub struct LoadedOutput {
    /// Its part of the scene.
    pub spec: OutputSpec,
    /// From coefficients to the fields.
    pub reconstructor: Reconstructor,
    /// Names of the fields in their order.
    pub fields: Vec<String>,
    /// Their numbers of [`field_id`]; the rest are 0.
    pub field_ids: [u8; FIELD_SLOTS],
    /// Bytes of the bases of all regimes in memory.
    pub basis_bytes: u64,
    /// Bytes that a reconstruction reads, at most.
    pub most_read_bytes: u64,
}

/// One block that was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadBlock {
    pub kind: BlockKind,
    pub bytes: u64,
}

impl LoadedActuator {
    /// Evaluation with capacity for any state.
    #[must_use]
    pub fn evaluation(&self) -> Evaluation {
        self.session.evaluation()
    }

    /// Names of the regimes that can occur.
    #[must_use]
    pub fn regime_names(&self) -> Vec<&'static str> {
        self.regimes.iter().map(|kind| kind.name()).collect()
    }
}

/// Loads all actuators of a scene.
///
/// # Errors
/// The problems of all actuators at once.
pub fn load_scene(scene: &Scene, path: &Path) -> Result<Vec<LoadedActuator>, ConfigError> {
    let load = |spec: &ActuatorSpec| load(spec, &spec.model);
    config::collect(path, scene.actuators.iter().map(|spec| (spec.name.as_str(), load(spec))))
}

/// Loads one actuator.
///
/// # Errors
/// All problems of its model and its outputs.
pub fn load(spec: &ActuatorSpec, model_path: &Path) -> Result<LoadedActuator, Vec<String>> {
    let problem = |text: String| vec![format!("model: {text} ({})", model_path.display())];
    let mut reader = ModelReader::open_file(model_path).map_err(|error| problem(error.to_string()))?;
    let model_hash = first(&reader.hash());
    let mut header = reader.header().clone();
    header.body = reader.body().map_err(|error| problem(error.to_string()))?;
    header.set_parameters(spec.given_inputs()).map_err(|error| problem(format!("inputs: {error}")))?;
    for (name, _) in spec.measured_inputs() {
        header.parameter(name).map_err(|error| problem(format!("inputs: {error}")))?;
    }
    let has_volume = spec.inputs.contains_key(VOLUME) || spec.estimate.contains_key(VOLUME);
    let follows = !has_volume && branch::volume_input(&header).is_some();
    if follows && (!spec.estimate.is_empty() || header.taken_inputs().count() > 1) {
        return Err(problem(format!(
            "expected `{}` in [actuator.inputs] (the pressure determines it only where it is the model's only input and nothing is \
             estimated), found none",
            VOLUME
        )));
    }
    if !spec.sensors.is_empty() && (header.needs().pressure || follows) && !spec.has_sensor_of("pressure_mpa")
    {
        return Err(vec![
            "sensors: expected a sensor with pressure_mpa, an input of the model; found none".into(),
        ]);
    }
    let regimes = regimes_in_reach(&header, spec);
    header.regimes.retain(|regime| regimes.contains(&regime.kind));
    if header.regimes.is_empty() {
        let (min, max) = spec.gap_mm.range_mm();
        return Err(problem(format!("it has no regime for gaps of {min} .. {max} mm")));
    }
    let selections = selections(spec, &header, &mut reader)?;
    let file_block_bytes = reader.blocks().iter().map(|entry| entry.bytes).sum();
    let entries = blocks_of(spec, &header, (&selections, follows), reader.blocks());
    let read =
        entries.iter().map(|entry| ReadBlock { kind: entry.kind, bytes: entry.bytes }).collect::<Vec<_>>();
    let blocks = reader.read_blocks(&entries).map_err(|error| problem(error.to_string()))?;
    let model = Model { header, blocks };
    let session =
        if follows { Session::new(&model, Gaps::Live) } else { Session::with_volumes(&model, Gaps::Live) };
    let mut session = session.map_err(|error| problem(error.to_string()))?;
    let contents = PayloadContents::new(&model, session.evaluator());
    let contents = contents.map_err(|error| problem(error.to_string()))?;
    if !spec.state.coefficients {
        let field = |block: &ReadBlock| match block.kind {
            BlockKind::Modes { field, .. } => Some(field as usize),
            _ => None,
        };
        let fields = model.header.fields.iter().enumerate();
        let coordinates = fields.filter(|(_, field)| matches!(field.spec.kind, FieldKind::Coordinate(_)));
        let observed = coordinates.map(|(at, _)| at).filter(|_| contents.outputs.count() > 0);
        session.restrict(&read.iter().filter_map(field).chain(observed).collect::<Vec<_>>());
    }
    let observed = measured_observables(spec, contents.outputs.names())?;
    let outputs = outputs(spec, &model, selections)?;
    let estimator = Estimator::new(spec, &model)?;
    let markers = match LearnedMarkers::new(spec, &model)? {
        _ if spec.markers.is_empty() => None,
        Some(markers) => Some(MarkerModel::Learned(markers)),
        None => Some(MarkerModel::Mesh(Box::new(SensorModel::new(spec, &model)?))),
    };
    let followed =
        spec.follow.then(|| FollowedOutputs::new(spec, &model, &contents.outputs, &observed)).transpose()?;
    if followed.is_some() {
        session.start_following();
    }
    Ok(LoadedActuator {
        spec: spec.clone(),
        model_hash,
        session,
        contents,
        outputs,
        estimator,
        markers,
        observed,
        followed,
        regimes,
        read,
        file_block_bytes,
    })
}

/// Blocks that an actuator's outputs, markers and past take.
fn blocks_of(
    spec: &ActuatorSpec,
    header: &ModelHeader,
    (selections, follows): (&[Selection], bool),
    all: &[BlockEntry],
) -> Vec<BlockEntry> {
    let mut needed = needed_blocks(header, selections);
    needed.push(BlockKind::Memory);
    if follows {
        let pressure = Selection { fields: Some(vec!["pressure".into()]), nodes: Nodes::All };
        needed.extend(needed_blocks(header, &[pressure]));
    }
    if header.learned.is_some() {
        // A mode tells which output it is.
        let whole = Selection { fields: None, nodes: Nodes::All };
        needed.extend(needed_blocks(header, &[whole]));
    } else if !spec.markers.is_empty() {
        let coordinates =
            header.fields.iter().filter(|field| matches!(field.spec.kind, FieldKind::Coordinate(_)));
        let fields = coordinates.map(|field| field.spec.name.clone()).collect();
        let whole = Selection { fields: Some(fields), nodes: Nodes::All };
        needed.extend(needed_blocks(header, &[whole]));
        needed.extend((0..3).map(BlockKind::Undeformed));
    }
    let moves =
        |kind| matches!(kind, BlockKind::UndeformedBy { .. }) && needed.contains(&BlockKind::Undeformed(0));
    let is_needed = |entry: &&BlockEntry| {
        needed.contains(&entry.kind)
            || moves(entry.kind)
            || matches!(entry.kind, BlockKind::Observables | BlockKind::Inertia)
    };
    all.iter().filter(is_needed).cloned().collect()
}

/// The first entries of a list in an array of fixed size; the rest are 0.
pub(crate) fn first<const N: usize>(from: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(from) {
        *to = *from;
    }
    out
}

/// Contact only where the plate can be reached, free only where it can be left.
fn regimes_in_reach(header: &ModelHeader, spec: &ActuatorSpec) -> Vec<RegimeKind> {
    let (min_mm, max_mm) = spec.gap_mm.range_mm();
    let solved = header.clearance.is_some(); // the onset is solved from the free regime: it is always needed
    let possible = |kind: RegimeKind| match (&header.onset, kind) {
        (None, _) => true,
        _ if solved => true,
        (Some(onset), RegimeKind::Contact) => min_mm <= onset.reach_mm(),
        (Some(onset), RegimeKind::Free) => max_mm > onset.sag_mm(),
    };
    header.regimes.iter().map(|regime| regime.kind).filter(|kind| possible(*kind)).collect()
}

/// Selection of each output from the model.
fn selections<R: Read + Seek>(
    spec: &ActuatorSpec,
    header: &ModelHeader,
    reader: &mut ModelReader<R>,
) -> Result<Vec<Selection>, Vec<String>> {
    let mut problems = Vec::new();
    let mut selections = Vec::new();
    for (index, output) in spec.outputs.iter().enumerate() {
        let fields = (!output.fields.is_empty()).then(|| output.fields.clone());
        match nodes(&output.nodes, reader) {
            Ok(nodes) => {
                let checked = [
                    header.resolve_fields(fields.as_deref()).err().map(|error| error.to_string()),
                    header.resolve_nodes(&nodes).err().map(|error| error.to_string()),
                ];
                problems.extend(checked.into_iter().flatten().map(|text| format!("output[{index}]: {text}")));
                selections.push(Selection { fields, nodes });
            }
            Err(text) => problems.push(format!("output[{index}].nodes: {text}")),
        }
    }
    if problems.is_empty() { Ok(selections) } else { Err(problems) }
}

fn nodes<R: Read + Seek>(spec: &NodesSpec, reader: &mut ModelReader<R>) -> Result<Nodes, String> {
    match spec {
        NodesSpec::Named(name) if name == "all" => Ok(Nodes::All),
        NodesSpec::Named(name) => Ok(Nodes::Set(name.clone())),
        NodesSpec::Fixed(FixedNodes::List(list)) => Ok(Nodes::List(list.clone())),
        NodesSpec::Fixed(FixedNodes::Box { min, max }) => nodes_in_box(reader, min, max),
    }
}

fn nodes_in_box<R: Read + Seek>(
    reader: &mut ModelReader<R>,
    min: &[f64; 3],
    max: &[f64; 3],
) -> Result<Nodes, String> {
    let mut inside = vec![true; reader.header().node_count];
    for axis in 0..3u8 {
        let entry = reader.blocks().iter().find(|entry| entry.kind == BlockKind::Undeformed(axis)).cloned();
        let entry =
            entry.ok_or("a box needs the undeformed mesh, which this model does not have; use a list")?;
        let blocks = reader.read_blocks(&[entry]).map_err(|error| error.to_string())?;
        let Some((_, BlockData::F32(values))) = blocks.into_iter().next() else {
            return Err("the undeformed mesh is not stored as coordinates".into());
        };
        let bounds = min.get(axis as usize).zip(max.get(axis as usize));
        for (inside, value) in inside.iter_mut().zip(values) {
            *inside &= bounds.is_some_and(|(min, max)| (*min..=*max).contains(&f64::from(value)));
        }
    }
    let list: Vec<u32> = (0..).zip(&inside).filter(|(_, inside)| **inside).map(|(node, _)| node).collect();
    if list.is_empty() {
        return Err(format!("no node lies in the box {min:?} .. {max:?} (undeformed coordinates, mm)"));
    }
    Ok(Nodes::List(list))
}

/// The blocks that the selections need, derived fields with what they are derived from.
fn needed_blocks(header: &ModelHeader, selections: &[Selection]) -> Vec<BlockKind> {
    let mut fields: Vec<usize> = Vec::new();
    for selection in selections {
        // Unknown fields were reported before.
        fields.extend(header.resolve_fields(selection.fields.as_deref()).unwrap_or_default());
    }
    let axes: Vec<usize> =
        fields.iter().filter_map(|field| header.fields.get(*field)?.magnitude_of).flatten().collect();
    let mut blocks = Vec::new();
    if !axes.is_empty() {
        blocks.extend((0..3).map(BlockKind::Undeformed));
    }
    for field in fields.into_iter().chain(axes).map(|field| field as u32) {
        // A regime may share the basis of another one that is out of reach.
        for regime in RegimeKind::Free.with_other() {
            blocks.push(BlockKind::Mean { regime, field });
            blocks.push(BlockKind::Modes { regime, field });
        }
    }
    blocks
}

fn outputs(
    spec: &ActuatorSpec,
    model: &Model,
    selections: Vec<Selection>,
) -> Result<Vec<LoadedOutput>, Vec<String>> {
    let mut problems = Vec::new();
    let mut outputs = Vec::new();
    for (index, (output, selection)) in spec.outputs.iter().zip(selections).enumerate() {
        match Reconstructor::new(model, &selection) {
            Ok(reconstructor) => outputs.push(loaded_output(output, model, &selection, reconstructor)),
            Err(error) => problems.push(format!("output[{index}]: {error}")),
        }
    }
    if problems.is_empty() { Ok(outputs) } else { Err(problems) }
}

fn loaded_output(
    spec: &OutputSpec,
    model: &Model,
    selection: &Selection,
    reconstructor: Reconstructor,
) -> LoadedOutput {
    let header = &model.header;
    let numbers = header.resolve_fields(selection.fields.as_deref()).unwrap_or_default();
    let specs = || numbers.iter().filter_map(|number| Some((*number, &header.fields.get(*number)?.spec)));
    let most_read_bytes = reconstructor.bases().map(Basis::bytes).max().unwrap_or(0) as u64;
    LoadedOutput {
        spec: spec.clone(),
        fields: specs().map(|(_, spec)| spec.name.clone()).collect(),
        field_ids: first(&specs().map(|(number, spec)| id_of(number, spec.kind)).collect::<Vec<u8>>()),
        basis_bytes: reconstructor.bases().map(Basis::memory_bytes).sum::<usize>() as u64,
        most_read_bytes,
        reconstructor,
    }
}

fn id_of(number: usize, kind: FieldKind) -> u8 {
    match kind {
        FieldKind::Coordinate(0) => field_id::X,
        FieldKind::Coordinate(1) => field_id::Y,
        FieldKind::Coordinate(_) => field_id::Z,
        FieldKind::Magnitude => field_id::DISPLACEMENT,
        FieldKind::Stress => field_id::VON_MISES,
        FieldKind::Other => field_id::OTHER.saturating_add(number as u8),
    }
}
