//! `softtwin compare`.

mod body;
mod subject;

use crate::bench::{self, confusion, inputs_at, line, match_inputs, panel, range};
use crate::failure::{configuration, usage};
use crate::motion::follow_rows;
use crate::picture::{Figure, Mark};
use crate::{files, output, report};
use anyhow::Context;
use formats::log::Recording;
use rom::evaluation::Evaluation;
use rom::learned::{Following, LearnedMap};
use rom::model::{Model, Selection};
use rom::observable::Observables;
use rom::reconstructor::Reconstructor;
use rom::snapshots::FieldKind;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use subject::Subject;
use train::measured::{coefficient, place};

const EXAMPLES: &str = "\
Examples:
  A model against a run that it has not seen, as a table and as pictures:
    softtwin compare mine.twin --recording run2.csv --log log.toml \\
      --out compared
  The same as one JSON object:
    softtwin compare mine.twin --recording run2.csv --log log.toml \\
      --out compared --json

  A scene before and after its calibration, on one page:
    softtwin compare calibrated.toml --before finger.toml \\
      --recording run2.csv --log log.toml --out compared

A scene stands for its actuator's model with the inputs that it gives, or the priors that it estimates. Outputs are named as in the mapping: `tip_x_mm` is the coordinate x at the node set `tip`; `contact_force_n` is the contact force; \
observables have their name. \
Coverage is the fraction of the values within the model's half-widths.";

/// Say how far a model is from a recording of a bench: errors, coverage, pictures.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model file, or a scene with one actuator.
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Another model file or scene, shown beside it; default: none.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// Times of the body with its markers, s; default: where the input that moves most has 0, 50 and 100 % of its range.
    #[arg(long, value_name = "S,...", value_delimiter = ',', value_parser = crate::range::number(0.0, 1e6))]
    at_s: Vec<f64>,
    /// Recording.
    #[arg(long, value_name = "FILE")]
    recording: PathBuf,
    /// Mapping of the columns.
    #[arg(long, value_name = "FILE.toml")]
    log: PathBuf,
    /// Folder for the pictures and the table.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Correct a model learned from measurements by an offset that follows the measured outputs, known up to this time ago, s; default: none.
    #[arg(long, value_name = "S", value_parser = crate::range::number(0.0, 1e6))]
    follow: Option<f64>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Measured and predicted values of an output.
struct Compared {
    name: String,
    measured: Vec<f64>,
    predicted: Vec<f64>,
    half_width: Vec<f64>,
    /// Rows outside the model's training range.
    is_outside: Vec<bool>,
}

/// Where the predicted value of an output comes from.
enum Origin {
    /// `output`: which of those of a learned map it is.
    Node {
        field: usize,
        node: usize,
        output: Option<usize>,
    },
    Observable(usize),
    Force,
}

impl Args {
    /// Compares and writes pictures and table.
    pub fn run(self) -> anyhow::Result<()> {
        let subject = Subject::read(&self.model)?;
        let model = &subject.model;
        let recording = bench::read(&self.recording, &bench::mapping(&self.log)?)?;
        let mut remarks = recording.remarks.clone();
        let places = match_inputs(&model.header, &recording, &mut remarks).map_err(configuration)?;
        let outputs = compare(&subject, &recording, &places, self.follow, &mut remarks)?;
        let rows = outputs.first().map_or(0, |o| o.predicted.iter().filter(|v| v.is_finite()).count());
        if rows == 0 {
            return Err(configuration(anyhow::anyhow!(
                "no row of the recording has all inputs of the model"
            )));
        }
        remarks.extend(suspicions(&outputs));
        remarks.extend(swapped_inputs(&subject, &recording, &places, &outputs)?);
        let before =
            self.before.as_ref().map(|path| before(path, &recording)).transpose()?.unwrap_or_default();
        formats::file::create_folder(&self.out)?;
        figure(&recording, &places, &outputs, &before).save(&self.out.join("compare.svg"))?;
        files::save(&self.out.join("compare.csv"), table(&recording, &outputs).as_bytes())?;
        if let Some(picture) = body::picture(&subject, &recording, &places, &self.at_s)? {
            picture.write_png(&self.out.join("body.png"))?;
        }
        let found = Comparison {
            source: source(model),
            rows,
            rows_outside: outputs[0].is_outside.iter().filter(|is_outside| **is_outside).count(),
            outputs: statistics(&outputs),
            inside: parts(&outputs, false),
            outside: parts(&outputs, true),
            before: self.before.is_some().then(|| statistics(&before)),
            markers: markers(&outputs),
            remarks,
        };
        report::print(&found, self.json)?;
        if !self.json {
            output!("pictures and table: {}", self.out.display())?;
        }
        Ok(())
    }
}

