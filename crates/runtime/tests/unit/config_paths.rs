use super::*;
use std::path::Path;

/// A scene with every path-valued key; `NAME` is relative.
const SCENE: &str = r#"
name = "paths"
[[actuator]]
name = "replayed"
model = "NAME"
source = { kind = "replay", trace = "NAME", log = "NAME" }
[actuator.valve]
range_mpa = [0.0, 0.1]
iio = { root = "NAME", device = "iio:device0", scale = 1e-4, raw_max = 4095 }
[[actuator]]
name = "measured"
model = "NAME"
[actuator.sensors.registers]
kind = "modbus"
serial = { port = "NAME" }
values.pressure_mpa = { from = { register = 2 } }
[actuator.sensors.line]
kind = "lines"
serial = { port = "NAME" }
values.gap_mm = { from = 1 }
[actuator.sensors.program]
kind = "lines"
command = ["./NAME", "NAME"]
values.measured_force_n = { from = 1 }
[actuator.valve]
range_mpa = [0.0, 0.1]
lines = { serial = { port = "NAME" }, format = "{value}" }
[[actuator]]
name = "driven"
model = "NAME"
[actuator.valve]
range_mpa = [0.0, 0.1]
modbus = { serial = { port = "NAME" }, value = { from = { register = 3 } } }
"#;

#[test]
fn every_path_counts_from_the_folder_of_its_file() {
    let here = std::path::absolute(".").unwrap();
    for (file, folder) in
        [("scene.toml", here.clone()), ("a/b/scene.toml", here.join("a/b")), ("/x/s.toml", "/x".into())]
    {
        let mut scene: Scene = toml::from_str(SCENE).unwrap();
        scene.resolve_paths(Path::new(file)).unwrap();
        assert_eq!(scene.folder, folder, "{file}");
        let mut paths: Vec<PathBuf> = Vec::new();
        for actuator in &mut scene.actuators {
            paths.extend(actuator.paths_mut().into_iter().map(|path| path.clone()));
            paths.extend(actuator.programs_mut().map(|program| PathBuf::from(&*program)));
        }
        assert!(
            paths.len() == 11 && paths.iter().all(|path| *path == folder.join("NAME")),
            "{file}: {paths:?}"
        );
        // Neither an argument nor a name that is no path is changed, and no other key has one.
        let text = toml::to_string(&scene).unwrap();
        assert_eq!(text.matches("\"NAME\"").count(), 1, "{text}");
        let before = scene.clone();
        scene.resolve_paths(Path::new(file)).unwrap();
        assert_eq!(scene, before, "absolute paths stay");
    }
}
