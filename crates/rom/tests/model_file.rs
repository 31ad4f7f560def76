//! The model file: round trip, golden bytes, partial loading, and every way of being damaged.

use crate::synthetic;
use proptest::prelude::*;
use rom::inputs::{InputSpec, Inputs};
use rom::kernel::{Modes, Precision};
use rom::memory::{Creep, InputMemory, Line, MemorySpec, Play, Slopes};
use rom::model::{
    BlockData, BlockKind, MAGIC, MAX_MODEL_BYTES, Model, ModelError, ModelFileError, ModelReader, Nodes,
    Selection, VERSION,
};
use rom::model_state::ModelState;
use rom::reconstructor::Reconstructor;
use rom::snapshots::RegimeKind;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::sync::OnceLock;
use train::config::TrainConfig;
use train::train;

fn model() -> &'static (Model, Vec<u8>) {
    static MODEL: OnceLock<(Model, Vec<u8>)> = OnceLock::new();
    MODEL.get_or_init(|| {
        let (model, _) = train(&synthetic::plate(), &TrainConfig::default(), &mut |_| {}).expect("trains");
        let bytes = model.to_bytes().expect("encodes");
        (model, bytes)
    })
}

/// A model from a file, without what loading derives from it.
fn stored(bytes: &[u8]) -> Model {
    let mut model = Model::from_bytes(bytes).expect("loads");
    model.header.body = None;
    model
}

#[test]
fn model_survives_the_round_trip() {
    let (model, bytes) = model();
    assert!(*model == stored(bytes), "another model came back");
}

/// Claims a length without having the bytes.
struct Long(Cursor<&'static [u8]>, u64);

impl Read for Long {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        self.0.read(to)
    }
}

impl Seek for Long {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match to {
            SeekFrom::End(_) => Ok(self.1),
            to => self.0.seek(to),
        }
    }
}

#[test]
fn files_above_the_limit_of_size_are_refused_by_every_reader() {
    let open = |length| ModelReader::open(Long(Cursor::new(&model().1), length));
    let found = MAX_MODEL_BYTES + 1;
    assert!(matches!(open(found), Err(ModelFileError::TooLarge { found: of }) if of == found));
    let own = open(model().1.len() as u64).expect("a model");
    assert_eq!(Some(&own.hash()), model().1.last_chunk::<32>());
}

#[test]
fn model_with_parameters_survives_the_round_trip() {
    let mut model = model().0.clone();
    let range = [f64::NEG_INFINITY, f64::INFINITY];
    model.header.inputs.push(InputSpec {
        name: "temperature".into(),
        unit: "degC".into(),
        range,
        value: Some(20.0),
    });
    let bytes = model.to_bytes().expect("encodes");
    assert!(model == stored(&bytes), "another model came back");
}

#[test]
fn modes_in_f32_and_shifts_of_the_mesh_survive_the_round_trip() {
    let config = TrainConfig { precision: Precision::F32, ..TrainConfig::default() };
    let (mut model, _) = train(&synthetic::plate(), &config, &mut |_| {}).expect("trains");
    let kind = BlockKind::UndeformedBy { input: 2, axis: 0, from_bits: 0.8_f64.to_bits() };
    model.blocks.push((kind, BlockData::F32(vec![0.5; model.header.node_count])));
    let loaded = stored(&model.to_bytes().expect("encodes"));
    assert!(loaded == model, "another model came back");
    assert_eq!(loaded.modes(RegimeKind::Contact, 0).expect("modes").precision(), Precision::F32);
}

#[test]
fn memory_survives_the_round_trip_and_is_refused_where_it_does_not_fit() {
    let (statics, bytes) = model();
    let of_bytes = |bytes: &[u8]| MemorySpec::of(&Model::from_bytes(bytes).expect("loads"));
    assert_eq!(of_bytes(bytes).expect("static"), None);
    let of = InputMemory {
        input: 0,
        range: [0.0, 0.08],
        line: Some(Line { fill_s: 0.4, empty_s: 1.2 }),
        orifice: None,
        play: vec![Play { threshold: 0.002, weight: 0.3 }],
        creep: vec![Creep { time_s: 5.0, weight: 0.1 }],
        slopes: Slopes { displacement_mm: 900.0, ..Slopes::default() },
    };
    let memory = MemorySpec { inputs: vec![of], max_gap_s: 1.0 };
    let with = |memory: &MemorySpec| {
        let mut model = statics.clone();
        model.set_record(BlockKind::Memory, memory).expect("encodes");
        model.to_bytes().expect("encodes")
    };
    assert_eq!(of_bytes(&with(&memory)).expect("valid"), Some(memory.clone()));
    for change in [
        |memory: &mut MemorySpec| memory.inputs[0].input = 2,
        |memory: &mut MemorySpec| memory.inputs[0].play[0].weight = f64::NAN,
        |memory: &mut MemorySpec| memory.max_gap_s = 0.0,
    ] {
        let mut wrong = memory.clone();
        change(&mut wrong);
        assert!(matches!(of_bytes(&with(&wrong)), Err(ModelFileError::Header(_))), "{wrong:?}");
    }
}

