//! The sub-commands, one file each. To add one: a `mod` line and a line in `commands!`.
//!
//! A command's file has a `pub struct Args` (clap derive: names, units, examples) and `impl Args { pub fn run(self) ->
//! anyhow::Result<()> }`. What the user got wrong is marked with [`crate::failure`]; results are printed with `output!`.

use cli::demo;

pub mod bench;
mod calibrate;
mod doctor;
mod echo;
mod evaluate;
mod export;
mod get;
mod grasp;
mod hz;
mod import;
mod info;
mod inspect;
mod list;
mod manual;
mod mesh;
mod pack;
mod plot;
mod predict;
mod record;
mod render;
mod replay;
mod sample;
mod scene;
mod simulate;
pub mod stability;
mod top;
mod train;
mod view;

/// Declares the enum clap parses into and its dispatch.
macro_rules! commands {
    ($($variant:ident => $module:ident),* $(,)?) => {
        /// Sub-command; each variant's text is the doc comment of its `Args`.
        #[derive(clap::Subcommand)]
        pub enum Command { $(#[allow(missing_docs)] $variant($module::Args),)* }

        impl Command {
            /// Runs the chosen command.
            pub fn run(self) -> anyhow::Result<()> {
                match self { $(Self::$variant(args) => args.run(),)* }
            }
        }
    };
}

commands! {
    Record => record,
    Replay => replay,
    Top => top,
    Doctor => doctor,
    Train => train,
    Inspect => inspect,
    Pack => pack,
    Predict => predict,
    Export => export,
    Import => import,
    Demo => demo,
    List => list,
    Info => info,
    Echo => echo,
    Hz => hz,
    Get => get,
    Grasp => grasp,
    Scene => scene,
    Mesh => mesh,
    Sample => sample,
    Simulate => simulate,
    Evaluate => evaluate,
    Calibrate => calibrate,
    Plot => plot,
    Render => render,
    View => view,
    Bench => bench,
    Stability => stability,
    Manual => manual,
}
