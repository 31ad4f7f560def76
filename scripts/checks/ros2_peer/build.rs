//! Types of `clients/ros2/softtwin_interfaces`, by the generator of hiroz from the files that a robot builds: layout and hashes are its.

use hiroz_codegen::{GeneratorConfig, MessageGenerator, bundled_assets_dir};
use std::collections::HashSet;
use std::env;
use std::path::{Path, PathBuf};

const PACKAGE: &str = "softtwin_interfaces";

fn main() {
    let folder = env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let package = Path::new(&folder).join("../../../clients/ros2").join(PACKAGE);
    println!("cargo:rerun-if-changed={}", package.display());
    // A service is described with its events, whose types are these; needed for the hashes only.
    let others = ["builtin_interfaces", "service_msgs"].map(|name| bundled_assets_dir(false).join(name));
    let others: Vec<&Path> = others.iter().map(PathBuf::as_path).collect();
    let generator = MessageGenerator::new(GeneratorConfig {
        generate_cdr: true,
        generate_protobuf: false,
        generate_type_info: true,
        is_humble: false,
        output_dir: env::var_os("OUT_DIR").expect("cargo sets it").into(),
        external_crate: None, // with one, the generator leaves the hashes of services out
        local_packages: HashSet::new(),
        json_out: None,
    });
    generator.generate_from_msg_files_with_deps(&[&package], &others).expect("the definitions can be read");
}
