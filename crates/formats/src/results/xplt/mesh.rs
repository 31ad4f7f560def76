//! The mesh of FEBio's plot file: nodes, and domains of one kind of element each.

use super::blocks::Bytes;
use crate::cells::{Block, Kind};
use crate::error::Diagnostic;

const NODE_SECTION: u32 = 0x0104_1000;
const NODE_HEADER: u32 = 0x0104_1100;
const NODE_SIZE: u32 = 0x0104_1101;
const NODE_DIMENSION: u32 = 0x0104_1102;
const NODE_COORDINATES: u32 = 0x0104_1200;
const DOMAIN_SECTION: u32 = 0x0104_2000;
const DOMAIN: u32 = 0x0104_2100;
const DOMAIN_HEADER: u32 = 0x0104_2101;
const ELEMENT_TYPE: u32 = 0x0104_2102;
const ELEMENT_LIST: u32 = 0x0104_2200;
const ELEMENT: u32 = 0x0104_2201;

/// Name of an element type by its number, its nodes, and VTK's number of the cell that is made of its first nodes (those within
/// faces and cell come last): 0 for elements without a surface, which are passed over.
const ELEMENTS: [(&str, usize, Option<u8>); 20] = [
    ("hex8", 8, Some(12)),
    ("penta6", 6, Some(13)),
    ("tet4", 4, Some(10)),
    ("quad4", 4, Some(9)),
    ("tri3", 3, Some(5)),
    ("truss2", 2, Some(0)),
    ("hex20", 20, Some(25)),
    ("tet10", 10, Some(24)),
    ("tet15", 15, Some(24)),
    ("hex27", 27, Some(25)),
    ("tri6", 6, Some(22)),
    ("quad8", 8, Some(23)),
    ("quad9", 9, Some(23)),
    ("penta15", 15, Some(26)),
    ("tet20", 20, None),
    ("tri10", 10, None),
    ("pyra5", 5, Some(14)),
    ("tet5", 5, Some(10)),
    ("pyra13", 13, Some(27)),
    ("line3", 3, Some(0)),
];

/// Elements of one kind.
#[derive(Debug)]
pub(super) struct Domain {
    /// Nodes an element.
    pub(super) size: usize,
    /// `elements x size`.
    pub(super) nodes: Vec<u32>,
    /// Each node once, in the order in which the elements name them.
    pub(super) distinct: Vec<u32>,
}

/// The mesh as it is before the first state.
#[derive(Debug, Default)]
pub(super) struct Mesh {
    pub(super) points: Vec<[f64; 3]>,
    pub(super) blocks: Vec<Block>,
    /// All domains, by which data are given.
    pub(super) domains: Vec<Domain>,
    /// The last domain that names each node, counted from 1.
    named_by: Vec<u32>,
}

/// Reads the section of the mesh.
pub(super) fn read(section: Bytes<'_>) -> Result<Mesh, Diagnostic> {
    let part = |id, name: &str| {
        section.block(id)?.ok_or_else(|| Diagnostic::new("mesh", format!("a section of {name}"), "none"))
    };
    let points = points(part(NODE_SECTION, "nodes")?)?;
    let mut mesh = Mesh { named_by: vec![0; points.len()], points, ..Mesh::default() };
    for (id, domain) in part(DOMAIN_SECTION, "domains")?.blocks()? {
        if id == DOMAIN {
            mesh.domain(domain)?;
        }
    }
    Ok(mesh)
}