/// What the command found.
#[derive(Serialize)]
struct Comparison {
    source: &'static str,
    rows: usize,
    /// Those outside the training range; `inside` and `outside` tell both apart.
    rows_outside: usize,
    outputs: BTreeMap<String, Statistics>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    inside: BTreeMap<String, Statistics>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    outside: BTreeMap<String, Statistics>,
    #[serde(skip_serializing_if = "Option::is_none")]
    before: Option<BTreeMap<String, Statistics>>,
    markers: BTreeMap<String, Marker>,
    remarks: Vec<String>,
}

fn source(model: &Model) -> &'static str {
    if model.is_measured() { "measured" } else { "finite elements" }
}

fn statistics(outputs: &[Compared]) -> BTreeMap<String, Statistics> {
    outputs.iter().map(|output| (output.name.clone(), output.statistics())).collect()
}

/// Statistics of the rows inside or outside the training range; empty if all are inside.
fn parts(outputs: &[Compared], outside: bool) -> BTreeMap<String, Statistics> {
    outputs.iter().filter_map(|of| Some((of.name.clone(), of.part(outside)?.statistics()))).collect()
}

/// The comparison with another model.
fn before(path: &Path, recording: &Recording) -> anyhow::Result<Vec<Compared>> {
    let subject = Subject::read(path)?;
    let mut remarks = Vec::new();
    let places = match_inputs(&subject.model.header, recording, &mut remarks)
        .with_context(|| format!("--before {}", path.display()))
        .map_err(configuration)?;
    compare(&subject, recording, &places, None, &mut remarks)
}

fn compare(
    subject: &Subject,
    recording: &Recording,
    places: &[Option<usize>],
    follow_s: Option<f64>,
    remarks: &mut Vec<String>,
) -> anyhow::Result<Vec<Compared>> {
    let model = &subject.model;
    let observables = Observables::of(model)?;
    let mut origins = Vec::new();
    let mut outputs = Vec::new();
    for series in &recording.outputs {
        let origin = match series.name.as_str() {
            "contact_force_n" | "measured_force_n"
                if model.header.regimes.iter().any(|r| r.force.is_some()) =>
            {
                Some(Origin::Force)
            }
            name => {
                let observable = observables.names().position(|known| known == name).map(Origin::Observable);
                let node =
                    |(field, node)| Origin::Node { field, node, output: coefficient(model, field, node) };
                let at = || place(&model.header, name).map(node);
                observable.or_else(at)
            }
        };
        let Some(origin) = origin else {
            remarks.push(format!("{}: the model has no such output", series.name));
            continue;
        };
        origins.push(origin);
        let nan = vec![f64::NAN; series.values.len()];
        outputs.push(Compared {
            name: series.name.clone(),
            measured: series.values.clone(),
            predicted: nan.clone(),
            half_width: nan,
            is_outside: vec![false; series.values.len()],
        });
    }
    if outputs.is_empty() {
        let fields: Vec<&str> = model.header.fields.iter().map(|f| f.spec.name.as_str()).collect();
        let sets: Vec<&str> = model.header.node_sets.iter().map(|s| s.name.as_str()).collect();
        return Err(configuration(anyhow::anyhow!(
            "the mapping names no output of the model: its observables are {}, its fields {}, its node sets {}",
            observables.names().collect::<Vec<_>>().join(", "),
            fields.join(", "),
            sets.join(", ")
        )));
    }
    let reconstructor = Reconstructor::new(model, &Selection::default())?;
    let mut fields = vec![0.0; reconstructor.entries()];
    let nodes = model.header.node_count;
    // Value and half-width of an output.
    let answer = |evaluation: &Evaluation, fields: &[f32], origin: &Origin| {
        let widths = evaluation.halfwidths;
        match *origin {
            Origin::Observable(at) => {
                let found = observables.value(at, evaluation);
                (found.value, found.halfwidth)
            }
            Origin::Force => (evaluation.contact_force_n + subject.force_bias_n, widths.force_n),
            Origin::Node { field, node, output: Some(output) } => {
                let width = evaluation.output_half_widths.get(output).copied().unwrap_or(f64::NAN);
                (f64::from(fields[field * nodes + node]), width)
            }
            Origin::Node { field, node, output: None } => {
                let by_kind = match model.header.fields[field].spec.kind {
                    FieldKind::Coordinate(_) | FieldKind::Magnitude => widths.displacement_mm,
                    FieldKind::Stress => widths.stress_mpa,
                    FieldKind::Other => f64::NAN,
                };
                (f64::from(fields[field * nodes + node]), by_kind)
            }
        }
    };
    let inputs_of = |row: usize| inputs_at(places, recording, row).map(|inputs| subject.unbiased(inputs));
    let of_rows = follow_rows(model, &recording.time_s, inputs_of, |row, _, evaluation, _| {
        reconstructor.reconstruct_into(evaluation, &mut fields).context("the model has no answer")?;
        for (output, origin) in outputs.iter_mut().zip(&origins) {
            let (value, width) = answer(evaluation, &fields, origin);
            (output.predicted[row], output.half_width[row]) = (value, width);
            output.is_outside[row] = evaluation.flags.extrapolated;
        }
        Ok(())
    })?;
    remarks.extend(of_rows);
    if let Some(behind_s) = follow_s {
        let map = model.header.learned.as_ref();
        let map = map.ok_or_else(|| {
            usage("--follow: expected a model learned from measurements, found another one")
        })?;
        follow(map, &origins, &recording.time_s, behind_s, &mut outputs);
    }
    let outside = outputs[0].is_outside.iter().filter(|is_outside| **is_outside).count();
    if outside > 0 {
        let widths =
            if model.header.learned.is_some() { "wider half-widths or none" } else { "no half-width" };
        let remark = format!(
            "{outside} rows are outside the model's training range, with {widths}; they are also reported apart"
        );
        remarks.insert(0, remark);
    }
    Ok(outputs)
}

