//! The kernel at the pace of a twin at 1 kHz: between two fields other programs use the caches, and a core that sleeps gets slower.

use super::measure::Series;
use rom::kernel::Basis;
use serde::Serialize;
use std::thread::sleep;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(1);
/// How long before its time a kernel is prepared for: three quarters of a spin with a share of 0.4.
const AHEAD: Duration = Duration::from_micros(300);
/// Kernels in a row before the other way has its turn, and those before that are not measured.
const AT_ONCE: usize = 40;
const UNTIL_STEADY: usize = 5;

/// Medians of the kernel, once a millisecond.
#[derive(Debug, Clone, Serialize)]
pub struct Paced {
    /// Asleep until it is time.
    pub asleep_us_p50: f64,
    /// Awake and reading the basis ahead shortly before, as a twin does with `realtime.spin_share`.
    pub read_ahead_us_p50: f64,
}

/// Measures both ways in turn; returns the figures and the distributions.
pub fn run(basis: &Basis, coefficients: &[f64], samples: usize) -> anyhow::Result<(Paced, [Series; 2])> {
    let mut series =
        ["asleep until 1 kHz", "read ahead, 1 kHz"].map(|way| Series::new(format!("kernel, {way}")));
    let mut out = vec![0.0; basis.output_len()];
    for _ in 0..samples.div_ceil(AT_ONCE) {
        for (series, ahead) in series.iter_mut().zip([Duration::ZERO, AHEAD]) {
            let mut due = Instant::now();
            for turn in 0..UNTIL_STEADY + AT_ONCE {
                due = Instant::now().max(due + PERIOD);
                sleep((due - ahead).saturating_duration_since(Instant::now()));
                read_ahead_until(basis, due);
                if turn < UNTIL_STEADY {
                    basis.reconstruct(coefficients, &mut out)?;
                } else {
                    series.time(|| basis.reconstruct(coefficients, &mut out));
                }
            }
        }
    }
    let [asleep_us_p50, read_ahead_us_p50] = [series[0].p50(), series[1].p50()];
    Ok((Paced { asleep_us_p50, read_ahead_us_p50 }, series))
}

/// In steps, as a twin does between two looks; nothing where it is time already.
fn read_ahead_until(basis: &Basis, due: Instant) {
    let mut step = 0;
    while Instant::now() < due {
        basis.read_ahead(step);
        step += 1;
        std::thread::yield_now();
    }
}
