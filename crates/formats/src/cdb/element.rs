//! Elements as the lines of an `EBLOCK` give them.

use super::shape::{self, Family};
use std::collections::HashMap;

/// What was expected, and what was found.
type Wrong = (String, String);

/// Whole numbers before the nodes with SOLID: material, type, real constants, section, coordinate system, birth, reference,
/// shape, number of nodes, nothing, number of the element.
const BEFORE_SOLID: usize = 11;
/// And without: number of the element, section, real constants, material, coordinate system.
const BEFORE: usize = 5;
/// More nodes than an element of that program has.
const MAX_NODES: u64 = 200;

/// Which element each type is.
#[derive(Default)]
pub(super) struct Types {
    /// The number in the name (186 of SOLID186) by the number of the type.
    names: HashMap<u64, u64>,
    /// What the last `TYPE` says, for blocks without SOLID.
    pub(super) chosen: Option<u64>,
}

impl Types {
    pub(super) fn insert(&mut self, number: u64, name: u64) {
        self.names.insert(number, name);
    }
}

/// An element, complete or with further lines to come.
pub(super) struct Begun {
    /// Its number.
    pub(super) label: u64,
    type_number: u64,
    /// Nodes that it is to have.
    count: usize,
    /// 0 where there is none.
    nodes: Vec<u64>,
}

impl Begun {
    /// From its first line.
    pub(super) fn first(numbers: &[u64], is_solid: bool, types: &Types) -> Result<Self, Wrong> {
        let before = if is_solid { BEFORE_SOLID } else { BEFORE };
        let Some((head, nodes)) = numbers.split_at_checked(before) else {
            return Err((
                format!("{before} whole numbers, then nodes"),
                format!("{} numbers", numbers.len()),
            ));
        };
        // The element and the type are named in other columns; without SOLID the type may be the last command's.
        let (label, type_number, count) = if is_solid {
            (head[10], head[1], head[8])
        } else {
            let number = types.chosen.unwrap_or(head[1]);
            let family = types.names.get(&number).and_then(|name| Family::of(*name));
            (head[0], number, family.and_then(Family::nodes).unwrap_or(nodes.len()) as u64)
        };
        if count > MAX_NODES {
            return Err((format!("at most {MAX_NODES} nodes of element {label}"), count.to_string()));
        }
        Ok(Self { label, type_number, count: count as usize, nodes: nodes.to_vec() })
    }

    /// With the nodes of its next line.
    pub(super) fn further(mut self, numbers: &[u64]) -> Self {
        self.nodes.extend(numbers);
        self
    }

    pub(super) fn is_whole(&self) -> bool {
        self.nodes.len() >= self.count
    }

    pub(super) fn expected(&self) -> String {
        format!("{} nodes of element {}", self.count, self.label)
    }

    /// VTK's number of the cell and its nodes; `None` for elements without a body.
    pub(super) fn cell(&self, types: &Types) -> Result<Option<(u8, Vec<u64>)>, Wrong> {
        let Some(name) = types.names.get(&self.type_number).copied() else {
            return Err(("a type that ET names".into(), format!("type {}", self.type_number)));
        };
        let Some(family) = Family::of(name) else {
            let expected =
                "solids (SOLID185, SOLID186, SOLID187, SOLID285, ...) or shells (SHELL181, SHELL281)";
            return Err((expected.into(), format!("element type {name}")));
        };
        shape::cell(family, &self.nodes[..self.count])
    }
}
