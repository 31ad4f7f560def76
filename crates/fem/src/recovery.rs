//! Von Mises stress from positions alone: the deviatoric Cauchy stress follows from the deformation gradient and the
//! material's law, without the elements' pressures.

use crate::element::tet10;
use crate::problem::Problem;
use std::sync::Arc;

/// Position of a node that is not selected.
const UNWANTED: u32 = u32::MAX;

/// Recovery of the stress at selected nodes of a problem, as [`Output::von_mises_mpa`](crate::Output::von_mises_mpa) defines it: the mean over the
/// elements at a node.
#[derive(Clone, Debug)]
pub struct StressRecovery {
    problem: Arc<Problem>,
    elements: Vec<Element>,
    needed: Vec<u32>,
    /// Elements at each selected node.
    counts: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Element {
    number: usize,
    /// Positions of its nodes among the needed and among the selected ones.
    nodes: [[u32; 2]; 10],
}

impl StressRecovery {
    /// Selects these nodes, each below the mesh's number of nodes; all nodes if the list is empty. Cost: `O(elements)`.
    pub fn new(problem: Arc<Problem>, nodes: Option<&[u32]>) -> Self {
        let count = problem.mesh().nodes_mm.len();
        let all: Vec<u32> = (0..count as u32).collect();
        let wanted = nodes.unwrap_or(&all);
        let mut slots = vec![UNWANTED; count];
        wanted.iter().zip(0..).for_each(|(node, slot)| slots[*node as usize] = slot);
        let touches = |tet: &&[u32; 10]| tet.iter().any(|n| slots[*n as usize] != UNWANTED);
        let mut needed: Vec<u32> = problem.mesh().tets.iter().filter(touches).flatten().copied().collect();
        needed.sort_unstable();
        needed.dedup();
        let mut places = vec![UNWANTED; count];
        needed.iter().zip(0..).for_each(|(node, place)| places[*node as usize] = place);
        let mut counts = vec![0.0; wanted.len()];
        let tets = problem.mesh().tets.iter().enumerate().filter(|(_, tet)| touches(tet));
        let element = |(number, tet): (usize, &[u32; 10])| {
            let nodes = tet.map(|n| [places[n as usize], slots[n as usize]]);
            nodes
                .iter()
                .filter(|[_, slot]| *slot != UNWANTED)
                .for_each(|[_, slot]| counts[*slot as usize] += 1.0);
            Element { number, nodes }
        };
        let elements = tets.map(element).collect();
        Self { elements, needed, counts, problem }
    }

    /// Nodes with required positions, in ascending order: those of all elements at the selected nodes.
    pub fn needed(&self) -> &[u32] {
        &self.needed
    }

    /// Writes the stress (MPa) at the selected nodes; NaN if an element has collapsed or is beyond its law. `positions_mm` are
    /// the deformed positions of the nodes [`Self::needed`]; an error of 1e-5 mm causes about 1e-4 MPa. Does not allocate.
    ///
    /// # Panics
    /// If a slice is shorter than its nodes.
    pub fn evaluate(&self, positions_mm: &[[f64; 3]], out: &mut [f64]) {
        out[..self.counts.len()].fill(0.0);
        let rest = &self.problem.mesh().nodes_mm;
        for element in &self.elements {
            let u = element.nodes.map(|[place, _]| {
                let (x, x0) = (positions_mm[place as usize], rest[self.needed[place as usize] as usize]);
                [x[0] - x0[0], x[1] - x0[1], x[2] - x0[2]]
            });
            let law = &self.problem.elastomer(element.number).law;
            let stress = tet10::deviatoric_stress(&self.problem.tets[element.number], &u, law);
            let values = tet10::extrapolate(stress.unwrap_or([[f64::NAN; 6]; 4]));
            for ([_, slot], value) in element.nodes.iter().zip(values) {
                if *slot != UNWANTED {
                    out[*slot as usize] += tet10::von_mises(value);
                }
            }
        }
        out.iter_mut().zip(&self.counts).for_each(|(sum, count)| *sum /= count);
    }
}