/// Adds to predicted values the offset that measured values of at least `behind_s` ago suggest.
fn follow(map: &LearnedMap, origins: &[Origin], time_s: &[f64], behind_s: f64, outputs: &mut [Compared]) {
    let mut following = Following::new(map);
    let of_map: Vec<(usize, usize)> = origins
        .iter()
        .enumerate()
        .filter_map(|(at, origin)| match origin {
            Origin::Node { output: Some(output), .. } => Some((at, *output)),
            _ => None,
        })
        .collect();
    let free: Vec<Vec<f64>> = outputs.iter().map(|output| output.predicted.clone()).collect();
    let mut errors = vec![f64::NAN; map.outputs()];
    let mut known = 0;
    for row in 0..time_s.len() {
        while known < row && time_s[known] <= time_s[row] - behind_s {
            for (at, output) in &of_map {
                errors[*output] = outputs[*at].measured[known] - free[*at][known];
            }
            following.take(time_s[known], &errors);
            known += 1;
        }
        for (at, output) in &of_map {
            outputs[*at].predicted[row] += following.offset(*output);
        }
    }
}

/// Statistics of an output.
#[derive(Serialize)]
struct Statistics {
    rms: f64,
    p95: f64,
    max: f64,
    range: f64,
    coverage: f64,
    bias: f64,
    gain: f64,
}