#[test]
fn modes_of_other_lengths_or_steps_are_refused() {
    let (model, _) = model();
    let nodes = model.header.node_count;
    let kind = BlockKind::Modes { regime: RegimeKind::Contact, field: 0 };
    let with = |data: BlockData| {
        let mut model = model.clone();
        let at = model.blocks.iter().position(|(of, _)| *of == kind).expect("stored");
        model.blocks[at].1 = data;
        Model::from_bytes(&model.to_bytes().expect("encodes"))
    };
    let refused = with(BlockData::F32(vec![0.0; nodes])).expect_err("no modes");
    assert!(matches!(refused, ModelFileError::Header(_)), "{refused}");
    let fewer = Modes::new(Precision::Integers, nodes, 1, |_, _| 1.0).expect("finite");
    let loaded = with(BlockData::Modes(fewer)).expect("a block like any other");
    assert!(matches!(loaded.modes(RegimeKind::Contact, 0), Err(ModelError::MissingBlock { .. })));
}

/// Numbers that are finite in the header and not in a field of f32, or not finite at all.
#[test]
fn numbers_that_no_training_gives_are_refused() {
    let places: [fn(&mut Model) -> &mut f64; 4] = [
        |model| &mut model.header.regimes[0].groups[0].surrogate.weights[0],
        |model| &mut model.header.regimes[0].groups[0].surrogate.centres[0],
        |model| &mut model.header.regimes[0].groups[0].surrogate.metric.scale[0],
        |model| &mut model.header.regimes[1].groups[0].surrogate.weights[0],
    ];
    for place in places {
        for bad in [1e300, -1e300, f64::INFINITY, f64::NAN] {
            let mut model = model().0.clone();
            *place(&mut model) = bad;
            let refused = model.to_bytes().map_or(true, |bytes| Model::from_bytes(&bytes).is_err());
            assert!(refused, "{bad}");
        }
    }
}

#[test]
fn layout_matches_the_documentation() {
    let (_, bytes) = model();
    assert_eq!(bytes[..8], MAGIC);
    assert_eq!(bytes[8..12], VERSION.to_le_bytes());
    assert_eq!(bytes[12..16], [0; 4]);
    let header = u64::from_le_bytes(bytes[16..24].try_into().expect("8 bytes")) as usize;
    assert_eq!(bytes[24..56], *blake3::hash(&bytes[64..64 + header]).as_bytes());
    let data = (64 + header).next_multiple_of(64);
    let reader = ModelReader::open(Cursor::new(bytes.as_slice())).expect("opens");
    for block in reader.blocks() {
        assert_eq!((data as u64 + block.offset) % 64, 0, "{:?} is not aligned", block.kind);
    }
    let body = bytes.len() - 32;
    assert_eq!(bytes[body..], *blake3::hash(&bytes[..body]).as_bytes());
}

#[test]
fn loading_a_selection_reads_only_its_blocks_and_predicts_the_same() {
    let (model, bytes) = model();
    let selection = Selection { fields: Some(vec!["displacement".into()]), nodes: Nodes::List(vec![7, 3]) };
    let part =
        ModelReader::open(Cursor::new(bytes.as_slice())).and_then(|mut r| r.load(&selection)).expect("loads");
    let stress = |m: &Model| m.blocks.iter().any(|(k, _)| matches!(k, BlockKind::Modes { field: 4, .. }));
    assert!(stress(model) && !stress(&part), "stress modes were not asked for");
    let answer = |model: &Model, selection: &Selection| {
        let mut state = ModelState::new(model, selection).expect("fits");
        state.update(Inputs::new(0.05, 20.0)).expect("trained in contact");
        (state.fields().to_vec(), state.reconstructor().rows())
    };
    let (all, rows) = answer(model, &Selection::default());
    let (some, _) = answer(&part, &selection);
    for (some, all) in some.iter().zip([all[3 * rows + 7], all[3 * rows + 3]]) {
        // Modes of a node set have smaller steps.
        assert!((some - all).abs() < 2e-3, "{some} mm is not {all} mm to the steps of the modes");
    }
}

