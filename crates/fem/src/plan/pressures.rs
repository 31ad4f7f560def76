//! The pressures that suit an actuator: solved upwards until it bends as far as wanted, or until nothing more is found.

use super::{Notice, PlanError};
use crate::bending::Bending;
use crate::cases::Case;
use crate::family::Family;
use crate::material::Elastomer;
use crate::mesh::three_digits;
use crate::run::{Outcome, Run, Solved};
use std::fmt::{self, Display};
use std::sync::Arc;

/// Rotation of the end section at the largest pressure, degrees.
const WANTED_DEG: f64 = 180.0;
/// The tip's way at the largest pressure of an actuator that hardly bends, as a fraction of the free length. A circular arc has bent by
/// 100 degrees there.
const WANTED_SHARE: f64 = 0.8;
const ARC_DEG: f64 = 100.0;
/// Share of the wanted way that is enough: no further state for the rest.
const ENOUGH: f64 = 0.98;
/// A fraction of the free length that no actuator may sag by before any pressure.
const MAX_SAG_SHARE: f64 = 0.6;
/// Steps of about equal progress on the way there.
const STEPS: f64 = 11.0;
/// First pressure as a fraction of the shear modulus.
const FIRST_SHARE: f64 = 0.005;
/// Failures after which the last state counts as the limit: each costs as much as several states.
const FAILURES: usize = 3;
/// Fraction of a limit of pressure at which the last state is solved.
const NEAR_LIMIT: f64 = 0.98;
/// Fraction of a pressure without a state up to which further ones are looked for.
const NEAR_FAILURE: f64 = 0.97;
/// More states than this mean that pressure hardly bends the actuator.
const MAX_STATES: usize = 30;

/// Fewest states of a curve.
const FEWEST: usize = 3;

/// Remedy for an actuator that sags too far.
const LIGHTER: &str = "let it hang (loads.gravity_mm_s2 = [9810.0, 0.0, 0.0], `softtwin new --hanging`), make it shorter or take a \
                       stiffer silicone";

/// The free states that suit an actuator, up to its largest pressure.
#[derive(Debug)]
pub struct Pressures {
    /// Free states from rest to the largest pressure: pressure (MPa), distance at which a plate just clears it (mm).
    pub states: Vec<(f64, f64)>,
    /// Leading states from which contact states are planned: until the tip has moved by 80 % of the free length. Past 100 degrees a tip
    /// that bends down to a plate begins to lift off it again.
    pub touching: usize,
    /// Largest displacement at the largest pressure, mm.
    pub displacement_mm: f64,
    /// Rotation of the end section at the largest pressure, degrees; NaN without an end section.
    pub angle_deg: f64,
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

    /// The largest pressure (MPa) over the interval of an unmeasured shear modulus: the elastomer's stresses and the pressure scale
    /// together; the weight and the sheet, which does not stretch, are left out.
    pub fn interval_mpa(&self, elastomer: &Elastomer) -> Option<[f64; 2]> {
        let shear_mpa = elastomer.law.shear_modulus_mpa();
        elastomer.shear_interval_mpa.map(|interval| interval.map(|mpa| self.largest_mpa() * mpa / shear_mpa))
    }
}

/// Distance from the held face to the tip, mm.
fn free_length_mm(family: &Family) -> f64 {
    family
        .actuator
        .shape()
        .map_or_else(|| family.problem.mesh().end_face().free_length_mm, |shape| shape.free_mm())
}

/// The state under its own weight.
fn solve_rest(
    run: &Run<'_>,
    list: &[Case],
    length: f64,
    notice: &mut dyn FnMut(Notice),
) -> Result<Arc<Solved>, PlanError> {
    notice(Notice::Begins("solving under gravity".into()));
    let outcome = run.solve(list, &|_| ()).map_err(|error| {
        PlanError::Refused(format!("{error}. It may be too soft to carry its weight: {LIGHTER}"))
    })?;
    let (_, rest) = outcome.solved.into_iter().next().ok_or(PlanError::Gravity)?;
    let sag = rest.state.largest_displacement_mm();
    if sag > MAX_SAG_SHARE * length {
        return Err(PlanError::Refused(format!(
            "it sags by {sag:.0} mm of {length:.0} mm under its own weight, which leaves nothing to bend: {LIGHTER}"
        )));
    }
    notice(Notice::Found(format!("rest: sags by {sag:.1} mm")));
    Ok(rest)
}