fn points(section: Bytes<'_>) -> Result<Vec<[f64; 3]>, Diagnostic> {
    let wrong = |expected: &str, found: String| Diagnostic::new("mesh, nodes", expected, found);
    let (header, data) = (section.block(NODE_HEADER)?, section.block(NODE_COORDINATES)?);
    let (Some(header), Some(data)) = (header, data) else {
        return Err(wrong("a header and coordinates", "one of them missing".into()));
    };
    let value = |id| Ok(header.block(id)?.and_then(Bytes::first).map(|value| value as usize));
    let (count, dimension) = (value(NODE_SIZE)?.unwrap_or(0), value(NODE_DIMENSION)?.unwrap_or(3));
    // The number of the node stands before its coordinates; versions before 3.2 leave it out.
    let words = data.data.len() / 4;
    let first = match words.checked_div(count) {
        Some(4) if count * 4 == words => 1,
        Some(3) if count * 3 == words => 0,
        _ => return Err(wrong(&format!("{count} nodes of 3 coordinates"), format!("{words} numbers"))),
    };
    if dimension != 3 {
        return Err(wrong("3 coordinates a node", format!("{dimension}")));
    }
    let numbers: Vec<f64> = data.floats().collect();
    let points: Vec<[f64; 3]> =
        numbers.chunks_exact(first + 3).map(|node| [node[first], node[first + 1], node[first + 2]]).collect();
    match points.iter().position(|point| point.iter().any(|value| !value.is_finite())) {
        Some(bad) => Err(wrong("finite coordinates", format!("others at node {}", bad + 1))),
        None => Ok(points),
    }
}

impl Mesh {
    fn domain(&mut self, domain: Bytes<'_>) -> Result<(), Diagnostic> {
        let place = format!("mesh, domain {}", self.domains.len() + 1);
        let wrong = |expected: &str, found: String| Diagnostic::new(&place, expected, found);
        let header = domain.block(DOMAIN_HEADER)?.ok_or_else(|| wrong("a header", "none".into()))?;
        let number = header.block(ELEMENT_TYPE)?.and_then(Bytes::first);
        let known = number.and_then(|number| ELEMENTS.get(number as usize));
        let Some((name, size, kind)) = known else {
            return Err(wrong("a type of element from 0 to 19", format!("{number:?}")));
        };
        let Some(kind) = kind else {
            let expected = "tet4, tet5, tet10, tet15, hex8, hex20, hex27, penta6, penta15, pyra5, pyra13, or shells and trusses beside them";
            return Err(wrong(expected, format!("elements {name}")));
        };
        let mut nodes = Vec::new();
        for (id, element) in domain.block(ELEMENT_LIST)?.map_or_else(|| Ok(Vec::new()), Bytes::blocks)? {
            // The element's own number comes first.
            let members: Vec<u32> = element.words().skip(1).collect();
            let bad = members.iter().find(|node| **node as usize >= self.points.len());
            if id != ELEMENT || members.len() != *size || bad.is_some() {
                let expected = format!("elements of {size} nodes, each below {}", self.points.len());
                let found = bad.map_or(format!("{} nodes", members.len()), |node| format!("node {node}"));
                return Err(wrong(&expected, found));
            }
            nodes.extend(members);
        }
        let number = self.domains.len() as u32 + 1;
        let is_first = |node: &u32| std::mem::replace(&mut self.named_by[*node as usize], number) != number;
        let distinct = nodes.iter().copied().filter(is_first).collect();
        if let Some(kind) = Kind::of((*kind).into()) {
            if let Some(at) =
                nodes.chunks_exact(*size).position(|cell| (1..*size).any(|k| cell[..k].contains(&cell[k])))
            {
                let expected = "elements whose nodes differ (collapsed ones: File > Export > VTK in FEBio Studio makes what they are)";
                return Err(wrong(
                    expected,
                    format!("a node several times in element {} of the domain", at + 1),
                ));
            }
            let cells = nodes.chunks_exact(*size).flat_map(|cell| &cell[..kind.nodes]).copied();
            match self.blocks.iter_mut().find(|block| block.kind == kind.number) {
                Some(block) => block.nodes.extend(cells),
                None => self.blocks.push(Block {
                    kind: kind.number,
                    nodes_per_cell: kind.nodes,
                    nodes: cells.collect(),
                }),
            }
        }
        self.domains.push(Domain { size: *size, nodes, distinct });
        Ok(())
    }
}
