//! The kernel at the pace of a twin at 1 kHz: between two fields other programs use the caches, and a core that sleeps gets slower.

use super::measure::Series;
use rom::kernel::Basis;
use serde::Serialize;
use std::thread::sleep;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(1);
/// Kernels at the start that are not measured.
const UNTIL_STEADY: usize = 5;

/// Median of the kernel, once a millisecond.
#[derive(Debug, Clone, Serialize)]
pub struct Paced {
    /// Asleep until it is time.
    pub asleep_us_p50: f64,
}

/// Measures the kernel once a millisecond; returns the median and the distribution.
pub fn run(basis: &Basis, coefficients: &[f64], samples: usize) -> anyhow::Result<(Paced, Series)> {
    let mut series = Series::new("kernel, asleep until 1 kHz".to_owned());
    let mut out = vec![0.0; basis.output_len()];
    let mut due = Instant::now();
    for number in 0..UNTIL_STEADY + samples {
        due = Instant::now().max(due + PERIOD);
        sleep(due.saturating_duration_since(Instant::now()));
        if number < UNTIL_STEADY {
            basis.reconstruct(coefficients, &mut out)?;
        } else {
            series.time(|| basis.reconstruct(coefficients, &mut out));
        }
    }
    Ok((Paced { asleep_us_p50: series.p50() }, series))
}
