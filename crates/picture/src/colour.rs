//! Colour maps from a formula: stops in OKLab's cylindrical form, in which equal steps look equally large.
//!
//! A stop is (position, lightness L, chroma C, hue h in degrees); between stops all three are linear. Colour is then
//! `a = C cos h`, `b = C sin h`, `(l, m, s) = (M (L, a, b))^3`, linear RGB = N (l, m, s), with the published matrices
//! M and N of OKLab. The lightness of `stress` grows strictly, so it can be read in grey and by colour-blind people.

/// One stop of a map: position in 0 ..= 1, lightness, chroma, hue in degrees.
type Stop = (f32, f32, f32, f32);

const STRESS: &[Stop] = &[
    (0.0, 0.38, 0.14, 285.0),
    (0.25, 0.52, 0.125, 250.0),
    (0.5, 0.66, 0.115, 190.0),
    (0.75, 0.80, 0.175, 138.0),
    (1.0, 0.94, 0.185, 106.0),
];
/// Two hues at the middle: the chroma is zero there, so nothing jumps.
const DIVERGING: &[Stop] = &[
    (0.0, 0.42, 0.15, 262.0),
    (0.25, 0.66, 0.12, 250.0),
    (0.5, 0.95, 0.0, 250.0),
    (0.5, 0.95, 0.0, 45.0),
    (0.75, 0.68, 0.14, 42.0),
    (1.0, 0.46, 0.17, 25.0),
];

/// Entries of a map's table.
pub const ENTRIES: usize = 256;

/// A map as a table of linear-light colours.
#[derive(Clone, Debug)]
pub struct ColourMap {
    table: Vec<[f32; 3]>,
}

impl ColourMap {
    /// Violet over teal to yellow: for stress and displacement.
    pub fn stress() -> Self {
        Self::of(STRESS)
    }

    /// Blue over white to red: for signed quantities.
    pub fn diverging() -> Self {
        Self::of(DIVERGING)
    }

    fn of(stops: &[Stop]) -> Self {
        let entry = |k: usize| oklab_to_linear(at(stops, k as f32 / (ENTRIES - 1) as f32));
        Self { table: (0..ENTRIES).map(entry).collect() }
    }

    /// The colour at `t`, linear light; `t` is cut to 0 ..= 1, not-a-number is mid grey.
    pub fn linear(&self, t: f32) -> [f32; 3] {
        if t.is_nan() {
            return [0.2; 3];
        }
        let place = t.clamp(0.0, 1.0) * (ENTRIES - 1) as f32;
        let below = (place as usize).min(ENTRIES - 2);
        let share = place - below as f32;
        let (a, b) = (self.table[below], self.table[below + 1]);
        std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share)
    }

    /// The colour at `t` as sRGB bytes.
    pub fn srgb(&self, t: f32) -> [u8; 3] {
        self.linear(t).map(encode)
    }
}

/// L, a, b of a map at `t`.
fn at(stops: &[Stop], t: f32) -> [f32; 3] {
    let next = stops.iter().position(|s| s.0 >= t && s.0 > 0.0).unwrap_or(stops.len() - 1);
    let (from, to) = (stops[next - 1], stops[next]);
    let share = if to.0 > from.0 { (t - from.0) / (to.0 - from.0) } else { 0.0 };
    let mix = |a: f32, b: f32| a + (b - a) * share;
    let (lightness, chroma, hue) = (mix(from.1, to.1), mix(from.2, to.2), mix(from.3, to.3).to_radians());
    [lightness, chroma * hue.cos(), chroma * hue.sin()]
}

fn oklab_to_linear([lightness, a, b]: [f32; 3]) -> [f32; 3] {
    let l = (lightness + 0.396_337_78 * a + 0.215_803_76 * b).powi(3);
    let m = (lightness - 0.105_561_346 * a - 0.063_854_17 * b).powi(3);
    let s = (lightness - 0.089_484_18 * a - 1.291_485_5 * b).powi(3);
    [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_4 * s,
        -0.004_196_086 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ]
    .map(|v| v.clamp(0.0, 1.0))
}

/// Linear light to an sRGB byte.
pub fn encode(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let coded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (coded * 255.0).round() as u8
}

/// An sRGB byte to linear light.
pub fn decode(byte: u8) -> f32 {
    let v = f32::from(byte) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
#[path = "../tests/unit/colour.rs"]
mod tests;
