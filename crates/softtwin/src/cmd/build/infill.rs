//! Solves the states of a plan and then adds those that the model's own leave-one-out errors ask for, up to a budget.
//!
//! A plan cannot know where an actuator's force bends: a database that is too thin there gives wrong forces without a word. So the model
//! is trained on what there is, and where the worst of its leave-one-out errors is too large, the states that should reduce it most are
//! solved and the model is trained again.

use super::plan::{Budget, Plan, press, rounded};
use super::quality::largest_values;
use crate::cmd::sample::refine::places;
use crate::cmd::simulate::batch;
use crate::cmd::train::config_of;
use crate::{files, resources};
use anyhow::Result;
use fem::Family;
use fem::cases::Case;
use fem::run::Outcome;
use rom::halfwidths::Errors;
use rom::snapshots::RegimeKind;
use std::path::Path;
use train::datasheet::{CaseError, DataSheet};

/// States added at a time.
const AT_ONCE: usize = 4;
/// Worst leave-one-out error, as a fraction of the largest displacement or force, that asks for no further state. Leaving a state out
/// over-states the error by a factor of two to four.
const GOOD: f64 = 0.015;
/// Weight of the stress in that comparison: at the worst node it depends on single elements, and more states reduce its error least.
const STRESS_WEIGHT: f64 = 0.3;
/// Rounds in which contact states without force are pressed further.
const PRESSED: usize = 3;
/// Seed of the places among which the further states are chosen.
const SEED: u64 = 5;

/// Solves the plan's states, then those that the errors ask for within the budget, which the plan gets. `say` gets a line for each
/// change of the plan.
///
/// # Errors
/// I/O errors; states that cannot be trained on.
pub fn solve(
    family: &Family,
    plan: &mut Plan,
    (database, options): (&Path, &batch::Options),
    budget: Budget,
    mut say: impl FnMut(&str),
) -> Result<Outcome> {
    let mut outcome = touching(family, plan, (database, options), &mut say)?;
    let (mut added, mut longest_s) = (0, 0.0_f64);
    while added < budget.states {
        let before_s = cpu_s();
        // A round that would end behind the budget is not begun.
        if before_s + longest_s > budget.cpu_s {
            break;
        }
        let data = files::database(database, family.actuator.obstacle_kind())?;
        let (model, sheet) = train::train(&data, &config_of(database)?, &mut |_| ())?;
        // The free states also decide where contact begins: they come first.
        let values = largest_values(&data);
        let asks = |kind: &RegimeKind| worst_share(&values, &sheet, *kind) > GOOD;
        let Some(kind) = [RegimeKind::Free, RegimeKind::Contact].into_iter().find(asks) else { break };
        let wanted = AT_ONCE.min(budget.states - added);
        let further: Vec<Case> = places(&data, (&model, &sheet), kind, wanted, SEED)?
            .iter()
            .map(|place| Case {
                name: String::new(),
                regime: kind.name().into(),
                split: "train".into(),
                pressure_mpa: rounded(place.pressure_mpa(), 1e7),
                volume_mm3: None,
                gap_mm: Some(rounded(place.gap_mm(), 1e4)).filter(|gap| gap.is_finite()),
                settings: Vec::new(),
            })
            // A place is asked for again if its state was not found.
            .filter(|case| {
                plan.cases
                    .iter()
                    .all(|other| (other.pressure_mpa, other.gap_mm) != (case.pressure_mpa, case.gap_mm))
            })
            .collect();
        if further.is_empty() {
            break;
        }
        say(&format!("{} more {} states, where the errors ask for them", further.len(), kind.name()));
        for case in further {
            added += 1;
            plan.cases.push(Case { name: format!("further{added:02}"), ..case });
        }
        outcome = touching(family, plan, (database, options), &mut say)?;
        longest_s = longest_s.max(cpu_s() - before_s);
    }
    Ok(outcome)
}

/// Processor time of this process so far; 0 where the system does not tell, and then the number of states alone ends the search.
fn cpu_s() -> f64 {
    resources::cpu_s("self").unwrap_or(0.0)
}

/// Solves the plan's states. Contact states that turn out to touch nothing are pressed further, at last left out: without force they
/// are no contact states, to learn from or to check with.
fn touching(
    family: &Family,
    plan: &mut Plan,
    (database, options): (&Path, &batch::Options),
    say: &mut impl FnMut(&str),
) -> Result<Outcome> {
    for round in 0..=PRESSED {
        let outcome = batch::solve(family, &plan.cases, database, options)?;
        let untouched = untouched(&plan.cases, &outcome);
        if untouched.is_empty() {
            return Ok(outcome);
        }
        let names = untouched.join(", ");
        if round < PRESSED {
            say(&format!("{} touch nothing and are pressed further: {names}", untouched.len()));
            press(&mut plan.cases, &untouched, plan.contact_mpa);
        } else {
            say(&format!("{} touch nothing and are left out: {names}", untouched.len()));
            plan.cases.retain(|case| !untouched.contains(&case.name));
        }
    }
    batch::solve(family, &plan.cases, database, options)
}

/// Names of the solved contact states without force.
fn untouched(cases: &[Case], outcome: &Outcome) -> Vec<String> {
    let solved = outcome.solved.iter().map(|(at, solved)| (&cases[*at], solved.contact_force_n));
    let without = solved.filter(|(case, force_n)| case.gap_mm.is_some() && *force_n <= 0.0);
    without.map(|(case, _)| case.name.clone()).collect()
}

/// The worst leave-one-out error of a regime inside the training range, as a fraction of the largest displacement or force of all
/// states, whose largest values these are.
fn worst_share(values: &[Errors], sheet: &DataSheet, kind: RegimeKind) -> f64 {
    let largest = |value: fn(&Errors) -> f64| values.iter().map(value).fold(0.0, f64::max);
    let (largest_mm, largest_n) = (largest(|v| v.displacement_mm), largest(|v| v.force_n));
    let largest_mpa = largest(|v| v.stress_mpa);
    let share =
        |error: f64, largest: f64| if largest > 0.0 && error.is_finite() { error / largest } else { 0.0 };
    let of_case = |error: &CaseError| {
        let stress = STRESS_WEIGHT * share(error.stress_mpa, largest_mpa);
        share(error.displacement_mm, largest_mm).max(share(error.force_n, largest_n)).max(stress)
    };
    let regimes = sheet.regimes.iter().filter(|regime| regime.kind == kind);
    let inner = regimes.flat_map(|regime| &regime.leave_one_out).filter(|error| !error.on_hull);
    inner.map(of_case).fold(0.0, f64::max)
}
