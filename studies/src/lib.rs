//! Measurements of the project, one module per command of `softtwin-studies`.
#![forbid(unsafe_code)]
#![warn(clippy::print_stdout)]

mod bench;
mod blocked;
mod control;
mod estimation;
mod hard_cases;
mod hardware;
mod jumps;
mod learning;
mod measure;
mod peers;
mod plant;
mod python;
mod random_shapes;
mod report;
mod restart;
mod scale;
mod slope;
mod soak;
mod stats;
mod sweep;
pub mod synthetic;
mod testbed;
mod trace;
mod validate;
pub mod verify;

/// A study; each variant's help is the doc comment of its `Args`.
#[derive(clap::Subcommand)]
pub enum Command {
    Report(report::Args),
    Validate(validate::Args),
    Trace(trace::Args),
    HardCases(hard_cases::Args),
    Hardware(hardware::Args),
    Blocked(blocked::Args),
    RandomShapes(random_shapes::Args),
    Scale(scale::Args),
    Sweep(sweep::Args),
    Learning(learning::Args),
    Estimation(estimation::Args),
    Measure(measure::Args),
    Control(control::Args),
    Bench(bench::Args),
    Plant(plant::on_wire::Args),
    Rig(plant::modbus::Args),
    Peers(peers::Args),
    Soak(soak::Args),
    Cycles(soak::cycles::Args),
    Restart(restart::Args),
}

impl Command {
    /// Runs the study.
    ///
    /// # Errors
    /// The error, or the missed bounds.
    pub fn run(self) -> anyhow::Result<()> {
        match self {
            Self::Report(args) => args.run(),
            Self::Validate(args) => args.run(),
            Self::Trace(args) => args.run(),
            Self::HardCases(args) => args.run(),
            Self::Hardware(args) => args.run(),
            Self::Blocked(args) => args.run(),
            Self::RandomShapes(args) => args.run(),
            Self::Scale(args) => args.run(),
            Self::Sweep(args) => args.run(),
            Self::Learning(args) => args.run(),
            Self::Estimation(args) => args.run(),
            Self::Measure(args) => args.run(),
            Self::Control(args) => args.run(),
            Self::Bench(args) => args.run(),
            Self::Plant(args) => args.run(),
            Self::Rig(args) => args.run(),
            Self::Peers(args) => args.run(),
            Self::Soak(args) => args.run(),
            Self::Cycles(args) => args.run(),
            Self::Restart(args) => args.run(),
        }
    }
}
