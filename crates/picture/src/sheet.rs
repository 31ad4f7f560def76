//! A picture of many states: rows of panels with the same camera, millimetres per pixel and colour scale, with titles, notes,
//! a caption and the colour bar.

use super::camera::{Camera, Window};
use super::canvas::{Canvas, Rgb};
use super::colour::ColourMap;
use super::scale::Scale;
use super::scene::Scene;
use super::text::{Align, Fonts, Style};
use super::theme::Theme;
use anyhow::Result;

/// One state with its labels.
pub struct Panel<'a> {
    pub scene: Scene<'a>,
    /// Above the drawing, left.
    pub title: String,
    /// Above the drawing, right, bold (contact force, share of energy).
    pub note: String,
}

/// Panels side by side.
pub struct Row<'a> {
    /// Heading over the row; empty for none.
    pub heading: String,
    pub panels: Vec<Panel<'a>>,
}

/// The whole picture.
pub struct Sheet<'a> {
    /// First line.
    pub title: String,
    /// Second line.
    pub caption: String,
    pub rows: Vec<Row<'a>>,
    /// Label of the colour bar, with its unit.
    pub bar_label: String,
    /// The colour scale of all panels.
    pub scale: Scale,
    pub map: ColourMap,
    /// Direction of view.
    pub camera: Camera,
    /// Width of a panel, pixels.
    pub panel_px: usize,
    /// Height of text lines, pixels.
    pub text_px: f32,
    /// Colours of the background.
    pub theme: Theme,
}

/// The colour bar in the head of a sheet.
#[derive(Clone, Copy)]
struct Bar {
    beside: bool,
    width: usize,
}

impl Bar {
    /// Width that it leaves to title and caption.
    fn room(self, width: usize, gap: usize) -> f32 {
        let taken = if self.beside { self.width + 2 * gap } else { 0 };
        width.saturating_sub(taken + 2 * gap) as f32
    }
}

/// Space around a drawing as a fraction of its width.
const MARGIN: f32 = 0.035;
/// Size of the title, and the height of its lines, in heights of the text.
const TITLE: f32 = 1.45;
const TITLE_LINE: f32 = 1.25 * TITLE;
/// The largest picture, in pixels; it takes 300 MB of memory.
const MAX_PIXELS: usize = 100_000_000;

