//! `actuator.toml` from the reference actuator's: other values, the same comments.

use super::shape::Entry;

/// The reference actuator, whose comments explain every key.
const REFERENCE: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/actuator.toml"));

/// Section of the reference that only other meshers read.
const MESH: &str = "\
[mesh]
file = \"mesh.vtu\"                 # made by `softtwin build` and `softtwin mesh`; or another mesh, .msh or .vtu
nodes = 0                         # nodes it must have; 0 for any
size_mm = SIZE                    # mm, longest edge of an element; `softtwin build` refuses one that does not suit the thinnest wall
seed_mm = SIZE                    # mm, from here on for scripts/mesh.py (gmsh) alone: edges are divided into round(length / seed) parts
optimise_below = 0.3              # elements of a lower quality (gamma) are improved by gmsh's own optimiser
netgen_passes = 1                 # passes of the Netgen optimiser
random_seed = 34                  # of gmsh
";

/// The file: `heading` above, `entries` in place of the reference's values, `elastomer` as further lines of the elastomer and `law` as its law.
pub fn compose(heading: &str, entries: &[Entry], [elastomer, law]: [&str; 2], size_mm: f64) -> String {
    let body = REFERENCE.find("# Actuator frame").map_or(REFERENCE, |at| &REFERENCE[at..]);
    let (mut section, mut text) = (String::new(), heading.to_owned());
    for line in body.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            name.clone_into(&mut section);
        }
        let key = line.split(" = ").next().unwrap_or("");
        let entry = entries.iter().find(|(of, name, _)| *of == section && *name == key);
        match (section.as_str(), entry) {
            // A new file has the defaults of the iteration: a value copied from elsewhere can only make its states harder to solve.
            ("mesh" | "newton", _) => {}
            ("elastomer.law", _) if line.contains(" = ") => {}
            ("elastomer.law", _) if line.starts_with('[') => text += &format!("{elastomer}{line}\n{law}"),
            (_, Some((_, _, value))) => text += &replaced(line, key, value),
            _ => text += &format!("{line}\n"),
        }
    }
    text + &MESH.replace("SIZE", &format!("{size_mm:?}"))
}

/// The line with another value, its comment in the same column.
fn replaced(line: &str, key: &str, value: &str) -> String {
    let comment = line.find('#').map_or("", |at| &line[at..]);
    let column = line.find('#').unwrap_or(0);
    format!("{:column$}{comment}\n", format!("{key} = {value} "))
}
