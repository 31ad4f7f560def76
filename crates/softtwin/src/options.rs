//! Options that several commands share.

use formats::database::ObstacleKind;
use std::path::PathBuf;

/// The actuator that is simulated.
#[derive(clap::Args, Debug)]
pub struct ActuatorFile {
    /// Geometry, materials, loads, supports and mesh, such as models/pneunet/actuator.toml.
    #[arg(long, value_name = "FILE.toml")]
    pub actuator: PathBuf,
}

/// `NAME=VALUE`, as `--set` takes it.
pub fn setting(text: &str) -> Result<(String, f64), String> {
    let expected = || {
        format!("expected NAME=VALUE with a finite number, such as elastomer.law.mu_mpa=0.72; found {text:?}")
    };
    let (name, value) = text.split_once('=').ok_or_else(expected)?;
    let value = value.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(expected)?;
    Ok((name.trim().to_owned(), value))
}

/// Obstacle, as `--obstacle` names it.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub enum ObstacleArg {
    /// The actuator over a plate.
    #[default]
    Plate,
    /// The finger of a gripper before a block.
    Gripper,
}

impl From<ObstacleArg> for ObstacleKind {
    fn from(arg: ObstacleArg) -> Self {
        match arg {
            ObstacleArg::Plate => Self::Plate,
            ObstacleArg::Gripper => Self::Block,
        }
    }
}
