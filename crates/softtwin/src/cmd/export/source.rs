//! Where exported states come from: a model asked for readings, a database, the fields of a recording.

use super::recorded::Recorded;
use crate::failure::usage;
use crate::files;
use crate::options::setting;
use anyhow::Result;
use formats::database::ObstacleKind;
use formats::export::{ExportBody, Label, Moment};
use recording::RecordedField;
use recording::RecordingFiles;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::snapshots::{Database, FieldKind, FieldSpec};
use std::path::{Path, PathBuf};
use wire::KeyExpr;
use wire::layout::{InputValue, field_id};

/// Which states of a source.
#[derive(clap::Args)]
pub struct Options {
    /// Pressures to predict with a model: MPa, or with a unit (50kPa, 0.5bar, 7psi).
    #[arg(long = "pressure", value_name = "MPA,...", value_delimiter = ',', value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pressure_mpa: Vec<f64>,
    /// Gap of a model's predictions, in mm [default: no obstacle].
    #[arg(long = "gap", value_name = "MM", value_parser = crate::range::gap_mm, help_heading = "State")]
    gap_mm: Option<f64>,
    /// Value of a model's parameter, such as elastomer.law.mu_mpa=0.72 [default: nominal].
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting, help_heading = "State")]
    set: Vec<(String, f64)>,
    /// Names of a database's cases [default: all].
    #[arg(long, value_name = "NAME", help_heading = "State")]
    case: Vec<String>,
    /// Model that computes the fields of a recording [default: recorded fields are exported].
    #[arg(long, value_name = "FILE.twin")]
    model: Option<PathBuf>,
    /// Actuator of a recording with several.
    #[arg(long, value_name = "NAME", help_heading = "Selection")]
    actuator: Option<String>,
    /// Take every n-th state only (1 to 1000000000).
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = crate::range::count(1, 1_000_000_000), help_heading = "Selection")]
    every: usize,
}

/// Opened, and every option checked.
pub enum ExportSource {
    /// Readings that a model answers: time, pressure and gap.
    Readings { model: Box<Model>, fields: Vec<FieldSpec>, readings: Vec<(f64, Inputs)> },
    /// Cases of a database.
    Cases { database: Box<Database>, chosen: Vec<usize> },
    /// Recorded states that a model makes fields of.
    Replayed { model: Box<Model>, fields: Vec<FieldSpec>, recorded: Recorded },
    /// Recorded fields.
    Recorded { recorded: Recorded, fields: Vec<FieldSpec> },
}

impl ExportSource {
    /// Opens what the path names.
    ///
    /// # Errors
    /// A path that is none of the three, or options that belong to another kind.
    pub fn open(path: &Path, options: &Options, key: &str) -> Result<Self> {
        let ending = path.extension().and_then(|ending| ending.to_str());
        let kind = match ending {
            _ if is_recording(path) => "recording",
            _ if path.is_dir() => "database",
            Some("twin") => "model",
            _ => {
                return Err(usage(format!(
                    "expected a model (.twin), a database folder or a recording (.mcap, or a folder of them), found {}",
                    path.display()
                )));
            }
        };
        let given = [
            ("--pressure", "model", !options.pressure_mpa.is_empty()),
            ("--gap", "model", options.gap_mm.is_some()),
            ("--set", "model", !options.set.is_empty()),
            ("--case", "database", !options.case.is_empty()),
            ("--model", "recording", options.model.is_some()),
            ("--actuator", "recording", options.actuator.is_some()),
        ];
        if let Some((option, accepted, _)) =
            given.iter().find(|(_, accepted, given)| *given && *accepted != kind)
        {
            return Err(usage(format!("{option} belongs to a {accepted}; {} is a {kind}", path.display())));
        }
        match kind {
            "model" => Self::sweep(options, path),
            "database" => Self::cases(options, path),
            _ => Self::recording(options, path, key),
        }
    }

    fn sweep(options: &Options, path: &Path) -> Result<Self> {
        if options.pressure_mpa.is_empty() {
            return Err(usage(
                "of a model: expected --pressure P1,P2,... (and --gap), found none (and --gap)",
            ));
        }
        let gap_mm = options.gap_mm.unwrap_or(f64::INFINITY);
        let inputs = options.pressure_mpa.iter().map(|&pressure_mpa| Inputs::new(pressure_mpa, gap_mm));
        let readings = (0..).map(f64::from).zip(inputs).step_by(options.every).collect();
        let mut model = files::model(path)?;
        files::set_parameters(&mut model, &options.set)?;
        let fields = model.header.fields.iter().map(|field| field.spec.clone()).collect();
        Ok(Self::Readings { model: Box::new(model), fields, readings })
    }

    fn cases(options: &Options, path: &Path) -> Result<Self> {
        let scene = match formats::database::obstacle_kinds(path).as_deref() {
            Ok([only]) => *only,
            _ => ObstacleKind::Plate,
        };
        let database = files::database(path, scene)?;
        let place = |name: &String| {
            database.cases.iter().position(|case| case.name == *name).ok_or_else(|| {
                let names: Vec<&str> =
                    database.cases.iter().map(|case| case.name.as_str()).take(20).collect();
                usage(format!("--case {name}: the database has {} ...", names.join(", ")))
            })
        };
        let chosen: Vec<usize> = match options.case.as_slice() {
            [] => (0..database.cases.len()).collect(),
            names => names.iter().map(place).collect::<Result<_>>()?,
        };
        let chosen = chosen.into_iter().step_by(options.every).collect();
        Ok(Self::Cases { database: Box::new(database), chosen })
    }

