//! `softtwin inspect`: a model here, a scene and a table of a bench in their modules.

mod scene;
mod table;

use crate::failure::usage;
use crate::{card, files, output};
use rom::halfwidths::HalfWidths;
use rom::hull::TrainingRange;
use rom::model::{Model, ModelHeader, RegimeModel};
use serde_json::{Value, json};
use std::path::PathBuf;
use train::datasheet::{DataSheet, FitSheet};
use wire::layout::hex;

const EXAMPLES: &str = "\
Examples:
    softtwin inspect finger.twin
    softtwin inspect finger.twin --json | python3 -m json.tool
  What a scene will load, how many bytes, and how long a sample takes, measured here and now:
    softtwin inspect config/scenes/finger.toml
  What a table of a bench contains, with a picture of every column and a mapping to complete:
    softtwin inspect run.csv --out log.toml --picture columns.svg
  The model's card for a catalogue, as a page, or as a submodel of the Asset Administration Shell:
    softtwin inspect finger.twin --card markdown
    softtwin inspect finger.twin --card aas --licence 'CC-BY-4.0'

The data sheet in the same folder (finger.json) names the kernel of every group and the error of every \
training case when it was left out, and its card (finger.card.json, schema in docs/card.schema.json). A mapping names the columns of a table by \
number or heading; columns whose unit could not be read from the heading are comments in it: fill them in by hand.";

/// Show what a model holds, what a scene will load, or which columns a table has.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model (.twin), whose checksums are verified on the way; scene (.toml); or a bench's table (any other ending).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Print the model's card instead: inputs, outputs, ranges, accuracy, provenance, licence.
    #[arg(long, value_name = "FORMAT", value_enum, conflicts_with = "json")]
    card: Option<CardFormat>,
    /// Licence in the card; when left out, that of the card beside the model.
    #[arg(long, value_name = "TEXT", requires = "card")]
    licence: Option<String>,
    /// Mapping of a table's columns to write.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "card")]
    out: Option<PathBuf>,
    /// Picture of all columns of a table (.svg or .png).
    #[arg(long, value_name = "FILE", conflicts_with = "card")]
    picture: Option<PathBuf>,
}

/// How a card is printed.
#[derive(Clone, Copy, clap::ValueEnum)]
enum CardFormat {
    /// As it lies beside the model.
    Json,
    /// A page.
    Markdown,
    /// A submodel of the Asset Administration Shell, as JSON.
    Aas,
}

impl Args {
    /// Prints what the file holds, by its ending.
    pub fn run(self) -> anyhow::Result<()> {
        match self.file.extension().and_then(|ending| ending.to_str()) {
            Some(ending) if !["twin", "toml"].contains(&ending) && self.card.is_none() => {
                return table::describe(&self.file, self.out.as_deref(), self.picture.as_deref(), self.json);
            }
            _ if self.out.is_some() || self.picture.is_some() => {
                return Err(usage("--out and --picture belong to a table"));
            }
            Some("toml") if self.card.is_none() => return scene::explain_scene(&self.file, self.json),
            _ => {}
        }
        let (model, hash) = files::model_and_hash(&self.file)?;
        if let Some(format) = self.card {
            let card = card::of(&self.file, &model, &hash, self.licence.as_deref());
            let text = match format {
                CardFormat::Json => format!("{card:#}\n"),
                CardFormat::Markdown => card::markdown(&card),
                CardFormat::Aas => format!("{:#}\n", card::submodel(&card)),
            };
            return Ok(output!("{}", text.trim_end())?);
        }
        if self.json { output::json(&as_json(&model)) } else { text(&model) }
    }
}

