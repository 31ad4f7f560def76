//! Opening and saving what commands work on, with errors that say whose mistake it was.

use crate::failure::{configuration, usage};
use anyhow::{Context, bail};
use fem::actuator::{Actuator, GridError};
use fem::build::BuildError;
use fem::plan::PlanError;
use fem::run::RunError;
use fem::{Family, Problem};
use formats::database::{self, ObstacleKind};
pub use formats::file::quoted;
use formats::results::ImportError;
use formats::{FormatError, file, log};
use recording::RecordingFiles;
use rom::model::{Model, ModelFileError};
use rom::model_state::ModelState;
use rom::reconstructor::{Peaks, ReconstructError};
use rom::snapshots::Database;
use std::path::Path;
use std::sync::Arc;
use train::TrainError;
use train::comparison::ComparisonError;
use train::trace::TraceError;

/// Loads a whole model.
pub fn model(path: &Path) -> anyhow::Result<Model> {
    Ok(model_and_hash(path)?.0)
}

/// Loads a whole model with the hash at the file's end, whose first half is in the headers of its fields.
pub fn model_and_hash(path: &Path) -> anyhow::Result<(Model, [u8; 32])> {
    Model::read(path).map_err(|error| {
        let is_missing = matches!(error, ModelFileError::Io(_));
        let place = path.display();
        let context = match is_missing {
            true => format!("cannot read the model {place}; `softtwin train` makes one"),
            false => place.to_string(),
        };
        let error = anyhow::Error::new(error).context(context);
        if is_missing { error } else { configuration(error) }
    })
}

/// Gives inputs of a model the values of `--set`.
pub fn set_parameters(model: &mut Model, settings: &[(String, f64)]) -> anyhow::Result<()> {
    let given = settings.iter().map(|(name, value)| (name.as_str(), *value));
    model.header.set_parameters(given).map_err(|error| usage(format!("--set: {error}")))?;
    Ok(())
}

/// Reads a table of a bench by the mapping of its columns.
pub fn bench_run(run: &Path, log: &Path) -> anyhow::Result<log::Recording> {
    log::Mapping::read(log).and_then(|mapping| mapping.read_run(run)).map_err(refusal)
}

/// The recording that a path names: a file, or the files of a recorder that rotates.
pub fn recording(path: &Path) -> anyhow::Result<RecordingFiles> {
    RecordingFiles::open(path).with_context(|| format!("cannot read the recording {}", path.display()))
}

/// Loads the cases of one scene of a database.
pub fn database(dir: &Path, scene: ObstacleKind) -> anyhow::Result<Database> {
    database::read(dir, scene).map_err(refusal)
}

/// Loads an actuator and the problem on its own mesh, ready to be solved.
pub fn actuator(path: &Path) -> anyhow::Result<(Actuator, Arc<Problem>)> {
    let actuator = Actuator::read(path).map_err(refusal)?;
    let mesh = actuator.read_mesh(path).map_err(refusal)?;
    let problem = Problem::new(mesh, actuator.problem_config()).map_err(configuration)?;
    Ok((actuator, Arc::new(problem)))
}

/// Loads an actuator with the problem on its own mesh, from which variants are made.
pub fn family(path: &Path) -> anyhow::Result<Family> {
    let (actuator, problem) = actuator(path)?;
    Ok(Family { actuator, problem })
}

/// The same on another mesh of the actuator.
pub fn family_on(path: &Path, mesh: &Path) -> anyhow::Result<Family> {
    let mut actuator = Actuator::read(path).map_err(refusal)?;
    (actuator.mesh.file, actuator.mesh.nodes) = (std::path::absolute(mesh)?, 0);
    let problem = Problem::new(actuator.read_mesh(path).map_err(refusal)?, actuator.problem_config());
    Ok(Family { problem: Arc::new(problem.map_err(configuration)?), actuator })
}

/// Invalid content is a configuration error; an I/O error is not.
pub fn refusal(error: FormatError) -> anyhow::Error {
    match error {
        FormatError::Io { .. } => error.into(),
        _ => configuration(error),
    }
}

/// What the user asked for or gave is a configuration error; a state that cannot be solved is not.
pub fn not_planned(error: PlanError) -> anyhow::Error {
    match error {
        PlanError::Files(error) => refusal(error),
        PlanError::Refused(_)
        | PlanError::Run(RunError::Variant { .. })
        | PlanError::Train(TrainError::Database(_) | TrainError::Config(_)) => configuration(error),
        _ => error.into(),
    }
}

/// A mesh that could not be made: of a wrong size, or a file that was not written.
pub fn not_gridded(error: GridError) -> anyhow::Error {
    if matches!(error, GridError::Size(_)) { usage(error) } else { error.into() }
}

/// A twin that could not be built: by whose mistake.
pub fn not_built(error: BuildError) -> anyhow::Error {
    match error {
        BuildError::Argument(_) => usage(error),
        BuildError::Grid(error) => not_gridded(error),
        BuildError::Problem(error) => configuration(error),
        BuildError::Plan(error) => not_planned(error),
        BuildError::Files(error) => refusal(error),
        _ => error.into(),
    }
}

/// Simulations that do not become a database: by whose mistake.
pub fn not_imported(error: ImportError) -> anyhow::Error {
    match error {
        ImportError::Usage(_) => usage(error),
        ImportError::Refused(_) => configuration(error),
        ImportError::File(error) => refusal(error),
    }
}

/// A comparison that cannot be made: by whose mistake.
pub fn not_compared(error: ComparisonError) -> anyhow::Error {
    match error {
        ComparisonError::NotLearned => usage(format!("--follow: {error}")),
        ComparisonError::MissingInput { .. }
        | ComparisonError::WrongUnit(_)
        | ComparisonError::NoOutput { .. }
        | ComparisonError::NoRow => configuration(error),
        _ => error.into(),
    }
}

/// A trace along which the model cannot be followed: by whose mistake.
pub fn not_followed(error: TraceError) -> anyhow::Error {
    match error {
        TraceError::File(error) => refusal(error),
        TraceError::TooLong { .. } | TraceError::NoCoordinate { .. } | TraceError::NoTip => {
            usage(format!("--trace: {error}"))
        }
        _ => error.into(),
    }
}

/// Replaces a file as a whole: a reader sees the old one or the new one, never a part.
pub fn save(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    Ok(file::replace(path, bytes)?)
}

/// The peaks of a state that has an answer; with `says`, a line on standard error about one outside the training range.
///
/// # Errors
/// A state that the model refuses, with the inputs that are outside and by how much.
pub fn answered(
    state: &ModelState,
    peaks: Result<Peaks, ReconstructError>,
    says: bool,
) -> anyhow::Result<Peaks> {
    let (evaluator, evaluation) = (state.evaluator(), state.evaluation());
    if let Some(why) = evaluator.refusal(evaluation) {
        bail!(why);
    }
    if let Some(why) = evaluator.outside(evaluation).filter(|_| says) {
        let widths =
            if evaluator.learned().is_some() { "wider half-widths or none" } else { "no half-widths" };
        tracing::warn!("outside the training range, so the answer has {widths}: {why}");
    }
    Ok(peaks?)
}