impl Compared {
    /// The rows outside the training range, or those inside; `None` if all are inside.
    fn part(&self, outside: bool) -> Option<Self> {
        let pick = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.is_outside).filter(|(_, is)| **is == outside).map(|(v, _)| *v).collect()
        };
        let part = Self {
            name: self.name.clone(),
            measured: pick(&self.measured),
            predicted: pick(&self.predicted),
            half_width: pick(&self.half_width),
            is_outside: Vec::new(),
        };
        (self.is_outside.contains(&true) && part.pairs().next().is_some()).then_some(part)
    }

    fn pairs(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let all = self.measured.iter().zip(&self.predicted).zip(&self.half_width);
        all.map(|((m, p), h)| (*m, *p, *h)).filter(|(m, p, _)| m.is_finite() && p.is_finite())
    }

    fn statistics(&self) -> Statistics {
        let count = self.pairs().count() as f64;
        let mut errors: Vec<f64> = self.pairs().map(|(m, p, _)| (m - p).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let at = |share: f64| {
            errors.get(((share * count).ceil() as usize).max(1) - 1).copied().unwrap_or(f64::NAN)
        };
        let mean = |of: &dyn Fn(f64, f64) -> f64| self.pairs().map(|(m, p, _)| of(m, p)).sum::<f64>() / count;
        let (mean_m, mean_p) = (mean(&|m, _| m), mean(&|_, p| p));
        let product = mean(&|m, p| (m - mean_m) * (p - mean_p));
        let known = self.pairs().filter(|(_, _, h)| h.is_finite()).count() as f64;
        let inside = self.pairs().filter(|(m, p, h)| (m - p).abs() <= *h).count();
        Statistics {
            rms: mean(&|m, p| (m - p) * (m - p)).sqrt(),
            p95: at(0.95),
            max: at(1.0),
            range: range(&self.measured),
            coverage: inside as f64 / known,
            bias: mean_p - mean_m,
            gain: product / mean(&|_, p| (p - mean_p) * (p - mean_p)),
        }
    }

    fn correlation(&self) -> f64 {
        let mean = |of: &dyn Fn(f64, f64) -> f64| {
            self.pairs().map(|(m, p, _)| of(m, p)).sum::<f64>() / self.pairs().count() as f64
        };
        let (mean_m, mean_p) = (mean(&|m, _| m), mean(&|_, p| p));
        let product =
            |a: &dyn Fn(f64, f64) -> f64, b: &dyn Fn(f64, f64) -> f64| mean(&|m, p| a(m, p) * b(m, p));
        let (of_m, of_p) = (|m: f64, _: f64| m - mean_m, |_: f64, p: f64| p - mean_p);
        product(&of_m, &of_p) / (product(&of_m, &of_m) * product(&of_p, &of_p)).sqrt()
    }
}

/// Position error of a marker with three coordinates, and its share of the diagonal of its range.
#[derive(Serialize)]
struct Marker {
    rms_mm: f64,
    range_mm: f64,
    share: f64,
}

fn markers(outputs: &[Compared]) -> BTreeMap<String, Marker> {
    let mut found = BTreeMap::new();
    for x in outputs.iter().filter(|output| output.name.ends_with("_x_mm")) {
        let marker = x.name.trim_end_matches("_x_mm");
        let axis = |axis: &str| outputs.iter().find(|output| output.name == format!("{marker}_{axis}_mm"));
        let all: Vec<Statistics> =
            [Some(x), axis("y"), axis("z")].iter().flatten().map(|o| o.statistics()).collect();
        let norm = |value: fn(&Statistics) -> f64| all.iter().map(|s| value(s).powi(2)).sum::<f64>().sqrt();
        let (rms_mm, range_mm) = (norm(|s| s.rms), norm(|s| s.range));
        found.insert(marker.into(), Marker { rms_mm, range_mm, share: rms_mm / range_mm });
    }
    found
}

/// Correlation of measured and predicted values from which they have the same shape.
const SAME_SHAPE: f64 = 0.9;

/// Ranges that differ by a factor, and columns that fit one another's prediction.
fn suspicions(outputs: &[Compared]) -> Vec<String> {
    let mut remarks = Vec::new();
    for output in outputs {
        let ratio = range(&output.measured) / range(&output.predicted);
        // Only a curve of the same shape can have another unit.
        if output.correlation() > SAME_SHAPE
            && ratio.is_finite()
            && ratio > 0.0
            && !(0.2..=5.0).contains(&ratio)
        {
            remarks.push(format!(
                "{}: the measured range is {ratio:.3} times the predicted one ({}); is its unit right?",
                output.name,
                confusion(ratio)
            ));
        }
    }
    let error = |a: &Compared, b: &Compared| -> f64 {
        let both = a.measured.iter().zip(&b.predicted).filter(|(m, p)| m.is_finite() && p.is_finite());
        both.map(|(m, p)| (m - p) * (m - p)).sum()
    };
    for (at, a) in outputs.iter().enumerate() {
        for b in &outputs[at + 1..] {
            let (own, swapped) = (error(a, a) + error(b, b), error(a, b) + error(b, a));
            if swapped < 0.25 * own {
                remarks.push(format!("{} and {}: swapped? Each fits the other's prediction", a.name, b.name));
            }
        }
    }
    remarks
}

/// Rows of a recording from which swapped inputs are found.
const PROBE_ROWS: usize = 200;
/// Error from which inputs may be swapped, and the fraction of it that is left if they are: mean squares over the squared range.
const SUSPECT: f64 = 0.03 * 0.03;
const LEFT_BY_SWAP: f64 = 0.25;

