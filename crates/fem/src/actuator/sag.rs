//! Sag under the actuator's weight by beam theory, before any mesh.
//!
//! Clamped elastica: `EI(s) theta'(s) = integral_s^L q(t) (x(t) - x(s)) dt` with the weight `q` per length and `E = 3 mu`. The sheet does not
//! stretch: second moments are about its plane. Ridges between slots carry no tension: above the slots' floor nothing counts. Shear is left
//! out. The reference actuator: 33.2 mm, finite elements 27.5 mm.

use super::boxes::{Bounds, Boxes, Row};
use super::file::{Actuator, Fixed, Shape};

/// Sections along the beam.
const SECTIONS: usize = 400;
/// Most iterations of the shape under which the lever arms are taken; about 10 per radian of the straight beam's angle are needed.
const ITERATIONS: usize = 100_000;
/// Change of the angles at which they end.
const CONVERGED_RAD: f64 = 1e-6;

impl Actuator {
    /// Estimated tip displacement (mm) across the base under gravity along y, with elastomers `factor` times as stiff. `None`
    /// without boxes, with a second row, or held elsewhere than at the start.
    pub fn sag_estimate_mm(&self, factor: f64) -> Option<f64> {
        let shape = self.shape()?;
        let is_beam =
            shape.chambers.opposite.is_none() && matches!(shape.fixed, Fixed::BodyStart | Fixed::BaseStart);
        if !is_beam {
            return None;
        }
        let gravity = -self.loads.gravity_mm_s2[1];
        let start = shape.base.length_mm - shape.free_mm();
        let boxes = Boxes::of(&shape);
        let step = (shape.base.length_mm - start) / SECTIONS as f64;
        let youngs = 3.0 * factor * self.elastomer.law.shear_modulus_mpa();
        let sections: Vec<[f64; 2]> =
            (0..SECTIONS).map(|k| shape.section(&boxes, start + (k as f64 + 0.5) * step)).collect();
        let weight: Vec<f64> = sections
            .iter()
            .map(|[area, _]| self.elastomer.density_t_per_mm3 * gravity * area * step)
            .collect();
        let mut angle = vec![0.0_f64; SECTIONS];
        let mut relaxation = 1.0;
        for iteration in 0..ITERATIONS {
            // From the tip: force beyond a section, and its moment.
            let (mut force, mut moment) = (0.0, 0.0);
            let mut curvature = vec![0.0; SECTIONS];
            for k in (0..SECTIONS).rev() {
                let along = step * angle[k].cos();
                moment += force * along + 0.5 * weight[k] * along;
                force += weight[k];
                curvature[k] = moment / (youngs * sections[k][1]);
            }
            if iteration == 0 {
                // The slopes of the iteration are real, between 0 and minus the angle of the straight beam's load: it converges for any softness.
                relaxation = 2.0 / (2.0 + step * curvature.iter().sum::<f64>());
            }
            let (mut next, mut change) = (0.0, 0.0_f64);
            for k in 0..SECTIONS {
                next += curvature[k] * step;
                let by = relaxation * (next - angle[k]);
                angle[k] += by;
                change = change.max(by.abs());
            }
            if change < CONVERGED_RAD * relaxation {
                break;
            }
        }
        Some(angle.iter().map(|angle| step * angle.sin()).sum())
    }
}

impl Shape<'_> {
    /// Area (mm2) and second moment about the sheet (mm4) of the section at `x`.
    fn section(&self, boxes: &Boxes, x: f64) -> [f64; 2] {
        let part = |[_, [low, high], [left, right]]: &Bounds| {
            let floor = self.slots.map_or(f64::INFINITY, |slots| slots.floor_mm);
            let about = |y: f64| (y.min(floor) - self.base.lower_mm).powi(3) / 3.0;
            [(right - left) * (high - low), (right - left) * (about(*high) - about(*low))]
        };
        let is_at = |bounds: &&Bounds| (bounds[0][0]..bounds[0][1]).contains(&x);
        let sum = |parts: &mut dyn Iterator<Item = &Bounds>| {
            parts.filter(is_at).map(part).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
        };
        let [(_, lower), (_, upper), (_, body), ..] = boxes.solids[..] else { return [f64::NAN; 2] };
        // The pocket belongs to the base and to the body.
        let above = [body[0], [self.base_top_mm(), body[1][1]], body[2]];
        let solid = sum(&mut [lower, upper, above].iter());
        let cut = sum(&mut boxes.rows.iter().flat_map(Row::cuts));
        [solid[0] - cut[0], solid[1] - cut[1]]
    }
}
