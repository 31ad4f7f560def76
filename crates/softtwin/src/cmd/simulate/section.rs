//! Bending angle: rotation of the end section.

use fem::Problem;

/// Distance from the largest x within which a node belongs to the end section (mm).
const END_MM: f64 = 0.01;

/// Lowest and highest node of the end face.
pub struct EndSection([usize; 2]);

impl EndSection {
    /// `None` where all nodes of the end have one height.
    pub fn of(problem: &Problem) -> Option<Self> {
        let nodes = &problem.mesh().nodes_mm;
        let end_mm = nodes.iter().map(|x| x[0]).fold(f64::NEG_INFINITY, f64::max) - END_MM;
        let face = || nodes.iter().enumerate().filter(|(_, x)| x[0] >= end_mm);
        let by_height = |a: &(usize, &[f64; 3]), b: &(usize, &[f64; 3])| a.1[1].total_cmp(&b.1[1]);
        let (low, high) = (face().min_by(by_height)?, face().max_by(by_height)?);
        (high.1[1] - low.1[1] > END_MM).then_some(Self([low.0, high.0]))
    }

    /// Rotation of the section about -z from the undeformed state, degrees: the one of its turns that is nearest to `near`.
    pub fn angle_deg(&self, problem: &Problem, u: &[[f64; 3]], near: f64) -> f64 {
        let along = |moved: bool| {
            let [low, high] = self.0.map(|n| {
                let x = problem.mesh().nodes_mm[n];
                if moved { [x[0] + u[n][0], x[1] + u[n][1]] } else { [x[0], x[1]] }
            });
            (high[0] - low[0]).atan2(high[1] - low[1])
        };
        let angle = (along(true) - along(false)).to_degrees();
        angle + 360.0 * ((near - angle) / 360.0).round()
    }
}
