//! The pressures that suit an actuator: solved upwards until it bends as far as wanted, or until nothing more is found.

use crate::cmd::simulate::stretch::MAX_BEYOND;
use crate::failure::configuration;
use anyhow::{Context, Result};
use fem::Family;
use fem::cases::Case;
use fem::run::{Event, Outcome, Run, Solved};

/// The tip's way at the largest pressure, as a fraction of the free length: about 100 degrees of bending, past which a tip that
/// bends down to a plate begins to lift off it again.
const WANTED_SHARE: f64 = 0.8;
/// Share of the wanted way that is enough: no further state for the rest.
const ENOUGH: f64 = 0.98;
/// A fraction of the free length that no actuator may sag by before any pressure.
const MAX_SAG_SHARE: f64 = 0.6;
/// Steps of about equal displacement on the way there.
const STEPS: f64 = 7.0;
/// First pressure as a fraction of the shear modulus.
const FIRST_SHARE: f64 = 0.005;
/// Failures in a row after which the last state counts as the limit.
const FAILURES: usize = 3;
/// More states than this mean that pressure hardly bends the actuator.
const MAX_STATES: usize = 30;

/// Fewest states of a curve.
const FEWEST: usize = 3;

/// Remedy for an actuator that sags too far.
const LIGHTER: &str = "let it hang (loads.gravity_mm_s2 = [9810.0, 0.0, 0.0], `softtwin new --hanging`), make it shorter or take a \
                       stiffer silicone";

/// Result.
#[derive(Debug)]
pub struct Pressures {
    /// Free states from rest to the largest pressure: pressure (MPa), distance at which a plate just clears it (mm).
    pub states: Vec<(f64, f64)>,
    /// Largest displacement at the largest pressure, mm.
    pub displacement_mm: f64,
    /// Largest stretch of the elastomer at the largest pressure.
    pub stretch: f64,
    /// Why it ends there.
    pub reason: String,
}

impl Pressures {
    /// Largest pressure, MPa.
    pub fn largest_mpa(&self) -> f64 {
        self.states.last().map_or(0.0, |state| state.0)
    }
}

/// A free training state.
pub fn free_case(name: &str, pressure_mpa: f64) -> Case {
    let (regime, split) = ("free".into(), "train".into());
    Case {
        name: name.into(),
        regime,
        split,
        pressure_mpa,
        volume_mm3: None,
        gap_mm: None,
        settings: Vec::new(),
    }
}

/// Distance from the held face to the tip, mm.
fn free_length_mm(family: &Family) -> f64 {
    family
        .actuator
        .shape()
        .map_or_else(|| family.problem.mesh().tip().1, |shape| shape.base.length_mm - shape.held_mm())
}

/// Solves upwards. States are kept in the run's store: a second call finds them there and takes the same steps.
///
/// # Errors
/// No equilibrium under gravity, or a sag that leaves nothing to bend.
pub fn find(run: &Run<'_>, mut say: impl FnMut(&str)) -> Result<Pressures> {
    let length = free_length_mm(run.family);
    let wanted = WANTED_SHARE * length;
    let mut list = vec![free_case("rest", 0.0)];
    let outcome = run.solve(&list, &quiet).map_err(|error| {
        configuration(anyhow::anyhow!("{error}. It may be too soft to carry its weight: {LIGHTER}"))
    })?;
    let rest = last(&outcome, 0).context("the state at rest is missing")?;
    let sag = largest_mm(rest);
    if sag > MAX_SAG_SHARE * length {
        return Err(configuration(anyhow::anyhow!(
            "it sags by {sag:.0} mm of {length:.0} mm under its own weight, which leaves nothing to bend: {LIGHTER}"
        )));
    }
    say(&format!("rest: sags by {sag:.1} mm"));
    let mut states = vec![(0.0, rest.clearance_mm)];
    let (mut displacement, mut failures) = (sag, 0);
    let mut stretch = run.family.problem.stretches(&rest.state).largest;
    let mut step = FIRST_SHARE * run.family.actuator.elastomer.law.shear_modulus_mpa();
    let reason = loop {
        let pressure = rounded(states[states.len() - 1].0 + step);
        list.push(free_case(&format!("p{}", list.len()), pressure));
        let outcome = run.solve(&list, &quiet)?;
        let Some(solved) = last(&outcome, list.len() - 1) else {
            list.pop();
            failures += 1;
            step *= 0.5;
            if failures == FAILURES {
                let reason = outcome.failed.last().map_or("", |(_, reason)| reason.as_str());
                break format!("no state was found at {pressure} MPa: {reason}");
            }
            continue;
        };
        failures = 0;
        let now = largest_mm(solved);
        let stretches = run.family.problem.stretches(&solved.state);
        if stretches.beyond > MAX_BEYOND && states.len() >= FEWEST {
            list.pop();
            break format!(
                "at {pressure} MPa {:.0} % of the silicone is beyond the stretches over which its law was fitted",
                100.0 * stretches.beyond
            );
        }
        stretch = stretches.largest;
        say(&format!("{pressure} MPa: bends by {now:.1} mm"));
        let slope = (now - displacement) / (pressure - states[states.len() - 1].0);
        states.push((pressure, solved.clearance_mm));
        displacement = now;
        if now >= ENOUGH * wanted {
            break format!(
                "the tip has moved by {:.0} % of the free length of {length:.0} mm",
                100.0 * now / length
            );
        }
        if states.len() == MAX_STATES {
            break format!("{MAX_STATES} states were solved and it bends by {now:.1} mm only");
        }
        // A little more than what is left, so that the last step is not followed by a tiny one.
        let way = ((wanted - sag) / STEPS).min(1.05 * (wanted - now));
        step = if slope > 0.0 { (way / slope).min(3.0 * step) } else { 2.0 * step };
    };
    anyhow::ensure!(states.len() >= FEWEST, "only {} pressures could be solved ({reason})", states.len() - 1);
    Ok(Pressures { states, displacement_mm: displacement, stretch, reason })
}

fn quiet(_: Event<'_>) {}

fn last(outcome: &Outcome, index: usize) -> Option<&Solved> {
    outcome.solved.iter().find(|(found, _)| *found == index).map(|(_, solved)| solved.as_ref())
}

fn largest_mm(solved: &Solved) -> f64 {
    let squared = |u: &[f64; 3]| u.iter().map(|v| v * v).sum::<f64>();
    solved.state.displacement_mm.iter().map(squared).fold(0.0, f64::max).sqrt()
}

/// Three significant digits: pressures that people can read.
fn rounded(pressure_mpa: f64) -> f64 {
    format!("{pressure_mpa:.2e}").parse().unwrap_or(pressure_mpa)
}
