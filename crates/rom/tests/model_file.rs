//! The model file: round trip, golden bytes, partial loading, and every way of being damaged.

use proptest::prelude::*;
use rom::inputs::{InputSpec, Inputs};
use rom::model::{
    BlockData, BlockKind, FIXED_VERSION, MAGIC, Model, ModelError, ModelFileError, ModelReader, Nodes,
    PLAIN_VERSION, Selection, VERSION,
};
use rom::model_state::ModelState;
use rom::reconstructor::Reconstructor;
use rom::synthetic;
use std::io::Cursor;
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

#[test]
fn a_model_survives_the_round_trip() {
    let (model, bytes) = model();
    assert_eq!(*model, Model::from_bytes(bytes).expect("loads"));
}

#[test]
fn a_model_of_other_inputs_survives_the_round_trip() {
    let mut model = model().0.clone();
    let range = [f64::NEG_INFINITY, f64::INFINITY];
    model.header.inputs.push(InputSpec {
        name: "temperature".into(),
        unit: "degC".into(),
        range,
        value: Some(20.0),
    });
    let bytes = model.to_bytes().expect("encodes");
    assert_eq!(model, Model::from_bytes(&bytes).expect("loads"));
}

/// A file of the first release: a beam of formulas, written by the program of that time, and what it answered.
#[test]
fn a_model_of_version_2_is_read_and_answers_as_it_did() {
    let bytes = include_bytes!("data/version2.twin");
    assert_eq!(bytes[8..12], 2_u32.to_le_bytes());
    let model = Model::from_bytes(bytes).expect("loads");
    let names: Vec<&str> = model.header.inputs.iter().map(|input| input.name.as_str()).collect();
    assert_eq!(names, ["pressure", "gap"]);
    assert!(model.header.inputs[0].range[0] == 0.0 && (model.header.inputs[0].range[1] - 0.09).abs() < 1e-12);
    let mut state = ModelState::new(&model, &Selection::default()).expect("fits");
    state.update(Inputs::new(0.06, 20.0)).expect("trained in contact");
    let found = state.evaluation();
    for (found, expected) in [
        (found.contact_force_n, 0.491_944_569_022_694_96),
        (found.force_by_pressure_n_per_mpa(), 9.998_623_410_890_6),
        (found.force_by_gap_n_per_mm(), -0.012_562_568_421_592_646),
        (found.halfwidths.displacement_mm, 0.134_745_597_851_801_54),
    ] {
        assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
    }
}

/// Files of later versions, kept: `SOFTTWIN_KEEP=1 cargo test -p rom --test all model_file::` writes those of this program, with what it
/// answers. A new version of the file fails here until its file is kept.
#[test]
fn models_of_every_later_version_are_read_and_answer_as_they_did() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let answer = |model: &Model| {
        let mut state = ModelState::new(model, &Selection::default()).expect("fits");
        state.update(Inputs::new(0.06, 20.0)).expect("trained in contact");
        let found = state.evaluation();
        [found.contact_force_n, found.force_by_pressure_n_per_mpa(), found.halfwidths.displacement_mm]
    };
    let path = |version: u32| folder.join(format!("version{version}.twin"));
    if std::env::var_os("SOFTTWIN_KEEP").is_some() {
        let (model, bytes) = model();
        std::fs::write(path(PLAIN_VERSION), bytes).expect("written");
        let answers = answer(model).map(|value| format!("{value:?}")).join("\n");
        std::fs::write(path(PLAIN_VERSION).with_extension("txt"), answers).expect("written");
    }
    let bytes = std::fs::read(path(PLAIN_VERSION)).expect("SOFTTWIN_KEEP=1 writes it; commit it");
    assert_eq!(bytes[8..12], PLAIN_VERSION.to_le_bytes());
    let found = answer(&Model::from_bytes(&bytes).expect("loads"));
    let kept = std::fs::read_to_string(path(PLAIN_VERSION).with_extension("txt")).expect("beside the model");
    for (found, kept) in found.iter().zip(kept.lines()) {
        let kept: f64 = kept.parse().expect("a number");
        assert!((found - kept).abs() <= 1e-9 * kept.abs(), "{found} is not {kept}");
    }
    // Models with parameters have a version of their own, and with parameters that move the mesh.
    let stiffness = folder.join("../../../../models/pneunet-stiffness/pneunet-stiffness.twin");
    let bytes = std::fs::read(stiffness).expect("in the repository");
    assert_eq!(bytes[8..12], FIXED_VERSION.to_le_bytes(), "keep a file of the version before");
    let mut model = Model::from_bytes(&bytes).expect("loads");
    let kind = BlockKind::UndeformedBy { input: 2, axis: 0, from_bits: 0.8_f64.to_bits() };
    model.blocks.push((kind, BlockData::F32(vec![0.0; model.header.node_count])));
    let bytes = model.to_bytes().expect("writes");
    assert_eq!(bytes[8..12], VERSION.to_le_bytes());
    assert_eq!(Model::from_bytes(&bytes).expect("loads"), model);
}

#[test]
fn the_layout_is_what_the_documentation_says() {
    let (_, bytes) = model();
    assert_eq!(bytes[..8], MAGIC);
    assert_eq!(bytes[8..12], PLAIN_VERSION.to_le_bytes());
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
        assert!((some - all).abs() < 1e-5, "{some} mm is not {all} mm to rounding");
    }
}

#[test]
fn what_is_not_in_the_model_is_refused_by_name() {
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
fn a_block_of_a_field_that_is_not_there_is_refused() {
    let mut model = model().0.clone();
    let regime = model.header.regimes[0].kind;
    let values = vec![0.0; model.header.node_count];
    model.blocks.push((BlockKind::Mean { regime, field: 5 }, BlockData::F32(values)));
    let error = Model::from_bytes(&model.to_bytes().expect("encodes")).expect_err("there are five fields");
    assert!(error.to_string().contains("field: 5 }: expected one of the 5 fields"), "{error}");
}

#[test]
fn foreign_and_newer_files_are_named_as_such() {
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
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(tail);
        prop_assert!(Model::from_bytes(&bytes).is_err());
    }
}
