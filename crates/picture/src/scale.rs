//! Colour scales: a range with round ticks, and the bar that explains it.

use super::canvas::Canvas;
use super::colour::ColourMap;
use super::text::{Align, Fonts, Style};
use super::theme::Theme;

/// A value range with round numbers along it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Values at the ends.
    pub range: [f32; 2],
    /// Round values within the range, ascending.
    pub ticks: Vec<f32>,
    /// Digits after the point that tell the ticks apart.
    pub digits: usize,
}

impl Scale {
    /// About `count` steps of 1, 2, 2.5 or 5 times a power of ten over a range; a range without width gets one tick.
    pub fn new(range: [f32; 2], count: usize) -> Self {
        let span = f64::from(range[1]) - f64::from(range[0]);
        let usable = span.is_finite() && span > 0.0;
        if !usable {
            return Self { range, ticks: vec![range[0]], digits: 3 };
        }
        let rough = span / count.max(1) as f64;
        let power = 10_f64.powf(rough.log10().floor());
        let factor = [1.0, 2.0, 2.5, 5.0, 10.0]
            .into_iter()
            .find(|f| f * power >= rough * (1.0 - 1e-9))
            .unwrap_or(10.0);
        let step = factor * power;
        let first = (f64::from(range[0]) / step - 1e-6).ceil() as i64;
        let last = (f64::from(range[1]) / step + 1e-6).floor() as i64;
        let half = if factor == 2.5 { 1 } else { 0 };
        Self {
            range,
            ticks: (first..=last).map(|k| (k as f64 * step) as f32).collect(),
            digits: (half - step.log10().floor() as i64).max(0) as usize,
        }
    }

    /// The same range, widened outwards to whole ticks.
    pub fn rounded(range: [f32; 2], count: usize) -> Self {
        let scale = Self::new(range, count);
        let [Some(first), Some(second)] =
            [scale.ticks.first(), scale.ticks.get(1)].map(Option::<&f32>::copied)
        else {
            return scale;
        };
        let step = second - first;
        let low = if first - range[0] > 1e-4 * step { first - step } else { first };
        let last = scale.ticks[scale.ticks.len() - 1];
        let high = if range[1] - last > 1e-4 * step { last + step } else { last };
        Self::new([low, high], count)
    }

    /// Label of a tick.
    pub fn text(&self, value: f32) -> String {
        let shown = if value == 0.0 { 0.0 } else { value }; // no "-0"
        format!("{shown:.digits$}", digits = self.digits)
    }

    /// Draws a horizontal bar with its ticks below and its label above; `x`, `y` is the top left of the label.
    #[expect(clippy::too_many_arguments, reason = "a place, a size and what to draw there")]
    pub fn draw_bar(
        &self,
        canvas: &mut Canvas,
        fonts: &Fonts,
        map: &ColourMap,
        theme: &Theme,
        place: [usize; 2],
        width: usize,
        text_px: f32,
        label: &str,
    ) {
        let [x, y] = place;
        let line = (text_px * 1.35) as usize;
        let height = (text_px * 0.8) as usize;
        let style = Style { size_px: text_px, bold: false, colour: theme.ink, align: Align::Left };
        fonts.draw(canvas, x as f32, y as f32, label, style);
        for column in 0..width {
            let colour = map.srgb(column as f32 / (width - 1).max(1) as f32);
            canvas.fill(x + column, y + line, 1, height, colour);
        }
        for tick in &self.ticks {
            let share = if self.range[1] > self.range[0] {
                (tick - self.range[0]) / (self.range[1] - self.range[0])
            } else {
                0.5
            };
            let middle = x as f32 + share * width as f32;
            canvas.fill((middle as usize).min(x + width - 2), y + line + height, 2, height / 3, theme.faint);
            let style = Style { size_px: text_px * 0.9, colour: theme.faint, align: Align::Centre, ..style };
            fonts.draw(canvas, middle, (y + line + height) as f32 + text_px * 0.3, &self.text(*tick), style);
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/scale.rs"]
mod tests;
