//! Nested dissection of the node graph by coordinate planes.
//!
//! Actuators are long and their chambers are joined by thin necks: a plane through a slot separates the body with far
//! fewer nodes than a minimum-degree ordering finds. Each part is cut across the axis and at the position whose
//! separator is smallest for its balance; all positions along an axis are rated in one sweep over the edges.

use crate::algebra::Vec3;

/// Parts of this size are not cut further.
const LEAF: usize = 8;

/// Neighbour lists of a symmetric graph (both directions).
pub(crate) type Graph = Vec<Vec<u32>>;

struct Dissection<'a> {
    graph: &'a Graph,
    points: &'a [Vec3],
    /// Position of each node in the current sweep; `usize::MAX` outside the current part.
    place: Vec<usize>,
}

/// Elimination order of the nodes: `order[k]` is the node eliminated k-th.
///
/// Cost: edges x log(nodes) x 3 axes.
pub(crate) fn nested_dissection(graph: &Graph, points: &[Vec3]) -> Vec<u32> {
    let mut dissection = Dissection { graph, points, place: vec![usize::MAX; graph.len()] };
    let mut order = Vec::with_capacity(graph.len());
    let all = (0..graph.len()).filter_map(|n| u32::try_from(n).ok()).collect();
    dissection.order(all, &mut order);
    order
}

impl Dissection<'_> {
    /// Appends the part's nodes: both halves, then the nodes that separate them.
    fn order(&mut self, part: Vec<u32>, order: &mut Vec<u32>) {
        if part.len() <= LEAF {
            order.extend(part);
            return;
        }
        let Some((sorted, cut)) = self.best_cut(&part) else {
            order.extend(part);
            return;
        };
        self.number(&sorted);
        let beyond = |this: &Self, n: u32| this.graph[n as usize].iter().any(|m| this.after(*m, cut));
        let (separator, left): (Vec<u32>, Vec<u32>) = sorted[..cut].iter().partition(|n| beyond(self, **n));
        let right = sorted[cut..].to_vec();
        self.forget(&sorted);
        self.order(left, order);
        self.order(right, order);
        order.extend(separator);
    }

    fn after(&self, n: u32, cut: usize) -> bool {
        let place = self.place[n as usize];
        place != usize::MAX && place >= cut
    }

    fn number(&mut self, sorted: &[u32]) {
        for (k, n) in sorted.iter().enumerate() {
            self.place[*n as usize] = k;
        }
    }

    fn forget(&mut self, sorted: &[u32]) {
        for n in sorted {
            self.place[*n as usize] = usize::MAX;
        }
    }

    /// The part sorted along the best direction and the number of nodes before the cut.
    fn best_cut(&mut self, part: &[u32]) -> Option<(Vec<u32>, usize)> {
        let mut best: Option<(f64, Vec<u32>, usize)> = None;
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut sorted = part.to_vec();
                sorted.sort_by(|a, b| {
                    let at = |n: u32| sign * self.points[n as usize][axis];
                    at(*a).total_cmp(&at(*b)).then(a.cmp(b))
                });
                self.number(&sorted);
                let (cost, cut) = self.rate(&sorted);
                self.forget(&sorted);
                if cost.is_finite() && best.as_ref().is_none_or(|(c, _, _)| cost < *c) {
                    best = Some((cost, sorted, cut));
                }
            }
        }
        best.map(|(_, sorted, cut)| (sorted, cut))
    }

    /// Cheapest cut of a numbered part: its cost and position.
    fn rate(&self, sorted: &[u32]) -> (f64, usize) {
        let n = sorted.len();
        // A node separates every cut between itself and its farthest neighbour.
        let mut change = vec![0_i64; n + 2];
        for (k, node) in sorted.iter().enumerate() {
            let places = self.graph[*node as usize].iter().map(|m| self.place[*m as usize]);
            let farthest = places.filter(|p| *p != usize::MAX).max().unwrap_or(k);
            if farthest > k {
                change[k + 1] += 1;
                change[farthest + 1] -= 1;
            }
        }
        let mut best = (f64::INFINITY, 0);
        let mut separator = 0_i64;
        for (cut, change) in change.into_iter().enumerate().take(n).skip(1) {
            separator += change;
            let (left, right) = ((cut as i64 - separator) as f64, (n - cut) as f64);
            let smaller = left.min(right);
            if smaller < 0.2 * n as f64 {
                continue;
            }
            // The separator's dense factor against the work saved by balanced halves.
            let cost = separator as f64 * (1.0 + (left.max(right) / n as f64 - 0.5));
            if cost < best.0 {
                best = (cost, cut);
            }
        }
        best
    }
}
