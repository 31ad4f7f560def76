//! Size and limits of a sweep over a model's contact states.

use super::checks::Sweep;
use softtwin::range;

/// How many states, and what counts as continuous.
#[derive(clap::Args)]
pub struct Extent {
    /// Random states inside the contact training range (1 to 10000000).
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = range::count(1, 10_000_000))]
    pub states: usize,
    /// Gaps along the onset at which both regimes are compared (2 to 100000).
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = range::count(2, 100_000))]
    pub gaps: usize,
    /// Seed of the random states.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Computing")]
    pub seed: u64,
    /// Largest jump of a coordinate at the onset that is accepted, in mm.
    #[arg(long, value_name = "MM", default_value_t = 0.05, value_parser = range::number(0.0, 1e3))]
    pub jump_mm: f64,
    /// Largest jump of the force at the onset that is accepted, in N.
    #[arg(long, value_name = "N", default_value_t = 1e-3, value_parser = range::number(0.0, 1e3))]
    pub jump_n: f64,
    /// Largest jump of the stress at the onset that is accepted, as a fraction of the state's largest stress (0 to 1).
    #[arg(long, value_name = "FRACTION", default_value_t = MAX_STRESS_JUMP, value_parser = range::number(0.0, 1.0))]
    pub jump_stress: f64,
}

/// Largest accepted jump of the stress at the onset, relative to the state's largest.
pub const MAX_STRESS_JUMP: f64 = 3e-3;

impl Extent {
    /// Sweeps over a model.
    pub fn sweep(&self, model: &rom::model::Model) -> anyhow::Result<Sweep> {
        Sweep::new(model, self.states, self.gaps, self.seed)
    }

    /// Fails when something does not hold.
    pub fn check(&self, sweep: &Sweep) -> anyhow::Result<()> {
        let (found, states) = (sweep.violation_count, sweep.states);
        anyhow::ensure!(
            found == 0,
            "{found} violations at {states} states; first: {}",
            sweep.violations.join("; ")
        );
        let (mm, n, stress) = (sweep.largest_jump_mm, sweep.largest_jump_n, sweep.largest_stress_jump);
        anyhow::ensure!(
            mm <= self.jump_mm && n <= self.jump_n && stress <= self.jump_stress,
            "the regimes do not meet at the onset: expected jumps of at most {} mm, {} N and a fraction of {} of the largest \
             stress, found {mm} mm, {n} N and {stress:.4}",
            self.jump_mm,
            self.jump_n,
            self.jump_stress
        );
        Ok(())
    }
}
