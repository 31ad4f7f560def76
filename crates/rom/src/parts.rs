//! Which nodes of a mesh hang together.

use std::collections::BTreeMap;

/// Connected nodes, as union-find: each part has one of its nodes as root.
#[derive(Debug)]
pub struct Parts(Vec<u32>);

impl Parts {
    /// So many nodes, connected by elements that each name theirs.
    #[must_use]
    pub fn new<const N: usize>(nodes: usize, elements: &[[u32; N]]) -> Self {
        let mut parts = Self((0..nodes as u32).collect());
        for element in elements {
            let root = parts.root(element[0]);
            for node in &element[1..] {
                let other = parts.root(*node);
                parts.0[other as usize] = root;
            }
        }
        parts
    }

    /// The node that stands for the part of a node.
    pub fn root(&mut self, mut node: u32) -> u32 {
        while self.0[node as usize] != node {
            let above = self.0[self.0[node as usize] as usize];
            self.0[node as usize] = above;
            node = above;
        }
        node
    }
}

/// The facets of a surface by its parts.
#[must_use]
pub fn connected(facets: &[[u32; 3]], nodes: usize) -> Vec<Vec<[u32; 3]>> {
    let mut parts = Parts::new(nodes, facets);
    let mut facets_of: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    for facet in facets {
        facets_of.entry(parts.root(facet[0])).or_default().push(*facet);
    }
    facets_of.into_values().collect()
}
