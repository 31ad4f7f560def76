//! Speed against error: what another ten microseconds or another megabyte buy.

use super::folder::Folder;
use super::method::{Double, Kernel, ReconstructionMethod};
use super::study::{Study, ours_with, paper, percent, train};
use rom::kernel::Precision;
use rom::model::{Model, Selection};
use rom::snapshots::FieldKind;
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use softtwin::progress::Progress;
use std::fmt::Write as _;
use std::time::Instant;
use train::config::{KernelKind, ModeChoice, Tail, TrainConfig};
use train::evaluate::spread;

/// Reconstructions timed for one figure; the median is reported, so that a busy machine disturbs little.
const TIMED: usize = 301;

/// One way to run the twin, measured.
struct Point {
    grouping: &'static str,
    kernel: String,
    modes: String,
    precision: &'static str,
    micros: f64,
    bytes: usize,
    /// 95th percentile over the held-out states of the normalised errors: displacement, stress, force.
    errors: [f64; 3],
}

pub fn section(study: &Study, out: &Folder, progress: &mut Progress) -> anyhow::Result<String> {
    let cases = study.held_out()?;
    let mut points = Vec::new();
    for (grouping, kernel, modes, config) in grid() {
        progress.step(&format!("speed against error: {grouping}, {kernel}, {modes} modes"));
        let model = match &config {
            Some(config) => &train(&study.database, config)?,
            None => &study.ours,
        };
        for precision in ["f64", "f32", "i16"] {
            let mut method = method(model, precision)?;
            let errors = errors(study, method.as_mut(), &cases)?;
            let (micros, bytes) = (time(study, method.as_mut(), &cases)?, method.bytes());
            let (kernel, modes) = (kernel.clone(), modes.clone());
            points.push(Point { grouping, kernel, modes, precision, micros, bytes, errors });
        }
    }
    let shown = out.picture("pareto", "Errors against time", &picture(&points))?;
    Ok(page(&points, cases.len(), &shown))
}