/// Solves upwards. States are kept in the run's store: a second call finds them there and takes the same steps.
///
/// # Errors
/// No equilibrium under gravity, or a sag that leaves nothing to bend.
pub fn find(run: &Run<'_>, notice: &mut dyn FnMut(Notice)) -> Result<Pressures, PlanError> {
    let length = free_length_mm(run.family);
    let mut list = vec![Case::new("rest", 0.0, None)];
    let rest = solve_rest(run, &list, length, notice)?;
    let problem = &run.family.problem;
    let section = Bending::all(run.family).into_iter().next();
    let travel = |solved: &Solved, near_deg: f64| Travel {
        displacement_mm: solved.state.largest_displacement_mm(),
        angle_deg: section
            .as_ref()
            .map_or(f64::NAN, |s| s.angle_deg(problem, &solved.state.displacement_mm, near_deg)),
        length_mm: length,
    };
    let begin = travel(&rest, 0.0);
    let mut search = Search {
        states: vec![(0.0, rest.clearance_mm)],
        begin,
        travel: begin,
        touching: None,
        stretch: problem.stretches(&rest.state).largest,
        step_mpa: FIRST_SHARE * run.family.actuator.elastomer.law.shear_modulus_mpa(),
        failures: 0,
        limit_mpa: None,
        failed_mpa: f64::INFINITY,
    };
    let reason = loop {
        let pressure = three_digits(search.last_mpa() + search.step_mpa);
        list.push(Case::new(format!("p{}", list.len()), pressure, None));
        notice(Notice::Begins(format!("solving at {pressure} MPa")));
        let outcome = run.solve(&list, &|_| ())?;
        let stop = match last(&outcome, list.len() - 1) {
            None => {
                list.pop();
                search.take_failure(pressure, &outcome, notice)
            }
            Some(solved) => {
                let stretches = problem.stretches(&solved.state);
                if stretches.is_beyond() && search.states.len() >= FEWEST {
                    break format!(
                        "at {pressure} MPa {:.0} % of the silicone is beyond the stretches over which its law was fitted",
                        100.0 * stretches.beyond
                    );
                }
                search.stretch = stretches.largest;
                let now = travel(solved, search.travel.angle_deg);
                notice(Notice::Found(format!("{pressure} MPa: {now}")));
                search.take_state((pressure, solved.clearance_mm), now)
            }
        };
        if let Some(reason) = stop {
            break reason;
        }
    };
    let Search { states, travel, touching, stretch, .. } = search;
    if states.len() < FEWEST {
        return Err(PlanError::FewPressures { found: states.len() - 1, reason });
    }
    Ok(Pressures {
        touching: touching.unwrap_or(states.len()),
        states,
        displacement_mm: travel.displacement_mm,
        angle_deg: travel.angle_deg,
        stretch,
        reason,
    })
}

/// The search upwards: the states so far, and the next step.
struct Search {
    states: Vec<(f64, f64)>,
    /// At rest and now.
    begin: Travel,
    travel: Travel,
    touching: Option<usize>,
    stretch: f64,
    step_mpa: f64,
    failures: usize,
    /// What the search has learnt not to go beyond: a limit of the pressure, and the lowest pressure without a state.
    limit_mpa: Option<f64>,
    failed_mpa: f64,
}

impl Search {
    fn last_mpa(&self) -> f64 {
        self.states[self.states.len() - 1].0
    }

