//! Drawing a figure on any backend of plotters.

use super::figure::{Figure, Map, Mark, Panel, Series};
use crate::canvas::{Compression, png_bytes};
use anyhow::anyhow;
use formats::file;
use plotters::coord::types::RangedCoordf64;
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::path::{Path, PathBuf};
use std::sync::Once;

const PANEL: (u32, u32) = (560, 400);
const TITLE_HEIGHT: u32 = 44;
const BAR_WIDTH: u32 = 110;
/// Width of the vertical axis's labels and name.
const Y_LABELS: u32 = 72;
const MARGIN: u32 = 10;
const MARGIN_RIGHT: u32 = 24;
/// Size of labels.
const LABEL: u32 = 14;
/// Pictures of pixels are drawn this much larger and then halved, so that lines are smooth: twice the size in the end, which
/// is 9.5 cm a panel at 300 dots an inch.
const PIXELS: u32 = 4;
/// Steps per unit of length in SVG, whose coordinates are integers here.
const STEPS: u32 = 10;
/// Colours that stay apart for colour-blind eyes and in grey, by index.
const COLOURS: [(u8, u8, u8); 6] =
    [(0, 84, 147), (213, 94, 0), (0, 135, 90), (150, 60, 140), (90, 90, 90), (200, 150, 0)];
/// How far a line may pass from a point that it leaves out: nothing that one could see.
const LINE_TOLERANCE_PX: f64 = 0.2;
/// Lines of more points are drawn thin.
const DENSE_POINTS: usize = 500;
const FONT: &str = "sans-serif";

type Area<'a, B> = DrawingArea<B, Shift>;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A chart is written as `.svg` or `.png`; the name ends in neither.
#[derive(Debug, thiserror::Error)]
#[error("{}: a picture ends in .svg or .png", .0.display())]
pub struct EndingError(pub PathBuf);

