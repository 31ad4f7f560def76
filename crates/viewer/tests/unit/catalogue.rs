//! Tests of `src/catalogue.rs`.

use super::*;

#[test]
fn plate_of_the_scene_is_that_of_its_actuator() {
    let text = r#"
        name = "two"
        [[actuator]]
        name = "short"
        model = "short.twin"
        plate = { x_mm = [0.0, 58.0], z_mm = [-9.0, 41.0] }
        [[actuator]]
        name = "other"
        model = "other.twin"
    "#;
    let scene: Scene = toml::from_str(text).expect("a scene");
    let plates = Stand::of(&scene).plates;
    assert_eq!(plates.len(), 1);
    assert_eq!(plates["short"], Footprint { x_mm: [0.0, 58.0], z_mm: [-9.0, 41.0] });
}

/// A prediction in a page has the words of a published state.
#[test]
fn a_prediction_has_names_of_a_state() {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/pneunet.twin"));
    let (model, hash) = Model::read(&path).expect("the shipped model");
    let catalogue = Catalogue::new(&[NamedModel { path, model, hash }], Stand::default()).expect("predicts");
    let state: serde_json::Value = serde_json::to_value(FrameHead::empty("a")).expect("plain data");
    // Inside, and outside the training range.
    for (pressure_mpa, warnings) in [(0.05, 0), (0.1, 1)] {
        let inputs = BTreeMap::from([("pressure_mpa".to_owned(), pressure_mpa), ("gap_mm".to_owned(), 30.0)]);
        let frame = catalogue.predict(0, &inputs).expect("an answer");
        let length = u32::from_le_bytes(frame[..4].try_into().expect("four bytes")) as usize;
        let head: serde_json::Value = serde_json::from_slice(&frame[4..4 + length]).expect("JSON");
        let unknown: Vec<&String> =
            head.as_object().expect("an object").keys().filter(|key| state.get(key).is_none()).collect();
        assert_eq!(unknown, ["predicted"], "keys that a published state does not have");
        let flags = head["flags"].as_array().expect("a list");
        assert_eq!(flags.len(), warnings);
        let known: Vec<&str> = wire::layout::flags::ALL.iter().map(|code| code.name).collect();
        assert!(flags.iter().all(|flag| known.contains(&flag.as_str().expect("a name"))), "{flags:?}");
    }
}