    /// Shortens the step after a pressure without a state; returns why the search ends, if it does.
    fn take_failure(
        &mut self,
        pressure: f64,
        outcome: &Outcome,
        notice: &mut dyn FnMut(Notice),
    ) -> Option<String> {
        let before = self.last_mpa();
        if let Some(found_mpa) = outcome.limit_mpa {
            self.step_mpa = NEAR_LIMIT * found_mpa - before;
            notice(Notice::Found(format!(
                "{pressure} MPa: beyond a limit of the pressure at {found_mpa:.6} MPa"
            )));
            // Once right before a limit: a state that is not found there either is not looked for again.
            let is_first = self.limit_mpa.replace(found_mpa).is_none();
            let has_room = self.step_mpa > (1.0 - NEAR_LIMIT) * found_mpa;
            return (!is_first || !has_room).then(|| at_limit(found_mpa, &self.travel));
        }
        self.failures += 1;
        self.failed_mpa = self.failed_mpa.min(pressure);
        let reason = outcome.failed.last().map_or("", |(_, reason)| reason.as_str());
        notice(Notice::Found(format!("{pressure} MPa: {reason}")));
        if self.failures == FAILURES || before >= NEAR_FAILURE * self.failed_mpa {
            return Some(format!("no state was found at {pressure} MPa: {reason}"));
        }
        self.step_mpa = 0.5 * (self.failed_mpa - before);
        None
    }

    /// Adds a state and chooses the next step; returns why the search ends, if it does.
    fn take_state(&mut self, state: (f64, f64), now: Travel) -> Option<String> {
        let pressure = state.0;
        let progress = |travel: &Travel| if now.bends() { travel.turned() } else { travel.moved() };
        let reached = progress(&now);
        let slope = (reached - progress(&self.travel)) / (pressure - self.last_mpa());
        self.states.push(state);
        self.travel = now;
        if self.touching.is_none() && now.moved() >= ENOUGH {
            self.touching = Some(self.states.len());
        }
        if reached >= ENOUGH {
            return Some(now.to_string());
        }
        if let Some(limit_mpa) = self.limit_mpa {
            return Some(at_limit(limit_mpa, &now));
        }
        if pressure >= NEAR_FAILURE * self.failed_mpa {
            return Some(format!("no state was found at {} MPa: {now}", self.failed_mpa));
        }
        if self.states.len() == MAX_STATES {
            return Some(format!("{MAX_STATES} states were solved: {now}"));
        }
        // A little more than what is left, so that the last step is not followed by a tiny one.
        let wanted = ((1.0 - progress(&self.begin)) / STEPS).min(1.05 * (1.0 - reached));
        let step = if slope > 0.0 { (wanted / slope).min(3.0 * self.step_mpa) } else { 2.0 * self.step_mpa };
        self.step_mpa = step.min(0.5 * (self.failed_mpa - pressure));
        None
    }
}

/// How far a state has bent or moved.
#[derive(Clone, Copy)]
struct Travel {
    displacement_mm: f64,
    /// NaN without an end section.
    angle_deg: f64,
    length_mm: f64,
}

impl Travel {
    /// Fraction of the wanted rotation.
    fn turned(&self) -> f64 {
        self.angle_deg.abs() / WANTED_DEG
    }

    /// Fraction of the wanted displacement.
    fn moved(&self) -> f64 {
        self.displacement_mm / (WANTED_SHARE * self.length_mm)
    }

    /// True if it has turned by at least half of what an arc of that displacement has.
    fn bends(&self) -> bool {
        self.angle_deg.abs() >= 0.5 * ARC_DEG * self.moved()
    }
}

impl Display for Travel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = 100.0 * self.displacement_mm / self.length_mm;
        write!(
            f,
            "the end has turned by {:.0} degrees and moved by {:.1} mm ({share:.0} % of the free length)",
            self.angle_deg, self.displacement_mm
        )
    }
}

fn at_limit(limit_mpa: f64, travel: &Travel) -> String {
    format!("the pressure has a limit of {limit_mpa:.6} MPa, before which {travel}")
}

fn last(outcome: &Outcome, index: usize) -> Option<&Solved> {
    outcome.solved.iter().find(|(found, _)| *found == index).map(|(_, solved)| solved.as_ref())
}