fn as_json(model: &Model) -> Value {
    let header = &model.header;
    json!({
        "actuator": header.actuator,
        "source": if model.is_measured() { "measured" } else { "finite elements" },
        "node_count": header.node_count,
        "inputs": header.taken_inputs().map(|(_, i)| json!({
            "name": i.key(), "unit": i.unit, "min": finite(i.range[0]), "max": finite(i.range[1]), "nominal": i.value }))
            .collect::<Vec<_>>(),
        "database_hash": hex(&header.database_hash),
        "fields": header.fields.iter().map(|f| json!({
            "name": f.spec.name, "unit": f.spec.unit, "derived": f.magnitude_of.is_some() })).collect::<Vec<_>>(),
        "node_sets": header.node_sets.iter().map(|s| (s.name.clone(), json!(s.nodes.len())))
            .collect::<serde_json::Map<_, _>>(),
        "hysteresis_mpa": header.hysteresis_mpa,
        "pressure_limit": header.limit,
        "sag_mm": header.onset.as_ref().map(|t| t.sag_mm()),
        "reach_mm": header.onset.as_ref().map(|t| t.reach_mm()),
        "regimes": header.regimes.iter().map(|r| (r.kind.name().to_owned(), regime_json(header, r)))
            .collect::<serde_json::Map<_, _>>(),
        "outputs": train::measured::outputs(model).into_iter()
            .map(|output| (output.name, json!({ "half_width": output.half_width })))
            .collect::<serde_json::Map<_, _>>(),
        "bytes": bytes(model),
    })
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn regime_json(header: &ModelHeader, regime: &RegimeModel) -> Value {
    json!({
        "inputs": regime.inputs.axes.iter().map(|a| json!({
            "name": header.inputs[a.input].key(), "min": a.min, "max": a.max })).collect::<Vec<_>>(),
        "modes": regime.groups.iter().map(|g| (g.name.clone(), json!(g.coefficients.len())))
            .collect::<serde_json::Map<_, _>>(),
        "kernels": regime.groups.iter().map(|g| (g.name.clone(), json!(g.surrogate.kernel)))
            .collect::<serde_json::Map<_, _>>(),
        "force": regime.force.as_ref().map(|f| json!(f.surrogate.kernel)),
        "half_widths": header.known_halfwidths(regime.halfwidths),
        "measured_difference": regime.difference.as_ref().map(|of| json!({
            "modes": of.coefficients.len(), "centres": of.centres.len(), "half_width_mm": of.residual_mm, "half_width_elsewhere_mm": of.difference_mm })),
    })
}

fn text(model: &Model) -> anyhow::Result<()> {
    let header = &model.header;
    let fields: Vec<String> =
        header.fields.iter().map(|f| format!("{} [{}]", f.spec.name, f.spec.unit)).collect();
    let source = if model.is_measured() { " (measured)" } else { "" };
    output!("actuator    {}{source}", header.actuator)?;
    output!("fields      {} on {} nodes", fields.join(", "), header.node_count)?;
    if let Some(limit) = &header.limit {
        output!("limit       {} MPa: {}", limit.pressure_mpa, limit.reason)?;
    }
    let sets: Vec<String> =
        header.node_sets.iter().map(|s| format!("{} ({})", s.name, s.nodes.len())).collect();
    output!("node sets   {}", if sets.is_empty() { "none".into() } else { sets.join(", ") })?;
    output!("database    blake3 {}", hex(&header.database_hash))?;
    output!("size        {:.1} MB", bytes(model) as f64 / 1e6)?;
    for input in header.inputs.iter().filter(|input| input.value.is_some()) {
        let (range, nominal) = (input.range, input.value.unwrap_or(f64::NAN));
        output!(
            "parameter   {} = {nominal} {} nominal, trained {} .. {}",
            input.key(),
            input.unit,
            range[0],
            range[1]
        )?;
    }
    if let Some(onset) = &header.onset {
        let (sag, reach) = (onset.sag_mm(), onset.reach_mm());
        output!("onset       by its weight up to gap {sag:.2} mm; never beyond {reach:.2} mm")?;
    }
    for regime in &header.regimes {
        output!("\nregime {}", regime.kind.name())?;
        for axis in &regime.inputs.axes {
            let [min, max] = [axis.min, axis.max].map(|v| (v * 1e4).round() / 1e4);
            output!("  {:<12} {min} .. {max}", header.inputs[axis.input].key())?;
        }
        let domain = match &regime.domain {
            TrainingRange::Interval(_) => "the interval of its samples".into(),
            TrainingRange::Product { reach, .. } if regime.inputs.operating() == 0 => {
                format!("the ranges of its inputs, within {reach:.2} of a sample")
            }
            TrainingRange::Product { reach, .. } => format!(
                "the hull of its samples over pressure and gap, the ranges of the parameters, within {reach:.2} of a sample"
            ),
            hull => format!("the convex hull of its samples, {} vertices", hull.vertex_count()),
        };
        output!("  domain       {domain}")?;
        for group in &regime.groups {
            let (modes, kernel) = (group.coefficients.len(), &group.surrogate);
            output!(
                "  {:<12} {modes:>2} modes, {} centres, {}, {}",
                group.name,
                kernel.centre_count(),
                kernel.kernel,
                kernel.tail
            )?;
        }
        if let Some(force) = &regime.force {
            let fit = &force.surrogate;
            output!("  {:<12} {} centres, {}, {}", "force", fit.centre_count(), fit.kernel, fit.tail)?;
        }
        if let Some(of) = &regime.difference {
            output!(
                "  {:<12} {:>2} modes, {} centres, +- {:.3} mm where measured, {:.3} elsewhere",
                "measured",
                of.coefficients.len(),
                of.centres.len(),
                of.residual_mm,
                of.difference_mm
            )?;
        }
        let halfwidths = regime.halfwidths;
        if model.is_measured() {
            for output in train::measured::outputs(model) {
                let (share, width) = (halfwidths.coverage * 100.0, output.half_width);
                output!("  {share:.0} % within  {} +- {width:.4}", output.name)?;
            }
            continue;
        }
        let HalfWidths { coverage, displacement_mm, stress_mpa, force_n } =
            header.known_halfwidths(halfwidths);
        let widths =
            [("displacement", displacement_mm, "mm"), ("stress", stress_mpa, "MPa"), ("force", force_n, "N")];
        let known = widths.iter().filter(|(_, value, _)| !value.is_nan());
        let known: Vec<String> =
            known.map(|(name, value, unit)| format!("{name} {value:.2e} {unit}")).collect();
        output!("  {:.0} % within  {}", coverage * 100.0, known.join(", "))?;
    }
    Ok(())
}

/// The choices of a data sheet as a table.
pub fn sheet_table(sheet: &DataSheet) -> anyhow::Result<()> {
    for regime in &sheet.regimes {
        output!(
            "\nregime {}: {} cases + {} on the onset",
            regime.kind.name(),
            regime.cases,
            regime.boundary_states
        )?;
        output!(
            "  {:<14}{:>5}  {:<32}{:>10}{:>15}{:>14}",
            "group",
            "modes",
            "kernel",
            "condition",
            "leave-one-out",
            "truncation"
        )?;
        for fit in regime.groups.iter().chain(&regime.force) {
            output!("  {}", fit_line(fit))?;
        }
        let halfwidths = regime.halfwidths;
        let mut widths = vec![format!("{:.2e} mm", halfwidths.displacement_mm)];
        widths.extend(sheet.has_stress().then(|| format!("{:.2e} MPa", halfwidths.stress_mpa)));
        widths.extend(sheet.has_forces().then(|| format!("{:.2e} N", halfwidths.force_n)));
        output!(
            "  {:.0} % of held-out states have errors below {} at their worst node",
            halfwidths.coverage * 100.0,
            widths.join(", ")
        )?;
    }
    for remark in &sheet.remarks {
        output!("note: {remark}")?;
    }
    Ok(())
}

fn fit_line(fit: &FitSheet) -> String {
    let kernel = fit.candidates.first().map_or("", |c| c.kernel.as_str());
    format!(
        "{:<14}{:>5}  {kernel:<32}{:>10.1e}{:>15.2e}{:>14.1e}",
        fit.name, fit.modes, fit.condition, fit.leave_one_out, fit.truncation_error
    )
}

fn bytes(model: &Model) -> usize {
    model.blocks.iter().map(|(_, block)| block.byte_count()).sum()
}