type Choice = (&'static str, String, String, Option<TrainConfig>);

/// The grid: our default, the paper's, and one number of modes for every group with one kernel.
fn grid() -> Vec<Choice> {
    let mut grid = vec![("per field", "chosen".into(), "chosen".into(), None)];
    for modes in [4, 6, 12] {
        grid.push(("joint", "linear, no tail".into(), modes.to_string(), Some(paper([modes; 2]))));
    }
    for (kernel, tail, name) in [
        (KernelKind::Cubic, Tail::Linear, "cubic, linear tail"),
        (KernelKind::ThinPlate, Tail::Linear, "thin-plate, linear tail"),
    ] {
        for modes in [3, 6, 10, 16] {
            let config = ours_with(ModeChoice::Fixed(modes), kernel, tail);
            grid.push(("per field", name.into(), modes.to_string(), Some(config)));
        }
    }
    grid
}

fn method(model: &Model, precision: &str) -> anyhow::Result<Box<dyn ReconstructionMethod>> {
    let all = Selection::default();
    Ok(match precision {
        "f64" => Box::new(Double::new(model, &all)?),
        "f32" => Box::new(Kernel::new(model, &all, Some(Precision::F32))?),
        _ => Box::new(Kernel::new(model, &all, None)?),
    })
}

/// Errors of the worst node, normalised by the field's largest value in the case and by the largest force: the 95th
/// percentile over cases.
fn errors(study: &Study, method: &mut dyn ReconstructionMethod, cases: &[usize]) -> anyhow::Result<[f64; 3]> {
    let database = &study.database;
    let largest_force = database.cases.iter().map(|c| c.contact_force_n).fold(f64::MIN_POSITIVE, f64::max);
    let mut found = [(); 3].map(|()| Vec::with_capacity(cases.len()));
    for &i in cases {
        let case = &database.cases[i];
        let force_n = method.answer(case.inputs())?;
        for (slot, kind) in [FieldKind::Magnitude, FieldKind::Stress].into_iter().enumerate() {
            let Some(f) = database.fields.iter().position(|f| f.kind == kind) else { continue };
            let truth: Vec<f32> = database.field(i, f).collect();
            let largest = truth.iter().fold(f32::MIN_POSITIVE, |m, v| m.max(v.abs()));
            let rows = method.rows();
            let off = |row: usize| (method.value(f * rows + row) - f64::from(truth[row])).abs();
            found[slot].push((0..rows).map(off).fold(0.0, f64::max) / f64::from(largest));
        }
        found[2].push((force_n - case.contact_force_n).abs() / largest_force);
    }
    Ok(found.map(|mut errors| spread(&mut errors)[1]))
}

/// Median time of evaluating and reconstructing one state, over the held-out states.
fn time(study: &Study, method: &mut dyn ReconstructionMethod, cases: &[usize]) -> anyhow::Result<f64> {
    let mut micros = Vec::with_capacity(TIMED);
    for i in 0..TIMED {
        let Some(case) = cases.get(i % cases.len().max(1)) else { break };
        let query = study.database.cases[*case].inputs();
        let started = Instant::now();
        method.answer(query)?;
        micros.push(started.elapsed().as_secs_f64() * 1e6);
    }
    micros.sort_by(f64::total_cmp);
    Ok(micros.get(micros.len() / 2).copied().unwrap_or(f64::NAN))
}

/// Nothing else is at least as fast and at least as exact in one quantity.
fn on_front(points: &[Point], point: &Point, slot: usize) -> bool {
    let better = |o: &Point| {
        let (theirs, own) = (o.errors[slot], point.errors[slot]);
        let no_worse = o.micros <= point.micros && theirs <= own;
        no_worse && (o.micros < point.micros || theirs < own)
    };
    !points.iter().any(better)
}

fn page(points: &[Point], cases: usize, shown: &str) -> String {
    let mut text = format!(
        "\n## Speed against error\n\nOne state evaluated and all its fields reconstructed: the median of {TIMED} runs on {}. \
         Normalised errors of the worst node: the 95th percentile over {cases} held-out states inside the training range. From fast \
         to slow: each row gains at least 10 % in displacement or stress over every faster one; our model (`chosen`) is always shown. \
         f64: plain sums, mode after mode; f32 and i16: the twin's kernel. MB: both \
         regimes.\n\
         {shown}\n| us | MB | POD | kernel | modes | precision | displacement % | stress % | force % |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
        processor()
    );
    for p in table(points) {
        let [displacement, stress, force] = p.errors.map(percent);
        let _ = writeln!(
            text,
            "| {:.1} | {:.2} | {} | {} | {} | {} | {displacement} | {stress} | {force} |",
            p.micros,
            p.bytes as f64 / 1e6,
            p.grouping,
            p.kernel,
            p.modes,
            p.precision
        );
    }
    text
}

/// The front from fast to slow, without points that gain less than 10 % over a faster one, and the default.
fn table(points: &[Point]) -> Vec<&Point> {
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| a.micros.total_cmp(&b.micros));
    let mut best = [f64::INFINITY; 2];
    sorted.retain(|p| {
        let gains = (0..2).any(|k| p.errors[k] < 0.9 * best[k]);
        if gains {
            (0..2).for_each(|k| best[k] = best[k].min(p.errors[k]));
        }
        gains || p.modes == "chosen"
    });
    sorted
}

/// The processor's name where the system tells it.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or("this machine".into(), |(_, name)| name.trim().to_owned())
}

fn picture(points: &[Point]) -> Figure {
    let panel = |title: &str, slot: usize| {
        let series = |name: &str, colour, keep: &dyn Fn(&Point) -> bool| Series {
            name: name.into(),
            colour,
            mark: Mark::Dots,
            points: points.iter().filter(|p| keep(p)).map(|p| (p.micros, 100.0 * p.errors[slot])).collect(),
        };
        let mut front: Vec<(f64, f64)> = points
            .iter()
            .filter(|p| on_front(points, p, slot))
            .map(|p| (p.micros, 100.0 * p.errors[slot]))
            .collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        Panel {
            title: title.into(),
            x: Axis::log("time of one state [us]"),
            y: Axis::log("error of the worst node, normalised [%]"),
            series: vec![
                Series { name: "front".into(), colour: 4, mark: Mark::Line, points: front },
                series("joint (paper)", 1, &|p| p.grouping == "joint"),
                series("per field, f64", 5, &|p| {
                    p.grouping != "joint" && p.precision == "f64" && p.modes != "chosen"
                }),
                series("per field, f32", 0, &|p| {
                    p.grouping != "joint" && p.precision == "f32" && p.modes != "chosen"
                }),
                series("per field, i16", 2, &|p| {
                    p.grouping != "joint" && p.precision == "i16" && p.modes != "chosen"
                }),
                series("chosen", 3, &|p| p.modes == "chosen"),
            ],
            map: None,
        }
    };
    let panels = vec![panel("Displacement", 0), panel("Stress", 1)];
    Figure { title: "Speed against error".into(), panels, columns: 2 }
}
