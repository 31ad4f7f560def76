//! The cubic between two points of a curve with known slopes, as of a pressure over a volume.

/// Halvings of a bisection: to the last digits of a number.
const HALVINGS: usize = 60;

/// Cubic through two points with their slopes.
#[derive(Clone, Copy, Debug)]
pub struct Cubic {
    /// Both ends of the interval.
    pub x: [f64; 2],
    /// The values there.
    pub y: [f64; 2],
    /// The derivatives there.
    pub slope: [f64; 2],
}

impl Cubic {
    /// Value and slope at a fraction of the interval.
    #[must_use]
    pub fn at(&self, fraction: f64) -> [f64; 2] {
        let (t, h) = (fraction, self.x[1] - self.x[0]);
        let [a, b] = self.slope.map(|slope| slope * h);
        let rise = self.y[1] - self.y[0];
        let (c, d) = (3.0 * rise - 2.0 * a - b, a + b - 2.0 * rise);
        [self.y[0] + t * (a + t * (c + t * d)), (a + t * (2.0 * c + 3.0 * t * d)) / h]
    }

    /// Fraction at which a component of [`Self::at`], or a difference from it, gets the sign that it has at the end.
    #[must_use]
    pub fn root(&self, component: impl Fn([f64; 2]) -> f64) -> f64 {
        let is_below_at_end = component(self.at(1.0)) < 0.0;
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if (component(self.at(middle)) < 0.0) == is_below_at_end { high = middle } else { low = middle }
        }
        0.5 * (low + high)
    }

    /// Abscissa at a fraction of the interval.
    #[must_use]
    pub fn x_at(&self, fraction: f64) -> f64 {
        self.x[0] + fraction * (self.x[1] - self.x[0])
    }
}
