//! Places of nodes: local systems, instances, and cylindrical and spherical coordinates.

use rom::vector::{cross, dot, sub};

/// Rotation, by rows, and translation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub(super) rows: [[f64; 3]; 3],
    shift: [f64; 3],
}

impl Placement {
    pub(super) const IDENTITY: Self =
        Self { rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], shift: [0.0; 3] };

    pub(super) fn apply(&self, x: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| dot(self.rows[i], x) + self.shift[i])
    }

    /// `*SYSTEM`: origin a, b on the local x axis, c in the local xy plane; without c the z axis stays.
    /// Coordinates left out are zero.
    pub(super) fn system(lines: &[Vec<f64>]) -> Option<Self> {
        let (first, second) = match lines {
            [] => return Some(Self::IDENTITY),
            [first] => (first, None),
            [first, second] => (first, Some(second)),
            _ => return None,
        };
        let a = padded(first.get(..3).unwrap_or(first))?;
        let Some(b) = first.get(3..).filter(|rest| !rest.is_empty()) else {
            return second.is_none().then_some(Self { shift: a, ..Self::IDENTITY });
        };
        let x = unit(sub(padded(b)?, a))?;
        let z = match second {
            Some(c) => unit(cross(x, sub(padded(c)?, a)))?,
            None if x[2] == 0.0 => [0.0, 0.0, 1.0],
            None => return None,
        };
        let axes = [x, cross(z, x), z];
        Some(Self { rows: [0, 1, 2].map(|i| [0, 1, 2].map(|k| axes[k][i])), shift: a })
    }

    /// `*INSTANCE`: translation, then a rotation by an angle in degrees about the axis from a to b.
    pub(super) fn instance(lines: &[Vec<f64>]) -> Option<Self> {
        let (shift, line) = match lines {
            [] => return Some(Self::IDENTITY),
            [shift] => return Some(Self { shift: padded(shift)?, ..Self::IDENTITY }),
            [shift, line] => (padded(shift)?, line),
            _ => return None,
        };
        let &[ax, ay, az, bx, by, bz, degrees] = line.as_slice() else { return None };
        let a = [ax, ay, az];
        let axis = unit(sub([bx, by, bz], a))?;
        let (sin, cos) = degrees.to_radians().sin_cos();
        let rotate = |x: [f64; 3]| {
            let across = cross(axis, x);
            [0, 1, 2].map(|i| x[i] * cos + across[i] * sin + axis[i] * dot(axis, x) * (1.0 - cos))
        };
        let columns = Self::IDENTITY.rows.map(rotate);
        let moved = rotate(sub(shift, a));
        Some(Self {
            rows: [0, 1, 2].map(|i| columns.map(|column| column[i])),
            shift: [0, 1, 2].map(|i| moved[i] + a[i]),
        })
    }
}

/// Up to three coordinates; those left out are zero.
fn padded(values: &[f64]) -> Option<[f64; 3]> {
    let value = |k: usize| values.get(k).copied().unwrap_or(0.0);
    (values.len() <= 3).then(|| [0, 1, 2].map(value))
}

fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|v| v / length))
}

/// Coordinates of a node line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coordinates {
    Rectangular,
    /// Radius, angle in degrees, z.
    Cylindrical,
    /// Radius, longitude and latitude in degrees.
    Spherical,
}

impl Coordinates {
    pub(super) fn rectangular(self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        let ((sin, cos), (up, across)) = (b.to_radians().sin_cos(), c.to_radians().sin_cos());
        match self {
            Self::Rectangular => [a, b, c],
            Self::Cylindrical => [a * cos, a * sin, c],
            Self::Spherical => [a * cos * across, a * sin * across, a * up],
        }
    }
}
