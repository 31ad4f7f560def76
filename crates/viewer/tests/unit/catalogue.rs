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
