//! Parallel projection: directions of the eye and the window that is drawn.

/// A point or direction, mm.
pub type Vec3 = [f32; 3];

/// Scalar product.
pub fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a - b`.
pub fn minus(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Length one; the zero vector stays what it is.
pub fn unit(a: Vec3) -> Vec3 {
    let length = dot(a, a).sqrt();
    if length > 0.0 { a.map(|v| v / length) } else { a }
}

/// Where the eye stands, far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// To the right on the picture.
    pub right: Vec3,
    /// Up on the picture.
    pub up: Vec3,
    /// From the scene to the eye.
    pub toward: Vec3,
}

impl Camera {
    /// Looks at the scene from `azimuth_deg` around the vertical (0: from +z, the actuator's side, its fixed end at the
    /// left) and `elevation_deg` above the horizon.
    pub fn new(azimuth_deg: f32, elevation_deg: f32) -> Self {
        let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
        let toward = [azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos()];
        let right = [azimuth.cos(), 0.0, -azimuth.sin()];
        Self { right, up: cross(toward, right), toward }
    }

    /// Place on the picture plane (mm right, mm up) and nearness to the eye (mm).
    pub fn project(&self, point: Vec3) -> Vec3 {
        [dot(self.right, point), dot(self.up, point), dot(self.toward, point)]
    }
}

/// The rectangle of the picture plane that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Its middle, mm right and up.
    pub centre_mm: [f32; 2],
    /// Size of a pixel.
    pub mm_per_px: f32,
}

impl Window {
    /// The smallest window of the given pixels around all points, with a margin as a fraction of the size.
    pub fn around(
        camera: &Camera,
        points: impl Iterator<Item = Vec3>,
        pixels: [usize; 2],
        margin: f32,
    ) -> Self {
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        for point in points.map(|p| camera.project(p)).filter(|p| p.iter().all(|v| v.is_finite())) {
            for k in 0..2 {
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        let scale = |k: usize| (high[k] - low[k]).max(1e-3) * (1.0 + 2.0 * margin) / pixels[k].max(1) as f32;
        Self {
            centre_mm: std::array::from_fn(|k| 0.5 * (low[k] + high[k])),
            mm_per_px: scale(0).max(scale(1)),
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/camera.rs"]
mod tests;
