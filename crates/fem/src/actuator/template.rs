//! The text of a new `actuator.toml`: from the few lengths people think in to every length, in the proportions of the reference actuator and
//! with its comments.

use super::file::Shape;
use crate::material::silicone::{HardnessFigure, Silicone};
use crate::mesh::three_digits;
use rom::snapshots::Footprint;
use std::collections::BTreeMap;
use std::path::Path;

/// Margins of the base before and behind the body, mm.
const MARGIN_MM: f64 = 6.0;
/// Width of a slot, mm.
const SLOT_MM: f64 = 1.0;
/// Distance of the chambers of the reference actuator, mm.
const PITCH_MM: f64 = 9.0;
/// Width of the base by that of the body.
const BASE_BY_BODY: f64 = 1.6;
/// Smallest length of a cavity along the actuator, mm: shorter ones cannot be cast.
const SHORTEST_CAVITY_MM: f64 = 1.0;

/// What a new actuator is made of.
#[derive(Clone, Copy)]
pub enum NewMaterial<'a> {
    /// A silicone with published constants.
    Published(&'static Silicone),
    /// A neo-Hookean silicone of this shear modulus (MPa).
    Shear(f64),
    /// Only a figure of a data sheet is known, perhaps with the elongation at break (%).
    DataSheet(HardnessFigure, Option<f64>),
    /// The text of a material file, which was fitted to tests.
    File(&'a str),
}

/// A new actuator in what people think in.
#[derive(Clone, Copy)]
pub struct NewActuator<'a> {
    /// Name of its files and topics.
    pub name: &'a str,
    /// Measures of a finger, or a mesh file.
    pub shape: NewShape<'a>,
    /// True if it hangs down along the wall it is to touch.
    pub hanging: bool,
    /// Silicone that the body is moulded of.
    pub material: NewMaterial<'a>,
}

/// What a new actuator looks like.
#[derive(Clone, Copy)]
pub enum NewShape<'a> {
    /// A finger in the proportions of the reference actuator.
    Boxes(NewBoxes),
    /// A mesh file with named surfaces, which is copied.
    Mesh {
        /// Read once and copied beside the actuator's file.
        file: &'a Path,
        /// Name of the surface that is held.
        fixed: &'a str,
    },
}

/// A finger in a few figures.
#[derive(Clone, Copy)]
pub struct NewBoxes {
    /// Number of chambers.
    pub chambers: usize,
    /// Whole length, mm; by default 9 mm a chamber.
    pub length_mm: Option<f64>,
    /// Width of the body, mm; the base is wider by its margins.
    pub width_mm: f64,
    /// Wall between cavity and slot, mm; the top is 0.8 and a side 1.2 of it.
    pub wall_mm: f64,
}

/// Name of the material file in the folder of a new actuator that has one.
pub(super) const MATERIAL_FILE: &str = "material.toml";

/// Section, key and value of `actuator.toml`.
type Entry = (&'static str, &'static str, String);

impl NewActuator<'_> {
    /// The text of `actuator.toml`; `folder` is what `softtwin build` is given in its first comment, and `cavities` are the further ones of a
    /// mesh file.
    ///
    /// # Errors
    /// Chambers that do not fit: which option, and what would.
    pub(super) fn text(&self, folder: &str, cavities: &[String]) -> Result<String, String> {
        let mut entries = match self.shape {
            NewShape::Boxes(boxes) => boxes.entries()?,
            NewShape::Mesh { fixed, .. } => vec![
                ("loads", "cavity_load", "\"consistent\"".into()),
                ("support", "fixed", format!("\"{fixed}\"")),
            ],
        };
        let mut elastomer = String::new();
        let law = match self.material {
            NewMaterial::DataSheet(figure, elongation_percent) => {
                let estimate = figure.estimate();
                let [low, high] = estimate.interval_mpa.map(three_digits);
                elastomer = format!(
                    "shear_interval_mpa = [{low:?}, {high:?}] # MPa, of the initial shear modulus, by the data sheet\n"
                );
                if let Some(percent) = elongation_percent {
                    elastomer += &format!(
                        "stretch_range = [1.0, {:?}]      # to the elongation at break\n",
                        three_digits(1.0 + 0.01 * percent)
                    );
                }
                let mu = three_digits(estimate.shear_mpa);
                format!("# {}.\nlaw = \"neo-hookean\"\nmu_mpa = {mu:?}\n", figure.source())
            }
            NewMaterial::Shear(mu) => {
                format!("# Own constant: a neo-Hookean silicone.\nlaw = \"neo-hookean\"\nmu_mpa = {mu:?}\n")
            }
            NewMaterial::Published(silicone) => {
                let lines: String =
                    silicone.law.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
                entries.push(("elastomer", "density_t_per_mm3", silicone.density_t_per_mm3.into()));
                if let Some(test) = &silicone.test {
                    elastomer =
                        format!("stretch_range = [1.0, {:?}]        # of a bar, fitted\n", test.stretch);
                }
                format!("# {}: {}.\n{lines}", silicone.name, silicone.evidence())
            }
            NewMaterial::File(_) => String::new(),
        };
        let name = self.name;
        entries.push(("", "name", format!("\"{name}\"")));
        if self.hanging {
            entries.push(("loads", "gravity_mm_s2", "[9810.0, 0.0, 0.0]".into()));
        }
        let heading = format!(
            "# {name}: a soft pneumatic actuator, begun by `softtwin new`. `softtwin build {folder}` makes its mesh, its states and its\n\
             # twin. After a change here run it again.\n#\n"
        );
        let (left_out, mesh) = match self.shape {
            NewShape::Boxes(boxes) => (&[][..], MESH.replace("SIZE", &format!("{:?}", 2.0 * boxes.wall_mm))),
            NewShape::Mesh { file, .. } => (&OF_BOXES[..], OWN_MESH.replace("FILE", &mesh_name(file))),
        };
        let mut text = compose(&heading, &entries, [&elastomer, &law], left_out) + &mesh;
        if !cavities.is_empty() {
            let pressures: BTreeMap<&str, f64> = cavities.iter().map(|name| (name.as_str(), 0.0)).collect();
            text += FURTHER_CAVITIES;
            text += &toml::to_string(&pressures).map_err(|error| error.to_string())?;
        }
        Ok(if let NewMaterial::File(_) = self.material { with_material_file(&text) } else { text })
    }
}

