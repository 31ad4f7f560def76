//! `softtwin inspect`: what a model, a scene or a table of a bench contains.

mod contents;

use self::contents::Contents;
use crate::failure::{configuration, usage};
use crate::picture::{Figure, Panel, Series};
use crate::{files, output, report};
use formats::log::{Log, TableDescription, describe};
use formats::table::TableForm;
use runtime::config::Scene;
use runtime::explain::{Explained, explain};
use runtime::load::load_scene;
use std::path::{Path, PathBuf};
use train::card;

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
                return describe_table(&self.file, self.out.as_deref(), self.picture.as_deref(), self.json);
            }
            _ if self.out.is_some() || self.picture.is_some() => {
                return Err(usage("--out and --picture belong to a table"));
            }
            Some("toml") if self.card.is_none() => return explain_scene(&self.file, self.json),
            _ => {}
        }
        let (model, hash) = files::model_and_hash(&self.file)?;
        if let Some(format) = self.card {
            let card = card::card(&self.file, &model, &hash, self.licence.as_deref());
            let text = match format {
                CardFormat::Json => format!("{card:#}\n"),
                CardFormat::Markdown => card::markdown(&card),
                CardFormat::Aas => format!("{:#}\n", card::submodel(&card)),
            };
            return Ok(output!("{}", text.trim_end())?);
        }
        report::print(&Contents::of(&model), self.json)
    }
}

/// Prints what each actuator of a scene loads and costs.
fn explain_scene(path: &Path, json: bool) -> anyhow::Result<()> {
    let scene = Scene::load(path).map_err(configuration)?;
    let loaded = load_scene(&scene, path).map_err(configuration)?;
    let explained: Vec<Explained> = loaded.iter().map(explain).collect();
    report::print(&explained, json)
}

/// Describes a table and proposes a mapping of its columns.
fn describe_table(file: &Path, out: Option<&Path>, picture: Option<&Path>, json: bool) -> anyhow::Result<()> {
    let log = Log::read(file, &TableForm::default()).map_err(files::refusal)?;
    let found = describe(&log, &file.display().to_string());
    if let Some(out) = out {
        files::save(out, found.mapping.as_bytes())?;
    }
    if let Some(picture) = picture {
        columns_figure(&log, &found).save(picture)?;
    }
    report::print(&found, json)?;
    match out {
        _ if json => {}
        Some(out) => output!("mapping to complete: {}", out.display())?,
        None => output!("\n{}", found.mapping.trim_end())?,
    }
    Ok(())
}

fn columns_figure(log: &Log, found: &TableDescription) -> Figure {
    let rows: Vec<f64> = (0..log.rows()).map(|row| row as f64).collect();
    let x = found.time_column.map_or(&rows, |number| &log.columns[number - 1]);
    let first = x.first().copied().unwrap_or(0.0);
    let label = if found.time_column.is_some() { "time, in the column's unit" } else { "row" };
    let others = found.columns.iter().filter(|column| Some(column.column) != found.time_column);
    let panels = others.map(|column| {
        let points = x.iter().zip(&log.columns[column.column - 1]).map(|(x, y)| (x - first, *y));
        let y = match &column.unit {
            _ if column.constant => "constant",
            unit => unit.as_deref().unwrap_or("unit not known"),
        };
        let title = format!("{} {}", column.column, column.heading);
        Panel::new(title, label, y, vec![Series::line("", 0, points)])
    });
    Figure { title: "columns against time".into(), panels: panels.collect(), columns: 3 }
}