impl Sheet<'_> {
    /// Draws everything. The millimetres a pixel are those of the widest scene; a row is as high as its scenes need.
    ///
    /// # Errors
    /// A picture of more than 100 megapixels; an embedded font that cannot be read.
    pub fn draw(&self) -> Result<Canvas> {
        let fonts = Fonts::embedded()?;
        let [gap, line] = [self.text_px * 0.6, self.text_px * 1.4].map(|v| v as usize);
        let heights = self.row_windows();
        let columns = self.rows.iter().map(|row| row.panels.len()).max().unwrap_or(0);
        let width = columns * (self.panel_px + gap) + gap;
        let heading = |row: &Row| if row.heading.is_empty() { 0 } else { line + gap / 2 };
        let rows_px: usize =
            heights.iter().zip(&self.rows).map(|((_, h), row)| h + line + heading(row) + gap).sum();
        let bar = self.bar(&fonts, width, gap);
        let titles = self.title_lines(&fonts, width, gap, bar);
        let stacked = if bar.beside { 0 } else { 2 * line + 2 * gap };
        let further = (titles.len() - 1) * (self.text_px * TITLE_LINE) as usize;
        let head = 2 * gap + (self.text_px * TITLE) as usize + further + line * 2 + stacked;
        let height = head + rows_px + gap;
        anyhow::ensure!(
            width.saturating_mul(height) <= MAX_PIXELS,
            "expected a picture of at most {} megapixels, found {width} x {height} pixels; choose a smaller --width or a \
             smaller gap",
            MAX_PIXELS / 1_000_000
        );
        let mut canvas = Canvas::new(width, height, self.theme.page);
        self.draw_head(&mut canvas, &fonts, gap, bar, &titles);
        let mut top = head;
        for (row, (window, height)) in self.rows.iter().zip(&heights) {
            let style = self.style(1.0, true, self.theme.ink);
            fonts.draw(&mut canvas, gap as f32, top as f32, &row.heading, style);
            top += heading(row);
            for (k, panel) in row.panels.iter().enumerate() {
                let left = gap + k * (self.panel_px + gap);
                self.draw_panel(&mut canvas, &fonts, panel, window, [left, top, *height + line]);
            }
            top += height + line + gap;
        }
        Ok(canvas)
    }

    fn style(&self, size: f32, bold: bool, colour: Rgb) -> Style {
        Style { size_px: self.text_px * size, bold, colour, align: Align::Left }
    }

    /// Window and height in pixels of each row, all at the same millimetres a pixel.
    fn row_windows(&self) -> Vec<(Window, usize)> {
        let around = |row: &Row| {
            let points = row.panels.iter().flat_map(|panel| panel.scene.extent());
            // Tall enough that the width alone decides the scale, then as low as the content.
            Window::around(&self.camera, points, [self.panel_px, 100 * self.panel_px], MARGIN)
        };
        let windows: Vec<Window> = self.rows.iter().map(around).collect();
        let mm_per_px = windows.iter().map(|w| w.mm_per_px).fold(1e-6, f32::max);
        let height = |row: &Row| {
            let ups =
                row.panels.iter().flat_map(|panel| panel.scene.extent()).map(|p| self.camera.project(p)[1]);
            let (low, high) = ups.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            ((high - low).max(1.0) / mm_per_px).min(MAX_PIXELS as f32) as usize
                + (2.0 * MARGIN * self.panel_px as f32) as usize
        };
        windows.iter().zip(&self.rows).map(|(w, row)| (Window { mm_per_px, ..*w }, height(row))).collect()
    }

    /// Where the colour bar stands: right of the title where there is room for its whole label, else below the caption.
    fn bar(&self, fonts: &Fonts, width: usize, gap: usize) -> Bar {
        let label = fonts.width_px(&self.bar_label, self.text_px, false).ceil() as usize;
        let bar = (width / 4).min((self.text_px * 20.0) as usize).max(label);
        let labels = [(&self.title, TITLE, true), (&self.caption, 0.5, false)];
        let words = labels.map(|(text, size, bold)| fonts.width_px(text, self.text_px * size, bold) as usize);
        let beside = words[0].max(words[1]) + bar + 5 * gap <= width;
        Bar { beside, width: if beside { bar } else { bar.min(width - 4 * gap) } }
    }

    /// The title in as many lines as the picture's width asks for; at least one.
    fn title_lines(&self, fonts: &Fonts, width: usize, gap: usize, bar: Bar) -> Vec<String> {
        let size_px = self.text_px * TITLE;
        wrapped(&self.title, usize::MAX, |text| fonts.width_px(text, size_px, true) <= bar.room(width, gap))
    }

    fn draw_head(&self, canvas: &mut Canvas, fonts: &Fonts, gap: usize, bar: Bar, titles: &[String]) {
        let style = self.style(TITLE, true, self.theme.ink);
        let mut below = gap as f32;
        for title in titles {
            fonts.draw(canvas, gap as f32, below, title, style);
            below += self.text_px * TITLE_LINE;
        }
        let room = bar.room(canvas.width, gap);
        let lines = wrapped(&self.caption, 2, |text| fonts.width_px(text, self.text_px, false) <= room);
        for (row, text) in lines.iter().enumerate() {
            let y = below + row as f32 * self.text_px * 1.3;
            fonts.draw(canvas, gap as f32, y, text, self.style(1.0, false, self.theme.faint));
        }
        let place = match bar.beside {
            true => [canvas.width - bar.width - 2 * gap, gap],
            false => [2 * gap, (below + self.text_px * 2.9) as usize],
        };
        self.scale.draw_bar(
            canvas,
            fonts,
            &self.map,
            &self.theme,
            place,
            bar.width,
            self.text_px,
            &self.bar_label,
        );
    }

    /// A ruler in the corner where a panel without a title has room: lengths along the picture are to scale.
    fn draw_ruler(&self, canvas: &mut Canvas, fonts: &Fonts, [x, y]: [f32; 2], mm_per_px: f32) {
        let length_mm = ruler_mm(0.25 * self.panel_px as f32 * mm_per_px);
        let (length, thick) = ((length_mm / mm_per_px) as usize, (self.text_px * 0.1).ceil() as usize);
        let (left, middle) = (x as usize, (y + 0.65 * self.text_px) as usize);
        let tick = (self.text_px * 0.6) as usize;
        canvas.fill(left, middle, length, thick, self.theme.ink);
        for end in [left, left + length.saturating_sub(thick)] {
            canvas.fill(end, middle.saturating_sub(tick / 2), thick, tick, self.theme.ink);
        }
        let label = format!("{length_mm} mm");
        let style = self.style(0.9, false, self.theme.ink);
        fonts.draw(canvas, x + length as f32 + 0.4 * self.text_px, y, &label, style);
    }

    fn draw_panel(
        &self,
        canvas: &mut Canvas,
        fonts: &Fonts,
        panel: &Panel,
        window: &Window,
        place: [usize; 3],
    ) {
        let [left, top, height] = place;
        let pixels = [self.panel_px, height];
        // The title stands over the drawing, so the drawing is shifted down by half a line.
        let shift = 0.5 * self.text_px * 1.4 * window.mm_per_px;
        let window = Window { centre_mm: [window.centre_mm[0], window.centre_mm[1] + shift], ..*window };
        let drawing = panel.scene.draw(self.camera, window, pixels, &self.map, &self.theme);
        canvas.paste(left, top, &drawing);
        let (x, y) = (left as f32 + self.text_px * 0.5, top as f32 + self.text_px * 0.35);
        if panel.title.is_empty() {
            self.draw_ruler(canvas, fonts, [x, y], window.mm_per_px);
        }
        fonts.draw(canvas, x, y, &panel.title, self.style(1.0, false, self.theme.ink));
        let style = Style { align: Align::Right, ..self.style(1.0, true, self.theme.ink) };
        fonts.draw(canvas, left as f32 + self.panel_px as f32 - self.text_px * 0.5, y, &panel.note, style);
    }
}

/// Words in lines that fit; the last of `most` lines takes the rest. At least one line.
fn wrapped(text: &str, most: usize, fits: impl Fn(&str) -> bool) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let count = lines.len();
        let Some(last) = lines.last_mut() else { break };
        let longer = if last.is_empty() { word.to_owned() } else { format!("{last} {word}") };
        if last.is_empty() || count >= most || fits(&longer) {
            *last = longer;
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

/// The longest of 1, 2, 5, 10, 20, ... mm that is not above the given one.
fn ruler_mm(most: f32) -> f32 {
    let power = 10_f32.powf(most.max(1e-3).log10().floor());
    [5.0, 2.0, 1.0].map(|digit| digit * power).into_iter().find(|length| *length <= most).unwrap_or(power)
}

#[cfg(test)]
#[path = "../tests/unit/sheet.rs"]
mod tests;