impl NewBoxes {
    /// Length for which the chambers are `pitch_mm` apart.
    fn length_of(&self, pitch_mm: f64) -> f64 {
        self.chambers as f64 * pitch_mm + 2.0 * self.wall_mm - SLOT_MM + 2.0 * MARGIN_MM
    }

    /// The values that differ from those of the reference.
    fn entries(&self) -> Result<Vec<Entry>, String> {
        let (wall, count) = (self.wall_mm, self.chambers as f64);
        let smallest_pitch = SHORTEST_CAVITY_MM + SLOT_MM + 2.0 * wall;
        let default_mm = self.length_of(PITCH_MM.max(smallest_pitch));
        let length = self.length_mm.unwrap_or(default_mm);
        let least = self.length_of(smallest_pitch);
        if length < least - 1e-9 {
            return Err(format!(
                "--length-mm {length}: {} chambers with walls of {wall} mm need at least {least:.1} mm (cavities of \
                 {SHORTEST_CAVITY_MM} mm, slots of {SLOT_MM} mm); give a larger length, fewer chambers or a smaller --wall-mm",
                self.chambers
            ));
        }
        let body_length = length - 2.0 * MARGIN_MM;
        let pitch = (body_length - 2.0 * wall + SLOT_MM) / count;
        let base_width = BASE_BY_BODY * self.width_mm;
        let cavity_width = self.width_mm - 2.4 * wall;
        let cavity_top = 19.0 - 0.8 * wall;
        // A slot must stay open above the channels, and a chamber must be wider than its channel.
        if cavity_width < 3.0 || cavity_top < 8.0 {
            return Err(format!(
                "--wall-mm {wall}: leaves cavities {cavity_width:.1} mm wide and {cavity_top:.1} mm high at their top, expected at \
                 least 3 and 8 mm; give thinner walls or a larger --width-mm"
            ));
        }
        let mm = |value: f64| format!("{:?}", (value * 1e6).round() / 1e6);
        let range = |low: f64, high: f64| format!("[{}, {}]", mm(low), mm(high));
        let [beyond_tip, beyond_side] = Footprint::PLATE_BEYOND_MM;
        Ok(vec![
            ("base", "length_mm", mm(length)),
            ("base", "width_mm", mm(base_width)),
            ("body", "length_mm", mm(body_length)),
            ("body", "width_mm", mm(self.width_mm)),
            ("chambers", "count", self.chambers.to_string()),
            ("chambers", "first_mm", mm(MARGIN_MM + 2.0 * wall)),
            ("chambers", "length_mm", mm(pitch - SLOT_MM - 2.0 * wall)),
            ("chambers", "pitch_mm", mm(pitch)),
            ("chambers", "width_mm", mm(cavity_width)),
            ("chambers", "top_mm", mm(cavity_top)),
            ("obstacle", "x_mm", range(0.0, length + beyond_tip)),
            ("obstacle", "z_mm", range(-beyond_side, base_width + beyond_side)),
        ])
    }
}

