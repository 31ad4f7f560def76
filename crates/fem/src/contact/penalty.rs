//! A smoothed linear penalty.

/// Energy, force and stiffness of a penalty of unit stiffness at an overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Penalty {
    /// Energy per stiffness (mm2).
    pub(crate) energy: f64,
    /// Force per stiffness (mm).
    pub(crate) force: f64,
    /// Tangent per stiffness.
    pub(crate) stiffness: f64,
}

/// A linear penalty on the overlap `d`, rounded by a parabola over `-w <= d <= w` so that its tangent is continuous.
#[inline]
pub(crate) fn penalty(d: f64, w: f64) -> Penalty {
    if d <= -w {
        Penalty { energy: 0.0, force: 0.0, stiffness: 0.0 }
    } else if d >= w {
        Penalty { energy: 0.5 * d * d + w * w / 6.0, force: d, stiffness: 1.0 }
    } else {
        let t = d + w;
        Penalty { energy: t * t * t / (12.0 * w), force: t * t / (4.0 * w), stiffness: t / (2.0 * w) }
    }
}
