//! From Ansys' elements to cells: a tetrahedron, a wedge or a pyramid is a hexahedron with nodes that occur several times.

/// What was expected, and what was found.
type Wrong = (String, String);

/// What an element is by its name's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    /// 8 corners, and 12 mid-sides that may be missing.
    Brick(usize),
    /// 4 corners, and 6 mid-sides that may be missing.
    Tetrahedron(usize),
    /// 4 corners, and 4 mid-sides that may be missing.
    Shell(usize),
    /// No body: points, springs, trusses, beams, contact, surface loads, hydrostatic fluid, reinforcement.
    Other,
}

impl Family {
    pub(super) fn of(name: u64) -> Option<Self> {
        Some(match name {
            5 | 45 | 46 | 64 | 65 | 185 | 190 | 215 | 278 => Self::Brick(8),
            95 | 186 | 216 | 226 | 279 => Self::Brick(20),
            285 => Self::Tetrahedron(4),
            92 | 98 | 187 | 217 | 227 | 291 => Self::Tetrahedron(10),
            41 | 43 | 63 | 143 | 181 => Self::Shell(4),
            91 | 93 | 99 | 281 => Self::Shell(8),
            3
            | 4
            | 7
            | 8
            | 10..=12
            | 14
            | 16
            | 18
            | 20
            | 21
            | 23
            | 24
            | 27
            | 37
            | 39
            | 40
            | 44
            | 50
            | 54
            | 59..=61 => Self::Other,
            151..=156 | 160 | 161 | 165..=167 | 169..=180 | 184 | 188 | 189 | 192..=205 | 214 | 241 | 242 => {
                Self::Other
            }
            250 | 251 | 263..=265 | 288..=290 => Self::Other,
            _ => return None,
        })
    }

    /// Nodes of an element with all its mid-sides; `None` where that depends.
    pub(super) fn nodes(self) -> Option<usize> {
        match self {
            Self::Brick(nodes) | Self::Tetrahedron(nodes) | Self::Shell(nodes) => Some(nodes),
            Self::Other => None,
        }
    }
}

/// A shape by places in the element: corners and mid-sides in VTK's order, and which corners are one.
struct Shape {
    linear: u8,
    quadratic: u8,
    corners: &'static [usize],
    middles: &'static [usize],
    /// Places with the same node.
    same: &'static [&'static [usize]],
}

const fn shape(
    kinds: [u8; 2],
    corners: &'static [usize],
    middles: &'static [usize],
    same: &'static [&'static [usize]],
) -> Shape {
    Shape { linear: kinds[0], quadratic: kinds[1], corners, middles, same }
}

/// Places I to P are 0 to 7, Q to B 8 to 19. What collapses most comes first.
const BRICKS: [Shape; 4] = [
    shape([10, 24], &[0, 1, 2, 4], &[8, 9, 11, 16, 17, 18], &[&[2, 3], &[4, 5, 6, 7]]),
    shape([13, 26], &[0, 1, 2, 4, 5, 6], &[8, 9, 11, 12, 13, 15, 16, 17, 18], &[&[2, 3], &[6, 7]]),
    shape([14, 27], &[0, 1, 2, 3, 4], &[8, 9, 10, 11, 16, 17, 18, 19], &[&[4, 5, 6, 7]]),
    shape([12, 25], &[0, 1, 2, 3, 4, 5, 6, 7], &[8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19], &[]),
];
const TETRAHEDRA: [Shape; 1] = [shape([10, 24], &[0, 1, 2, 3], &[4, 5, 6, 7, 8, 9], &[])];
const SHELLS: [Shape; 2] =
    [shape([5, 22], &[0, 1, 2], &[4, 5, 7], &[&[2, 3]]), shape([9, 23], &[0, 1, 2, 3], &[4, 5, 6, 7], &[])];

/// VTK's number of the cell and its nodes; `None` for elements without a body. Node 0 is a mid-side that is missing.
pub(super) fn cell(family: Family, nodes: &[u64]) -> Result<Option<(u8, Vec<u64>)>, Wrong> {
    let (corners, most, shapes): (usize, usize, &[Shape]) = match family {
        // A tetrahedron may be written like a collapsed brick.
        Family::Brick(most) => (8, most, &BRICKS),
        Family::Tetrahedron(4) if nodes.len() == 8 => (8, 8, &BRICKS),
        Family::Tetrahedron(most) => (4, most, &TETRAHEDRA),
        Family::Shell(most) => (4, most, &SHELLS),
        Family::Other => return Ok(None),
    };
    if nodes.len() < corners || nodes.len() > most {
        return Err((format!("{corners} to {most} nodes"), nodes.len().to_string()));
    }
    let fits =
        |shape: &&Shape| shape.same.iter().all(|same| same.iter().all(|at| nodes[*at] == nodes[same[0]]));
    let Some(shape) = shapes.iter().find(fits) else {
        return Err(("a hexahedron".into(), format!("nodes {nodes:?}")));
    };
    let all =
        |places: &[usize]| places.iter().map(|at| nodes.get(*at).copied().unwrap_or(0)).collect::<Vec<_>>();
    let (mut cell, middles) = (all(shape.corners), all(shape.middles));
    if cell.iter().enumerate().any(|(at, node)| *node == 0 || cell[..at].contains(node)) {
        let expected = "corners that differ, or collapse to a wedge (K=L, O=P), a pyramid (M=N=O=P) or both";
        return Err((expected.into(), format!("nodes {nodes:?}")));
    }
    match middles.iter().filter(|node| **node == 0).count() {
        0 => cell.extend(middles),
        missing if missing == middles.len() => return Ok(Some((shape.linear, cell))),
        missing => {
            let expected = "all mid-side nodes or none (EMID,ADD adds them before the solution)";
            return Err((expected.into(), format!("{missing} of {} missing", middles.len())));
        }
    }
    Ok(Some((shape.quadratic, cell)))
}
