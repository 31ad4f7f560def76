//! A structure that is no actuator, as another program leaves its results: a cantilever with load and thickness as inputs, as
//! VTU files of linear hexahedra with an analytic bending field.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

const LENGTH_MM: f64 = 100.0;
const WIDTH_MM: f64 = 20.0;
const MODULUS_MPA: f64 = 2000.0;
/// Cells along, across the thickness and across the width.
const CELLS: [usize; 3] = [20, 2, 2];

/// Undeformed node (mm), displacement (mm) and von Mises stress (MPa).
pub type Node = ([f64; 3], [f64; 3], f64);

/// The nodes of a beam bent by a force at its end (Euler and Bernoulli).
pub fn beam(load_n: f64, thickness_mm: f64) -> Vec<Node> {
    let inertia = WIDTH_MM * thickness_mm.powi(3) / 12.0;
    let mut nodes = Vec::new();
    for k in 0..=CELLS[2] {
        for j in 0..=CELLS[1] {
            for i in 0..=CELLS[0] {
                let share = |n: usize, axis: usize| n as f64 / CELLS[axis] as f64;
                let x = LENGTH_MM * share(i, 0);
                let point = [x, thickness_mm * share(j, 1), WIDTH_MM * share(k, 2)];
                let above_mm = point[1] - 0.5 * thickness_mm;
                let factor = -load_n / (6.0 * MODULUS_MPA * inertia);
                let slope = factor * (6.0 * LENGTH_MM * x - 3.0 * x * x);
                let u = [-above_mm * slope, factor * x * x * (3.0 * LENGTH_MM - x), 0.0];
                nodes.push((point, u, (load_n * (LENGTH_MM - x) * above_mm / inertia).abs()));
            }
        }
    }
    nodes
}

/// The hexahedra of the beam.
pub fn cells() -> Vec<[usize; 8]> {
    let [nx, ny, nz] = CELLS;
    let at = |i: usize, j: usize, k: usize| (k * (ny + 1) + j) * (nx + 1) + i;
    let ring =
        |i: usize, j: usize, k: usize| [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k)];
    let mut cells = Vec::new();
    for (i, j, k) in (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| (i, j, k)))) {
        let ([a, b, c, d], [e, f, g, h]) = (ring(i, j, k), ring(i, j, k + 1));
        cells.push([a, b, c, d, e, f, g, h]);
    }
    cells
}

/// A VTU file of the cantilever.
pub fn vtu(load_n: f64, thickness_mm: f64) -> String {
    vtu_of(&beam(load_n, thickness_mm))
}

/// A VTU file as meshio writes it in ASCII, lengths in m and stresses in Pa, of the beam's nodes.
pub fn vtu_of(nodes: &[Node]) -> String {
    let cells = cells();
    let text =
        |values: &mut dyn Iterator<Item = f64>| values.map(|v| format!("{v:.11e} ")).collect::<String>();
    let points = text(&mut nodes.iter().flat_map(|node| node.0).map(|v| 1e-3 * v));
    let moved = text(&mut nodes.iter().flat_map(|node| node.1).map(|v| 1e-3 * v));
    let stress = text(&mut nodes.iter().map(|node| 1e6 * node.2));
    let connectivity: String = cells.iter().flatten().map(|n| format!("{n} ")).collect();
    let mut xml = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
         <UnstructuredGrid><Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n",
        nodes.len(),
        cells.len()
    );
    let mut array = |kind: &str, name: &str, components: usize, values: &str| {
        let _ = writeln!(
            xml,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{values}</DataArray>"
        );
    };
    array("Float64", "POINTS", 3, &points);
    array("Int64", "connectivity", 1, &connectivity);
    array("Int64", "offsets", 1, &(1..=cells.len()).map(|n| format!("{} ", 8 * n)).collect::<String>());
    array("Int64", "types", 1, &"12 ".repeat(cells.len()));
    array("Float64", "u", 3, &moved);
    array("Float64", "mises", 1, &stress);
    // Rearrange the arrays into their sections.
    let lines: Vec<&str> = xml.lines().collect();
    let (head, arrays) = lines.split_at(lines.len() - 6);
    format!(
        "{}\n<Points>{}</Points>\n<Cells>{}</Cells>\n<PointData>{}</PointData>\n</Piece></UnstructuredGrid></VTKFile>\n",
        head.join("\n"),
        arrays[0],
        arrays[1..4].join("\n"),
        arrays[4..].join("\n")
    )
}

/// Writes 28 simulations over load and thickness into a folder; names of the files, in the order of the inputs.
///
/// # Panics
/// When the folder cannot be written.
pub fn simulations(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for thickness in 0..7 {
        for load in 0..4 {
            let (load_n, thickness_mm) = (1.0 + f64::from(load), 6.0 + 0.5 * f64::from(thickness));
            names.push(format!("beam_f{load_n}_t{thickness_mm}.vtu"));
            fs::write(folder.join(names.last().unwrap()), vtu(load_n, thickness_mm)).unwrap();
        }
    }
    names
}