#[test]
fn unknown_fields_and_nodes_are_refused_by_name() {
    let (model, bytes) = model();
    let named = |field: &str| Selection { fields: Some(vec![field.into()]), ..Selection::default() };
    assert!(matches!(Reconstructor::new(model, &named("strain")), Err(ModelError::UnknownField { .. })));
    let set = Selection { nodes: Nodes::Set("nowhere".into()), ..Selection::default() };
    assert!(matches!(Reconstructor::new(model, &set), Err(ModelError::UnknownNodeSet { .. })));
    let far = Selection { nodes: Nodes::List(vec![1_000_000]), ..Selection::default() };
    assert!(matches!(Reconstructor::new(model, &far), Err(ModelError::NodeOutOfRange { .. })));
    let part = ModelReader::open(Cursor::new(bytes.as_slice()))
        .and_then(|mut r| r.load(&named("x")))
        .expect("loads");
    assert!(matches!(Reconstructor::new(&part, &Selection::default()), Err(ModelError::MissingBlock { .. })));
}

#[test]
fn block_of_a_missing_field_is_refused() {
    let mut model = model().0.clone();
    let regime = model.header.regimes[0].kind;
    let values = vec![0.0; model.header.node_count];
    model.blocks.push((BlockKind::Mean { regime, field: 5 }, BlockData::F32(values)));
    let error = Model::from_bytes(&model.to_bytes().expect("encodes")).expect_err("there are five fields");
    assert!(error.to_string().contains("field: 5 }"), "{error}");
}

#[test]
fn foreign_files_and_other_versions_are_distinguished() {
    let (_, bytes) = model();
    let mut foreign = bytes.clone();
    foreign[0] = b'X';
    assert!(matches!(Model::from_bytes(&foreign), Err(ModelFileError::Foreign { .. })));
    assert!(matches!(Model::from_bytes(b"short"), Err(ModelFileError::Foreign { .. })));
    let mut newer = bytes.clone();
    newer[8..12].copy_from_slice(&(VERSION + 1).to_le_bytes());
    assert!(
        matches!(Model::from_bytes(&newer), Err(ModelFileError::Version { found }) if found == VERSION + 1)
    );
    let mut giant = bytes.clone();
    giant[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(matches!(Model::from_bytes(&giant), Err(ModelFileError::Truncated { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_truncation_is_refused(share in 0.0..1.0_f64) {
        let (_, bytes) = model();
        let cut = (bytes.len() as f64 * share) as usize;
        prop_assert!(Model::from_bytes(&bytes[..cut]).is_err());
    }

    #[test]
    fn any_flipped_bit_is_refused(share in 0.0..1.0_f64, bit in 0..8_u32) {
        let (_, bytes) = model();
        let mut damaged = bytes.clone();
        damaged[(bytes.len() as f64 * share) as usize] ^= 1 << bit;
        prop_assert!(Model::from_bytes(&damaged).is_err());
    }

    #[test]
    fn random_bytes_are_refused(tail in prop::collection::vec(any::<u8>(), 0..4096)) {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(tail);
        prop_assert!(Model::from_bytes(&bytes).is_err());
    }
}

#[test]
fn a_part_of_the_nodes_has_the_fields_and_the_force_of_the_whole() {
    let (model, _) = model();
    let count = model.header.node_count as u32;
    let nodes: Vec<u32> = (0..count).rev().step_by(3).collect();
    let part = model.at_nodes(&nodes).expect("nodes of the model");
    let part = Model::from_bytes(&part.to_bytes().expect("encodes")).expect("loads");
    let mut whole_state = ModelState::new(model, &Selection::default()).expect("predicts");
    let mut part_state = ModelState::new(&part, &Selection::default()).expect("predicts");
    for (pressure_mpa, gap_mm) in [(0.01, 40.0), (0.04, 12.0), (0.06, 30.0)] {
        let inputs = Inputs::new(pressure_mpa, gap_mm);
        whole_state.update(inputs).expect("an answer");
        part_state.update(inputs).expect("an answer");
        assert_eq!(whole_state.evaluation().coefficients, part_state.evaluation().coefficients);
        assert_eq!(
            whole_state.evaluation().contact_force_n.to_bits(),
            part_state.evaluation().contact_force_n.to_bits()
        );
        let whole = whole_state.fields().chunks(count as usize);
        for (whole, part) in whole.zip(part_state.fields().chunks(nodes.len())) {
            let span = whole.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
            for (node, value) in nodes.iter().zip(part) {
                let expected = whole[*node as usize];
                assert!((value - expected).abs() <= 1e-4 * span, "node {node}: {value}, expected {expected}");
            }
        }
    }
    assert!(part.facets().as_flattened().iter().all(|node| (*node as usize) < nodes.len()));
    let beyond = model.at_nodes(&[0, count]).expect_err("a node too many");
    assert_eq!(beyond, ModelError::NodeOutOfRange { node: count, node_count: count as usize });
}