impl Figure {
    /// Draws the figure into a `.svg` or `.png` file.
    ///
    /// # Errors
    /// Another ending, or a file that cannot be written.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("svg") => Ok(file::replace(path, self.svg()?.as_bytes())?),
            Some("png") => Ok(file::replace(path, &png(self)?)?),
            _ => Err(EndingError(path.to_owned()).into()),
        }
    }

    /// SVG text of the figure.
    ///
    /// # Errors
    /// A figure that cannot be drawn.
    pub fn svg(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        let (width, height) = size(self);
        let (wide, high) = (width * STEPS, height * STEPS);
        paint(self, SVGBackend::with_string(&mut text, (wide, high)), STEPS)?;
        let (drawn, shown) =
            (format!(r#"width="{wide}" height="{high}""#), format!(r#"width="{width}" height="{height}""#));
        Ok(joined(&text.replacen(&drawn, &shown, 1)))
    }
}

/// The SVG with each curve as one line: lines are drawn piece by piece, and a piece that begins where the one before it ended, in
/// the same style, goes on from there.
fn joined(svg: &str) -> String {
    let mut out = String::with_capacity(svg.len());
    // Style and end of the line that is open at the end of `out`.
    let mut open: Option<(&str, &str)> = None;
    for line in svg.lines() {
        let piece = line
            .strip_prefix("<polyline ")
            .and_then(|rest| rest.strip_suffix(" \"/>")?.split_once(" points=\""))
            .and_then(|(style, points)| Some((style, points.split_once(' ')?)));
        match (piece, open) {
            (Some((style, (from, on))), Some((last_style, end))) if style == last_style && from == end => {
                out.push(' ');
                out.push_str(on);
            }
            _ => {
                if open.is_some() {
                    out.push_str("\"/>\n");
                }
                match piece {
                    Some((style, (from, on))) => {
                        let start =
                            format!("<polyline stroke-linejoin=\"round\" {style} points=\"{from} {on}");
                        out.push_str(&start);
                    }
                    None => {
                        out.push_str(line);
                        out.push('\n');
                    }
                }
            }
        }
        open = piece.map(|(style, (_, on))| (style, on.rsplit(' ').next().unwrap_or(on)));
    }
    if open.is_some() {
        out.push_str("\"/>\n");
    }
    out
}

/// The figure as a PNG file.
fn png(figure: &Figure) -> anyhow::Result<Vec<u8>> {
    let (width, height) = size(figure);
    let (width, height) = (width * PIXELS, height * PIXELS);
    let mut pixels = vec![255; (width * height * 3) as usize];
    paint(figure, BitMapBackend::with_buffer(&mut pixels, (width, height)), PIXELS)?;
    png_bytes([width / 2, height / 2], &halved(&pixels, width as usize), Compression::default())
}

/// An RGB picture of half the size, each pixel the mean of four.
fn halved(rgb: &[u8], width: usize) -> Vec<u8> {
    let row = 3 * width;
    let mean = |pair: &[u8], x: usize, k: usize| {
        let sum = |x: usize| u16::from(pair[3 * x + k]) + u16::from(pair[row + 3 * x + k]);
        ((sum(2 * x) + sum(2 * x + 1) + 2) / 4) as u8
    };
    let pairs = rgb.chunks_exact(2 * row);
    pairs.flat_map(|pair| (0..width / 2).flat_map(move |x| (0..3).map(move |k| mean(pair, x, k)))).collect()
}

fn size(figure: &Figure) -> (u32, u32) {
    let rows = figure.panels.len().div_ceil(figure.columns.max(1)) as u32;
    let bar = if figure.panels.iter().any(|p| p.map.is_some()) { BAR_WIDTH } else { 0 };
    ((PANEL.0 + bar) * figure.columns.max(1) as u32, PANEL.1 * rows.max(1) + TITLE_HEIGHT)
}

/// Draws with `unit` pixels for each pixel of the constants.
fn paint<B: DrawingBackend>(figure: &Figure, backend: B, unit: u32) -> anyhow::Result<()> {
    static FONT_ONCE: Once = Once::new();
    FONT_ONCE.call_once(|| {
        // The only failure is a font that cannot be parsed; drawing text then reports it.
        let _ = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
    });
    let root = backend.into_drawing_area();
    let lift = |e: DrawingAreaErrorKind<B::ErrorType>| anyhow!("drawing: {e}");
    root.fill(&WHITE).map_err(lift)?;
    let rest = root.margin(8 * unit, 0, 0, 0).titled(&figure.title, (FONT, 22 * unit)).map_err(lift)?;
    let columns = figure.columns.max(1);
    let areas = rest.split_evenly((figure.panels.len().div_ceil(columns).max(1), columns));
    for (panel, area) in figure.panels.iter().zip(&areas) {
        draw_panel(panel, area, unit).map_err(lift)?;
    }
    root.present().map_err(lift)
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

fn draw_panel<B: DrawingBackend>(panel: &Panel, area: &Area<'_, B>, unit: u32) -> Drawn<B> {
    let (width, _) = area.dim_in_pixel();
    let area = match &panel.map {
        Some(map) => {
            let (chart, bar) = area.split_horizontally(width - BAR_WIDTH * unit);
            colour_bar(map, &bar, unit)?;
            chart
        }
        None => area.clone(),
    };
    let top = head(panel, &area, unit as i32)?;
    let (xs, ys) = panel.ranges();
    let (x_labels, y_labels) = (panel.x.labels(&xs), panel.y.labels(&ys));
    let mut widest = 0;
    for name in &panel.x.names {
        widest = widest.max(area.estimate_text_size(name, &(FONT, LABEL * unit).into())?.0 + LABEL * unit);
    }
    let along = area.dim_in_pixel().0.saturating_sub((Y_LABELS + MARGIN + MARGIN_RIGHT) * unit);
    let stride = panel.x.stride(along, widest);
    let mut chart = ChartBuilder::on(&area)
        .margin(MARGIN * unit)
        .margin_top(top)
        .margin_right(MARGIN_RIGHT * unit)
        .x_label_area_size(48 * unit)
        .y_label_area_size(Y_LABELS * unit)
        .build_cartesian_2d(xs, ys)?;
    if let Some(map) = &panel.map {
        chart.draw_series(cells(map))?;
    }
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(if panel.map.is_some() { TRANSPARENT } else { BLACK.mix(0.12) }.stroke_width(unit))
        .x_labels(x_labels)
        .y_labels(y_labels)
        .x_label_formatter(&|v| panel.x.text(*v, stride))
        .y_label_formatter(&|v| panel.y.text(*v, 1))
        .x_desc(&panel.x.label)
        .y_desc(&panel.y.label)
        .axis_style(BLACK.stroke_width(unit))
        .set_all_tick_mark_size(5 * unit)
        .label_style((FONT, LABEL * unit))
        .axis_desc_style((FONT, 15 * unit))
        .draw()?;
    for series in &panel.series {
        draw_series(panel, series, &mut chart, unit)?;
    }
    Ok(())
}

/// Title and legend above the axes, where they can hide no data; returns their height.
fn head<B: DrawingBackend>(
    panel: &Panel,
    area: &Area<'_, B>,
    unit: i32,
) -> Result<i32, DrawingAreaErrorKind<B::ErrorType>> {
    let left = 82 * unit;
    let right = area.dim_in_pixel().0 as i32;
    area.draw(&Text::new(panel.title.clone(), (left, 6 * unit), (FONT, 17 * unit)))?;
    let first = if panel.title.is_empty() { 8 } else { 32 } * unit;
    let (mut x, mut y) = (left, first);
    let named: Vec<&Series> = panel.series.iter().filter(|s| !s.name.is_empty()).collect();
    for series in &named {
        let width = area.estimate_text_size(&series.name, &(FONT, 14 * unit).into())?.0 as i32 + 44 * unit;
        if x > left && x + width > right {
            (x, y) = (left, y + 20 * unit);
        }
        let colour = colour(series);
        if series.mark != Mark::Dots {
            area.draw(&PathElement::new(
                vec![(x, y + 8 * unit), (x + 18 * unit, y + 8 * unit)],
                colour.stroke_width(2 * unit as u32),
            ))?;
        }
        if series.mark != Mark::Line {
            area.draw(&Circle::new((x + 9 * unit, y + 8 * unit), 4 * unit, colour.filled()))?;
        }
        let style = TextStyle::from((FONT, 14 * unit)).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(series.name.clone(), (x + 24 * unit, y + 8 * unit), style))?;
        x += width;
    }
    Ok(if named.is_empty() { first + 2 * unit } else { y + 26 * unit })
}

fn colour(series: &Series) -> RGBColor {
    let (r, g, b) = COLOURS[series.colour % COLOURS.len()];
    RGBColor(r, g, b)
}

fn draw_series<B: DrawingBackend>(
    panel: &Panel,
    series: &Series,
    chart: &mut Chart<'_, B>,
    unit: u32,
) -> Drawn<B> {
    let colour = colour(series);
    let placed = || series.points.iter().filter_map(|p| Some((panel.x.place(p.0)?, panel.y.place(p.1)?)));
    if series.mark != Mark::Dots {
        // Piece by piece: where a thick line turns back on itself, its joint would reach far out of the picture.
        let points: Vec<(f64, f64)> = placed().collect();
        let pixels: Vec<(i32, i32)> =
            points.iter().map(|point| chart.as_coord_spec().translate(point)).collect();
        let style = colour.stroke_width(if points.len() > DENSE_POINTS { unit } else { 2 * unit });
        let seen = corners(&pixels, LINE_TOLERANCE_PX * f64::from(unit));
        chart.draw_series(
            seen.windows(2).map(|pair| PathElement::new(vec![points[pair[0]], points[pair[1]]], style)),
        )?;
    }
    if series.mark != Mark::Line {
        chart.draw_series(placed().map(|p| Circle::new(p, 3 * unit, colour.filled())))?;
    }
    Ok(())
}

/// Positions of the points that a line needs so that no other one lies farther than `tolerance` from it (Ramer, Douglas and
/// Peucker). A picture of thousands of readings is then a few kilobytes and looks the same.
fn corners(points: &[(i32, i32)], tolerance: f64) -> Vec<usize> {
    let mut is_kept = vec![false; points.len()];
    let Some(last) = points.len().checked_sub(1) else { return Vec::new() };
    (is_kept[0], is_kept[last]) = (true, true);
    let mut stretches = vec![(0, last)];
    while let Some((first, last)) = stretches.pop() {
        let inner = (first + 1..last).map(|at| (at, distance(points[at], points[first], points[last])));
        let Some((at, farthest)) = inner.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        if farthest > tolerance {
            is_kept[at] = true;
            stretches.extend([(first, at), (at, last)]);
        }
    }
    (0..points.len()).filter(|at| is_kept[*at]).collect()
}

/// Distance of a point from the line between two others, ends included.
fn distance(point: (i32, i32), from: (i32, i32), to: (i32, i32)) -> f64 {
    let minus = |a: (i32, i32), b: (i32, i32)| (f64::from(a.0 - b.0), f64::from(a.1 - b.1));
    let ((x, y), (dx, dy)) = (minus(point, from), minus(to, from));
    let length2 = dx * dx + dy * dy;
    let along = if length2 > 0.0 { ((x * dx + y * dy) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (x - along * dx).hypot(y - along * dy)
}

/// The cells of a map; each reaches below its neighbours to the right and above, so that no seam shows. Blanks stay white.
fn cells(map: &Map) -> Vec<Rectangle<(f64, f64)>> {
    let rows = map.values.len() / map.columns.max(1);
    let (low, high) = map.limits();
    let (dx, dy) = ((map.x[1] - map.x[0]) / map.columns as f64, (map.y[1] - map.y[0]) / rows as f64);
    let cell = |(i, value): (usize, &f64)| {
        let (column, row) = ((i % map.columns) as f64, (i / map.columns) as f64);
        let corner = (map.x[0] + column * dx, map.y[0] + row * dy);
        let colour = shade((value - low) / (high - low).max(f64::MIN_POSITIVE));
        let end = ((corner.0 + 1.5 * dx).min(map.x[1]), (corner.1 + 1.5 * dy).min(map.y[1]));
        Rectangle::new([corner, end], colour.filled())
    };
    map.values.iter().enumerate().filter(|(_, v)| v.is_finite()).map(cell).collect()
}

fn colour_bar<B: DrawingBackend>(map: &Map, area: &Area<'_, B>, unit: u32) -> Drawn<B> {
    let (low, high) = map.limits();
    let mut chart = ChartBuilder::on(area)
        .margin_top(40 * unit)
        .margin_bottom(58 * unit)
        .margin_right(12 * unit)
        .y_label_area_size(Y_LABELS * unit)
        .build_cartesian_2d(0.0..1.0, low..high.max(low + f64::MIN_POSITIVE))?;
    let steps = 64;
    let step = (high - low) / f64::from(steps);
    chart.draw_series((0..steps).map(|i| {
        let y = low + f64::from(i) * step;
        Rectangle::new(
            [(0.0, y), (1.0, (y + 1.5 * step).min(high))],
            shade(f64::from(i) / f64::from(steps - 1)).filled(),
        )
    }))?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .disable_y_mesh()
        .x_labels(0)
        .y_labels(6)
        .y_label_formatter(&|v| super::axis::number(*v))
        .y_desc(&map.label)
        .axis_style(BLACK.stroke_width(unit))
        .set_all_tick_mark_size(5 * unit)
        .label_style((FONT, LABEL * unit))
        .axis_desc_style((FONT, 15 * unit))
        .draw()
}

/// White to deep blue over teal: brightness falls evenly, so it reads in grey as well.
fn shade(t: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 4] =
        [[247.0, 250.0, 253.0], [150.0, 205.0, 215.0], [40.0, 125.0, 170.0], [10.0, 40.0, 95.0]];
    let stop = t.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let low = (stop as usize).min(STOPS.len() - 2);
    let part = stop - low as f64;
    let mix = |k: usize| (STOPS[low][k] + part * (STOPS[low + 1][k] - STOPS[low][k])) as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

#[cfg(test)]
#[path = "../../tests/unit/chart_draw.rs"]
mod tests;
