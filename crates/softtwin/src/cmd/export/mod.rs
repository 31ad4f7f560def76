//! `softtwin export`: states as files that other programs open.

mod fmu;
mod page;
mod recorded;
mod source;

use crate::failure::{configuration, usage};
use crate::{files, output, report};
use anyhow::Result;
use formats::export::SeriesFormat;
use recording::{ExportError, TableForm, export_csv};
use serde_json::{Map, Value, json};
pub use source::is_recording;
use source::{ExportSource, Options};
use std::path::PathBuf;
use wire::KeyExpr;

const EXAMPLES: &str = "\
Examples:
  A sweep of predictions for ParaView (one .vtu a state, the .pvd opens them all):
    softtwin export finger.twin --pressure 0.01,0.025,0.04,0.055,0.07 \\
      --gap 40 --out sweep.pvd
  The same with the inside of the body (the model itself knows its surface only), for Tecplot:
    softtwin export finger.twin --pressure 0.01,0.04,0.07 \\
      --mesh mesh.vtu --out sweep.dat
  Of a model over parameters, with another wall; the displacement is that from the mesh of this wall:
    softtwin export design.twin --pressure 0.05 --gap 40 \\
      --set chambers.length_mm=3.2 --out wall.pvd
  Two cases of a database, or all of them as one array (cases x nodes x fields):
    softtwin export models/pneunet/database --case A --case C --out cases.xdmf
    softtwin export models/pneunet/database --out all.npy
  A recording: its recorded fields, or fields computed from its states by the model, every tenth:
    softtwin export run.mcap --out run.pvd
    softtwin export run.mcap --key softtwin/finger/field/tip --out tip.csv
    softtwin export run.mcap --model finger.twin --every 10 --out run.pvd
  A recording as CSV tables, one for each topic (tables/softtwin.finger.state.csv and so on), or its states only:
    softtwin export run.mcap --out tables
    softtwin export run.mcap --out tables --key 'softtwin/*/state'
  The same as inputs of a simulation in FMI tools: time in s and numbers only
    softtwin export run.mcap --fmi --out tables --key 'softtwin/*/state'
  All files of a recorder that rotates, as one recording; of one series where the folder holds several:
    softtwin export /var/lib/softtwin --out tables
    softtwin export /var/lib/softtwin/finger --out tables
  A page that anyone can open and move, without softtwin and without a network; with a recording or a trace that plays in it:
    softtwin export finger.twin --out finger.html
    softtwin export finger.twin --recording run.mcap --out run.html
  A model for Simulink, Modelica and others, as an FMU of FMI 3.0, with two nodes as outputs (docs/fmi.md):
    softtwin export finger.twin --fmu finger.fmu --node tip=9696 \\
      --node middle=120
  A table of a bench as a trace for replay, bridge and import: t_s and the names of the mapping
    softtwin export run.csv --log log.toml --out trace.csv

Endings of --out: none (a folder of tables), .pvd (VTU series, ParaView), .dat (Tecplot ASCII), .xdmf, .csv (a row per node and state), .npy, .html (a page with the model in it), .fmu (--fmu FILE is the same as --out FILE). \
VTU files (as field data) and CSV files (as columns) carry every input, the contact force, the observables and the name of the case.";

/// Export predictions, a database or a recording as VTU series, Tecplot, XDMF, CSV or NumPy files; a recording as tables.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Source: a model (.twin), a database folder, a recording (.mcap, or a folder of rotated files), or a bench's table with --log.
    #[arg(value_name = "SOURCE")]
    source: PathBuf,
    /// File to write; its ending says the format. Of a recording also a folder, for tables.
    #[arg(long, alias = "fmu", value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    states: Options,
    /// Mapping of the columns of a bench's table.
    #[arg(long, value_name = "FILE.toml")]
    log: Option<PathBuf>,
    /// Topics of a recording, as a key expression; selects one of several field topics.
    #[arg(long, value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// Tables of a recording have time in s and scalar columns only, as FMI tools read them.
    #[arg(long)]
    fmi: bool,
    /// Undeformed mesh (.vtu, .msh, .inp) whose cells the states shall have; the surface when left out.
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Node whose fields are outputs of an FMU, by its number from 0 [default: the middle of the end along x]. Repeatable.
    #[arg(long = "node", value_name = "NAME=NUMBER", value_parser = fmu::chosen)]
    nodes: Vec<::fmu::ChosenNode>,
    /// Recording, or trace of inputs (.csv), that plays in a page.
    #[arg(long, value_name = "FILE")]
    recording: Option<PathBuf>,
    /// End with one JSON object.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Writes the files and names them.
    ///
    /// # Errors
    /// A source that cannot be read, options that do not belong to it, a file that cannot be written.
    pub fn run(self) -> Result<()> {
        if let Some(log) = &self.log {
            let recording = files::bench_run(&self.source, log)?;
            files::save(&self.out, recording.csv().as_bytes())?;
            recording.remarks.iter().try_for_each(|remark| output!("  note: {remark}"))?;
            return Ok(output!("{} rows in {}", recording.time_s.len(), self.out.display())?);
        }
        if is_recording(&self.source) && self.out.extension().is_none() {
            let form = if self.fmi { TableForm::Fmi } else { TableForm::Whole };
            return self.tables(form);
        }
        if self.fmi {
            return Err(usage(
                "--fmi belongs to tables of a recording: softtwin export RUN.mcap --fmi --out FOLDER",
            ));
        }
        if self.out.extension().is_some_and(|ending| ending == "html") {
            return page::write(&self.source, self.recording.as_deref(), &self.out, self.json);
        }
        if self.recording.is_some() {
            return Err(usage("--recording plays in a page: --out FILE.html"));
        }
        if self.out.extension().is_some_and(|ending| ending == "fmu") {
            return fmu::write(&self.source, &self.out, self.nodes, self.json);
        }
        if !self.nodes.is_empty() {
            return Err(usage("--node belongs to an FMU: --out FILE.fmu"));
        }
        SeriesFormat::of(&self.out).map_err(usage)?; // before the work, not after it
        if let Some(folder) = self.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            formats::file::create_folder(folder)?;
        }
        let source = ExportSource::open(&self.source, &self.states, &self.key)?;
        let body = source.body(self.mesh.as_deref())?;
        let series = body.series(source.fields(), source.count());
        let written = series.write(&self.out, source.moments()).map_err(|error: anyhow::Error| {
            error.downcast::<formats::FormatError>().map_or_else(|other| other, files::refusal)
        })?;
        if self.json {
            return output::json(&json!({ "states": source.count(), "files": written }));
        }
        let more = if written.len() > 1 {
            format!(" and {} files beside it", written.len() - 1)
        } else {
            String::new()
        };
        output!("{}{more}: {} states of {} nodes", self.out.display(), source.count(), body.nodes)?;
        Ok(())
    }

    /// A recording as CSV tables, one for each topic.
    fn tables(&self, form: TableForm) -> Result<()> {
        let topics = KeyExpr::new(&self.key).map_err(usage)?;
        let mut reader = files::recording(&self.source).map_err(configuration)?.reader();
        formats::file::create_folder(&self.out)?;
        let exported = export_csv(&mut reader, &self.out, &topics, form).map_err(|error| match error {
            error @ ExportError::Read(_) => configuration(error),
            error => error.into(),
        })?;
        let rows: Map<String, Value> =
            exported.rows.iter().map(|(path, rows)| (path.display().to_string(), json!(rows))).collect();
        let found = json!({"rows": rows, "left_out": exported.left_out, "ending": reader.ending()});
        report::print(&found, self.json)
    }
}