    fn recording(options: &Options, path: &Path, key: &str) -> Result<Self> {
        let topics = KeyExpr::new(key).map_err(usage)?;
        let model = options.model.as_ref().map(|model| files::model(model)).transpose()?;
        let inputs = model.as_ref().map(|model| model.header.inputs.as_slice());
        let recorded = Recorded::find(path, topics, options.actuator.as_deref(), inputs, options.every)?;
        if let Some(model) = model {
            let fields = model.header.fields.iter().map(|field| field.spec.clone()).collect();
            return Ok(Self::Replayed { model: Box::new(model), fields, recorded });
        }
        let Some(first) = recorded.first_field() else {
            return Err(usage(
                "the recording holds no fields; name the model that makes them with --model FILE.twin",
            ));
        };
        let fields = first.fields().map(|id| spec(field_id::as_str(id))).collect();
        Ok(Self::Recorded { recorded, fields })
    }

    /// Fields of every state.
    pub fn fields(&self) -> &[FieldSpec] {
        match self {
            Self::Readings { fields, .. } | Self::Replayed { fields, .. } | Self::Recorded { fields, .. } => {
                fields
            }
            Self::Cases { database, .. } => &database.fields,
        }
    }

    /// How many states there are.
    pub fn count(&self) -> usize {
        match self {
            Self::Readings { readings, .. } => readings.len(),
            Self::Cases { chosen, .. } => chosen.len(),
            Self::Replayed { recorded, .. } | Self::Recorded { recorded, .. } => recorded.count(),
        }
    }

    /// The body the states belong to.
    ///
    /// # Errors
    /// A mesh file that does not fit.
    pub fn body(&self, mesh: Option<&Path>) -> Result<ExportBody> {
        let body = match self {
            Self::Readings { model, .. } | Self::Replayed { model, .. } => ExportBody::of_model(model),
            Self::Cases { database, .. } => ExportBody::of_database(database),
            Self::Recorded { recorded, .. } => {
                ExportBody::of_points(recorded.first_field().map_or(0, |header| header.node_count as usize))
            }
        };
        body.with_mesh(mesh).map_err(files::refusal)
    }

    /// The states, made one after the other.
    pub fn moments(&self) -> Box<dyn Iterator<Item = Result<Moment>> + '_> {
        match self {
            Self::Readings { model, readings, .. } => predictions(model, readings.iter().map(|one| Ok(*one))),
            Self::Cases { database, chosen } => {
                Box::new(chosen.iter().map(|k| Ok(Moment::of_case(database, *k))))
            }
            Self::Replayed { model, recorded, .. } => predictions(model, recorded.readings()),
            Self::Recorded { recorded, .. } => Box::new(recorded.fields().map(|field| {
                let RecordedField { t_s, header, values } = field?;
                let (gap_mm, force_n) = (Some(header.gap_mm), header.contact_force_n);
                let parameters = header.inputs().filter(InputValue::is_parameter);
                let parameters = parameters.map(|input| (input.name, input.value));
                let label = Label::of_state(header.pressure_mpa, gap_mm, parameters, force_n);
                Ok(Moment { time: t_s, label, values, moved: None })
            })),
        }
    }
}

fn predictions<'a>(
    model: &'a Model,
    readings: impl Iterator<Item = Result<(f64, Inputs)>> + 'a,
) -> Box<dyn Iterator<Item = Result<Moment>> + 'a> {
    let mut state = match ModelState::new(model, &Selection::default()) {
        Ok(state) => state,
        Err(error) => return Box::new(std::iter::once(Err(error.into()))),
    };
    let observables = match Observables::of(model) {
        Ok(observables) => observables,
        Err(error) => return Box::new(std::iter::once(Err(error.into()))),
    };
    let mut was_outside = false;
    Box::new(readings.map(move |reading| {
        let (time, inputs) = reading?;
        let peaks = state.update(inputs);
        // One line for all states outside.
        files::answered(&state, peaks, !was_outside)?;
        was_outside |= state.evaluation().flags.extrapolated;
        Ok(Moment::of_model(model, &state, &observables, time))
    }))
}

/// Whether a path names a recording: a file, a folder of such files, one of several in a folder.
pub fn is_recording(path: &Path) -> bool {
    let of_name = path.extension().is_some_and(|ending| ending == "mcap");
    let in_folder = || RecordingFiles::all_in(path).is_ok_and(|all| !all.is_empty());
    of_name || in_folder() || (!path.exists() && RecordingFiles::open(path).is_ok())
}

/// A field of the wire by its name.
fn spec(name: &str) -> FieldSpec {
    let (unit, kind) = match name {
        "x" => ("mm", FieldKind::Coordinate(0)),
        "y" => ("mm", FieldKind::Coordinate(1)),
        "z" => ("mm", FieldKind::Coordinate(2)),
        "displacement" => ("mm", FieldKind::Magnitude),
        "von_mises" => ("MPa", FieldKind::Stress),
        _ => ("", FieldKind::Other),
    };
    FieldSpec { name: name.into(), unit: unit.into(), kind }
}
