//! From the few lengths people think in to every length of `actuator.toml`, in the proportions of the reference actuator.

use fem::actuator;
use rom::snapshots::Footprint;

/// Margins of the base before and behind the body, mm.
const MARGIN_MM: f64 = 6.0;
/// Width of a slot, mm.
const SLOT_MM: f64 = 1.0;
/// Distance of the chambers of the reference actuator, mm.
const PITCH_MM: f64 = 9.0;
/// Width of the base by that of the body.
const BASE_BY_BODY: f64 = 1.6;
/// Smallest length of a cavity along the actuator, mm: shorter ones cannot be cast.
const SHORTEST_CAVITY_MM: f64 = 1.0;

/// Options.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub chambers: usize,
    /// Whole length, mm; by default 9 mm a chamber.
    pub length_mm: Option<f64>,
    /// Width of the body, mm; the base is wider by its margins.
    pub width_mm: f64,
    /// Wall between cavity and slot, mm; the top is 0.8 and a side 1.2 of it.
    pub wall_mm: f64,
}

/// A key of a section with its value.
pub type Entry = (&'static str, &'static str, String);

impl Shape {
    /// Length for which the chambers are `pitch_mm` apart.
    fn length_of(&self, pitch_mm: f64) -> f64 {
        self.chambers as f64 * pitch_mm + 2.0 * self.wall_mm - SLOT_MM + 2.0 * MARGIN_MM
    }

    /// The entries of `actuator.toml`.
    ///
    /// # Errors
    /// Chambers that do not fit: which option, and what would.
    pub fn entries(&self) -> Result<Vec<Entry>, String> {
        let (wall, count) = (self.wall_mm, self.chambers as f64);
        let smallest_pitch = SHORTEST_CAVITY_MM + SLOT_MM + 2.0 * wall;
        let default_mm = self.length_of(PITCH_MM.max(smallest_pitch));
        let length = self.length_mm.unwrap_or(default_mm);
        let least = self.length_of(smallest_pitch);
        if length < least - 1e-9 {
            return Err(format!(
                "--length-mm {length}: {} chambers with walls of {wall} mm need at least {least:.1} mm (cavities of \
                 {SHORTEST_CAVITY_MM} mm, slots of {SLOT_MM} mm); give a larger length, fewer chambers or a smaller --wall-mm",
                self.chambers
            ));
        }
        let body_length = length - 2.0 * MARGIN_MM;
        let pitch = (body_length - 2.0 * wall + SLOT_MM) / count;
        let base_width = BASE_BY_BODY * self.width_mm;
        let cavity_width = self.width_mm - 2.4 * wall;
        let cavity_top = 19.0 - 0.8 * wall;
        // A slot must stay open above the channels, and a chamber must be wider than its channel.
        if cavity_width < 3.0 || cavity_top < 8.0 {
            return Err(format!(
                "--wall-mm {wall}: leaves cavities {cavity_width:.1} mm wide and {cavity_top:.1} mm high at their top, expected at \
                 least 3 and 8 mm; give thinner walls or a larger --width-mm"
            ));
        }
        let mm = |value: f64| format!("{:?}", (value * 1e6).round() / 1e6);
        let range = |low: f64, high: f64| format!("[{}, {}]", mm(low), mm(high));
        let [beyond_tip, beyond_side] = Footprint::PLATE_BEYOND_MM;
        Ok(vec![
            ("base", "length_mm", mm(length)),
            ("base", "width_mm", mm(base_width)),
            ("body", "length_mm", mm(body_length)),
            ("body", "width_mm", mm(self.width_mm)),
            ("chambers", "count", self.chambers.to_string()),
            ("chambers", "first_mm", mm(MARGIN_MM + 2.0 * wall)),
            ("chambers", "length_mm", mm(pitch - SLOT_MM - 2.0 * wall)),
            ("chambers", "pitch_mm", mm(pitch)),
            ("chambers", "width_mm", mm(cavity_width)),
            ("chambers", "top_mm", mm(cavity_top)),
            ("obstacle", "x_mm", range(0.0, length + beyond_tip)),
            ("obstacle", "z_mm", range(-beyond_side, base_width + beyond_side)),
        ])
    }
}

/// The cross-section through a chamber, drawn with its measures in mm. It is not to scale: every measure is written out.
pub fn cross_section(shape: &actuator::Shape<'_>) -> String {
    let (base, body, chambers) = (shape.base, shape.body, shape.chambers);
    let number = |mm: f64| ((mm * 100.0).round() / 100.0).to_string();
    let floor = shape.cavity_floor_mm();
    let side = number(0.5 * (body.width_mm - chambers.width_mm));
    let cavity = format!("{} x {}", number(chambers.width_mm), number(chambers.top_mm - floor));
    let sheet = if shape.sheet { "- - - - sheet - - - -" } else { "" };
    let level = |mm: f64| format!("y = {}", number(mm));
    [
        format!("       |<---- {:^5} ---->|       width of the body (--width-mm)", number(body.width_mm)),
        format!("       +----------------+       {}", level(body.top_mm)),
        format!("       |  {:^12}  |       wall of the top {}", "", number(body.top_mm - chambers.top_mm)),
        format!("       |  +----------+  |       {}", level(chambers.top_mm)),
        format!("       |  |  cavity  |  |       cavity {cavity} (across z and y)"),
        format!("       |  |          |  |       wall of a side {side}"),
        format!("       |  +----------+  |       {}", level(floor)),
        format!("  +----+----------------+----+  {}", level(shape.base_top_mm())),
        format!("  |  {sheet:^22}  |  {}", level(base.lower_mm)),
        "  +--------------------------+  y = 0".to_owned(),
        format!("  |<-------- {:^6} -------->|  width of the base", number(base.width_mm)),
    ]
    .map(|line| line.trim_end().to_owned())
    .join("\n")
}