/// Pairs of inputs that explain the outputs better when exchanged. Inputs with the same effect are undecidable and not named.
fn swapped_inputs(
    subject: &Subject,
    recording: &Recording,
    places: &[Option<usize>],
    outputs: &[Compared],
) -> anyhow::Result<Vec<String>> {
    let share = |of: &Compared| (of.statistics().rms / range(&of.measured)).powi(2);
    let error = |all: &[Compared]| -> f64 {
        all.iter().map(share).filter(|v| v.is_finite()).sum::<f64>() / all.len() as f64
    };
    if error(outputs) < SUSPECT {
        return Ok(Vec::new());
    }
    let thin = recording.every(recording.time_s.len().div_ceil(PROBE_ROWS));
    let of = |places: &[Option<usize>]| -> anyhow::Result<f64> {
        Ok(error(&compare(subject, &thin, places, None, &mut Vec::new())?))
    };
    let own = of(places)?;
    let unit = |at: usize| subject.model.header.inputs[at].unit.as_str();
    let moves = |place: Option<usize>| place.is_some_and(|at| range(&thin.inputs[at].values) > 0.0);
    let mut remarks = Vec::new();
    for a in 0..places.len() {
        for b in a + 1..places.len() {
            if unit(a) != unit(b) || !(moves(places[a]) || moves(places[b])) {
                continue;
            }
            let (Some(first), Some(second)) = (places[a], places[b]) else { continue };
            let mut swapped = places.to_vec();
            swapped.swap(a, b);
            if of(&swapped)? < LEFT_BY_SWAP * own {
                let [a, b] = [first, second].map(|at| &recording.inputs[at].name);
                remarks
                    .push(format!("inputs {a} and {b}: swapped? Exchanged, they explain the outputs better"));
            }
        }
    }
    Ok(remarks)
}

fn figure(
    recording: &Recording,
    places: &[Option<usize>],
    outputs: &[Compared],
    before: &[Compared],
) -> Figure {
    let inputs = places.iter().flatten().map(|at| &recording.inputs[*at]);
    let main = inputs.max_by(|a, b| range(&a.values).total_cmp(&range(&b.values)));
    let mut panels = Vec::new();
    for output in outputs {
        let over = |x: &[f64], y: &[f64]| x.iter().copied().zip(y.iter().copied()).collect::<Vec<_>>();
        let earlier = before.iter().find(|earlier| earlier.name == output.name);
        let both = |x: &[f64], mark| {
            let of = |name: &str, colour, y: &[f64]| line(name, colour, mark, over(x, y).into_iter());
            let mut lines = vec![of("measured", 0, &output.measured), of("predicted", 1, &output.predicted)];
            lines.extend(earlier.map(|earlier| of("before", 2, &earlier.predicted)));
            lines
        };
        panels.push(panel(&output.name, "time [s]", &output.name, both(&recording.time_s, Mark::Line)));
        if let Some(main) = main {
            panels.push(panel("loops", &main.name, &output.name, both(&main.values, Mark::Line)));
        }
        let residuals: Vec<f64> = output.measured.iter().zip(&output.predicted).map(|(m, p)| m - p).collect();
        let of_earlier = |earlier: &Compared| {
            let residuals = output.measured.iter().zip(&earlier.predicted).map(|(m, p)| m - p);
            line("before", 2, Mark::Line, recording.time_s.iter().copied().zip(residuals))
        };
        let band = |sign: f64| {
            let widths = output.half_width.iter().map(move |h| sign * h);
            line("", 4, Mark::Line, recording.time_s.iter().copied().zip(widths))
        };
        let own =
            line("measured minus predicted", 0, Mark::Line, over(&recording.time_s, &residuals).into_iter());
        panels.push(panel(
            "residuals and half-widths",
            "time [s]",
            &output.name,
            earlier.map(of_earlier).into_iter().chain([own, band(1.0), band(-1.0)]).collect(),
        ));
    }
    Figure { title: "model and measurement".into(), panels, columns: if main.is_some() { 3 } else { 2 } }
}

fn table(recording: &Recording, outputs: &[Compared]) -> String {
    let mut text: String = "t_s".into();
    for output in outputs {
        text += &format!(",{0}_measured,{0}_predicted,{0}_half_width", output.name);
    }
    for (row, t_s) in recording.time_s.iter().enumerate() {
        text += &format!("\n{t_s}");
        for output in outputs {
            text +=
                &format!(",{},{},{}", output.measured[row], output.predicted[row], output.half_width[row]);
        }
    }
    text + "\n"
}
