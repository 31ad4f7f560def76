//! The volume of a regime's shapes as a form of the coefficients: see [`super::volume`], which makes it from the walls.

use serde::{Deserialize, Serialize};

/// The volume of a regime's shapes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Form {
    /// First coefficient and number of coefficients of x, y, z.
    pub(super) axes: [(usize, usize); 3],
    /// `t`, the index of z running fastest.
    pub(super) numbers: Vec<f64>,
    /// Area of the undeformed walls, mm2.
    pub(crate) area_mm2: f64,
}

impl Form {
    /// True if it fits a regime of `count` coefficients.
    pub(crate) fn fits(&self, count: usize) -> bool {
        let inside = self.axes.iter().all(|(first, own)| first.saturating_add(*own) <= count);
        let expected: usize = self.axes.iter().map(|(_, own)| own.saturating_add(1)).product();
        inside && self.numbers.len() == expected && self.numbers.iter().all(|v| v.is_finite())
    }

    /// The volume; with `change`, its derivative along that change of the coefficients. Allocates nothing.
    pub(crate) fn value(&self, coefficients: &[f64], change: Option<&[f64]>) -> f64 {
        let [x, y, z] = self.axes;
        let factor = |values: &[f64], (first, _): (usize, usize), i: usize, lead: f64| {
            i.checked_sub(1).map_or(lead, |i| values[first + i])
        };
        let (mut sum, mut rest) = (0.0, self.numbers.as_slice());
        for i in 0..=x.1 {
            for j in 0..=y.1 {
                let Some((row, behind)) = rest.split_at_checked(z.1 + 1) else { return f64::NAN };
                rest = behind;
                let along = |values: &[f64], lead: f64| -> f64 {
                    row[0] * lead + row[1..].iter().zip(&values[z.0..]).map(|(t, c)| t * c).sum::<f64>()
                };
                let (a, b) = (factor(coefficients, x, i, 1.0), factor(coefficients, y, j, 1.0));
                sum += match change {
                    None => a * b * along(coefficients, 1.0),
                    Some(change) => {
                        let inner = along(coefficients, 1.0);
                        factor(change, x, i, 0.0) * b * inner
                            + a * factor(change, y, j, 0.0) * inner
                            + a * b * along(change, 0.0)
                    }
                };
            }
        }
        sum
    }
}
