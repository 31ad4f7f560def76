//! Good inputs of every entrance as files, for libFuzzer to begin with: `cargo run -p tests --example seeds`
//! writes `fuzz/seeds/<entrance>/good`.

use std::path::Path;
use tests::inputs::ENTRANCES;

fn main() -> std::io::Result<()> {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds");
    for entrance in &ENTRANCES {
        let folder = seeds.join(entrance.name);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join("good"), (entrance.seed)())?;
    }
    println!("{}: {} entrances", seeds.display(), ENTRANCES.len());
    Ok(())
}