/// The cross-section through a chamber, drawn with its measures in mm. It is not to scale: every measure is written out.
pub fn cross_section(shape: &Shape<'_>) -> String {
    let (base, body, chambers) = (shape.base, shape.body, shape.chambers);
    let number = |mm: f64| ((mm * 100.0).round() / 100.0).to_string();
    let floor = shape.cavity_floor_mm();
    let side = number(0.5 * (body.width_mm - chambers.width_mm));
    let cavity = format!("{} x {}", number(chambers.width_mm), number(chambers.top_mm - floor));
    let sheet = if shape.sheet { "- - - - sheet - - - -" } else { "" };
    let level = |mm: f64| format!("y = {}", number(mm));
    [
        format!("       |<---- {:^5} ---->|       width of the body (--width-mm)", number(body.width_mm)),
        format!("       +----------------+       {}", level(body.top_mm)),
        format!("       |  {:^12}  |       wall of the top {}", "", number(body.top_mm - chambers.top_mm)),
        format!("       |  +----------+  |       {}", level(chambers.top_mm)),
        format!("       |  |  cavity  |  |       cavity {cavity} (across z and y)"),
        format!("       |  |          |  |       wall of a side {side}"),
        format!("       |  +----------+  |       {}", level(floor)),
        format!("  +----+----------------+----+  {}", level(shape.base_top_mm())),
        format!("  |  {sheet:^22}  |  {}", level(base.lower_mm)),
        "  +--------------------------+  y = 0".to_owned(),
        format!("  |<-------- {:^6} -------->|  width of the base", number(base.width_mm)),
    ]
    .map(|line| line.trim_end().to_owned())
    .join("\n")
}

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

/// Section of an actuator whose shape is that of its mesh.
const OWN_MESH: &str = "\
[mesh]
file = \"FILE\"                 # tetrahedra of ten nodes in mm, with named surfaces: docs/own-mesh.md
";

/// Section of an actuator with further cavities, before their names.
const FURTHER_CAVITIES: &str = "
[pressure_mpa]                    # MPa, of the cavities beside `cavity` in states that do not set it: `--set pressure_mpa.NAME=0.02`
";

/// Sections that an actuator with its own mesh has not.
const OF_BOXES: [&str; 7] = ["base", "body", "chambers", "slots", "channels", "sheet", "obstacle"];

/// Name of the mesh file in the folder of a new actuator.
pub(super) fn mesh_name(file: &Path) -> String {
    file.extension().map_or_else(|| "mesh".to_owned(), |ending| format!("mesh.{}", ending.to_string_lossy()))
}

/// The file: `heading` above, `entries` in place of the reference's values, `elastomer` as further lines of the elastomer and `law` as its law,
/// without the sections `left_out`.
fn compose(heading: &str, entries: &[Entry], [elastomer, law]: [&str; 2], left_out: &[&str]) -> String {
    let body = REFERENCE.find("# Actuator frame").map_or(REFERENCE, |at| &REFERENCE[at..]);
    let (mut section, mut text) = (String::new(), heading.to_owned());
    for line in body.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            name.clone_into(&mut section);
        }
        let key = line.split(" = ").next().unwrap_or("");
        let entry = entries.iter().find(|(table, name, _)| *table == section && *name == key);
        match (section.as_str(), entry) {
            // A new file has the defaults of the iteration: a value copied from elsewhere can only make its states harder to solve.
            ("mesh" | "newton", _) => {}
            (section, _) if left_out.contains(&section) => {}
            ("elastomer.law", _) if line.contains(" = ") => {}
            ("elastomer.law", _) if line.starts_with('[') => text += &format!("{elastomer}{line}\n{law}"),
            (_, Some((_, _, value))) => text += &replaced(line, key, value),
            _ => text += &format!("{line}\n"),
        }
    }
    text
}

/// The file with the elastomer's own keys replaced by the name of a material file.
fn with_material_file(text: &str) -> String {
    let mut is_elastomer = false;
    let mut out = String::new();
    for line in text.lines() {
        if line.starts_with('[') {
            let was_elastomer = is_elastomer;
            is_elastomer = line.starts_with("[elastomer]") || line.starts_with("[elastomer.");
            if is_elastomer && !was_elastomer {
                let key = format!("file = \"{MATERIAL_FILE}\"");
                out += &format!("[elastomer]\n{key:33} # made by `softtwin material fit`\n\n");
            }
        }
        if !is_elastomer {
            out += &format!("{line}\n");
        }
    }
    out
}

/// The line with another value, its comment in the same column.
fn replaced(line: &str, key: &str, value: &str) -> String {
    let comment = line.find('#').map_or("", |at| &line[at..]);
    let column = line.find('#').unwrap_or(0);
    format!("{:column$}{comment}\n", format!("{key} = {value} "))
}
