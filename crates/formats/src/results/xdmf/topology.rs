//! Cells of XDMF by name and number. Their nodes stand in the order of VTK.

use crate::cells::{Block, Kind};
use crate::error::Diagnostic;

/// Names of a topology, its number in a mixed one, VTK's number of the cell and the nodes that the file has.
const TOPOLOGIES: [(&[&str], u32, u8, usize); 11] = [
    (&["tetrahedron"], 0x6, 10, 4),
    (&["tetrahedron_10", "tet_10"], 0x26, 24, 10),
    (&["hexahedron"], 0x9, 12, 8),
    (&["hexahedron_20", "hex_20"], 0x30, 25, 20),
    // By its nodes on corners and edges; those within faces and cell have no cell then.
    (&["hexahedron_27", "hex_27"], 0x32, 25, 27),
    (&["wedge"], 0x8, 13, 6),
    (&["wedge_15"], 0x28, 26, 15),
    (&["triangle"], 0x4, 5, 3),
    (&["triangle_6", "tri_6"], 0x24, 22, 6),
    (&["quadrilateral"], 0x5, 9, 4),
    (&["quadrilateral_8", "quad_8"], 0x25, 23, 8),
];
/// Points and lines, of which a mixed topology says the number of nodes, and the quadratic line.
const COUNTED: [u32; 2] = [0x1, 0x2];
const QUADRATIC_LINE: u32 = 0x22;
const KNOWN: &str =
    "tetrahedra (4, 10 nodes), hexahedra (8, 20, 27), wedges (6, 15), triangles or quadrilaterals";

/// The cells of a topology; `numbers` as stored, nodes counted from `base`.
pub(super) fn blocks(
    name: &str,
    numbers: &[f64],
    base: f64,
    points: usize,
) -> Result<Vec<Block>, Diagnostic> {
    let lower = name.to_lowercase();
    let mut blocks = Vec::new();
    if lower == "mixed" {
        return mixed(numbers, base, points);
    }
    let known = TOPOLOGIES.iter().find(|(names, ..)| names.contains(&lower.as_str()));
    let Some((_, _, kind, nodes)) = known else {
        return Err(Diagnostic::new("Topology", KNOWN, format!("`{name}`")));
    };
    if numbers.is_empty() || !numbers.len().is_multiple_of(*nodes) {
        let found = format!("{} numbers", numbers.len());
        return Err(Diagnostic::new("Topology", format!("cells of {nodes} nodes"), found));
    }
    for (cell, members) in numbers.chunks_exact(*nodes).enumerate() {
        add(&mut blocks, *kind, cell, members, base, points)?;
    }
    Ok(blocks)
}

/// Cell after cell: its number, for points and lines their count, its nodes.
fn mixed(numbers: &[f64], base: f64, points: usize) -> Result<Vec<Block>, Diagnostic> {
    let (mut blocks, mut rest, mut cell) = (Vec::new(), numbers, 0);
    let short = |cell| Diagnostic::new(format!("cell {cell}"), "all its nodes", "the end of the Topology");
    while let [code, after @ ..] = rest {
        let code = *code as u32;
        if COUNTED.contains(&code) || code == QUADRATIC_LINE {
            let skipped = match (code, after) {
                (QUADRATIC_LINE, _) => 3,
                (_, [count, ..]) if *count >= 1.0 => 1_usize.saturating_add(*count as usize),
                _ => return Err(short(cell)),
            };
            rest = after.get(skipped..).ok_or_else(|| short(cell))?;
        } else {
            let known = TOPOLOGIES.iter().find(|topology| topology.1 == code);
            let Some((_, _, kind, nodes)) = known else {
                return Err(Diagnostic::new(format!("cell {cell}"), KNOWN, format!("number {}", rest[0])));
            };
            let (members, next) = after.split_at_checked(*nodes).ok_or_else(|| short(cell))?;
            add(&mut blocks, *kind, cell, members, base, points)?;
            rest = next;
        }
        cell += 1;
    }
    Ok(blocks)
}

fn add(
    blocks: &mut Vec<Block>,
    kind: u8,
    cell: usize,
    members: &[f64],
    base: f64,
    points: usize,
) -> Result<(), Diagnostic> {
    if let Some(bad) = members.iter().find(|node| !(**node >= base && **node - base < points as f64)) {
        let expected = format!("nodes {base} to {}", points as f64 + base - 1.0);
        return Err(Diagnostic::new(format!("cell {cell}"), expected, bad));
    }
    let nodes_per_cell = Kind::of(kind.into()).map_or(members.len(), |kind| kind.nodes);
    let nodes = members[..nodes_per_cell].iter().map(|node| (*node - base) as u32);
    match blocks.iter_mut().find(|block| block.kind == kind) {
        Some(block) => block.nodes.extend(nodes),
        None => blocks.push(Block { kind, nodes_per_cell, nodes: nodes.collect() }),
    }
    Ok(())
}
