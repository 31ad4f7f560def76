//! Solves the states of a plan and then adds those that the model's own leave-one-out errors ask for, up to a budget.
//!
//! A plan cannot know where an actuator's force bends: a database that is too thin there gives wrong forces without a word. So the model
//! is trained on what there is, and where the worst of its leave-one-out errors is too large, the states that should reduce it most are
//! solved and the model is trained again.

use super::PlanError;
use super::states::{Budget, Plan, press_further};
use crate::cases::{self, Case, rounded};
use crate::family::Family;
use crate::run::{self, Event, Outcome, Run, Store, fingerprint};
use formats::database;
use rom::snapshots::RegimeKind;
use std::path::Path;
use train::config::TrainConfig;
use train::quality::largest_values;
use train::refinement::{places, worst_share};

/// States added at a time.
const AT_ONCE: usize = 4;
/// Worst leave-one-out error, as a fraction of the largest displacement or force, that asks for no further state. Leaving a state out
/// over-states the error by a factor of two to four.
const GOOD: f64 = 0.015;
/// Rounds in which contact states without force are pressed further.
const PRESSED: usize = 3;
/// Seed of the places among which the further states are chosen.
const SEED: u64 = 5;

/// Solves cases and writes them as the database, at least those that are not yet there.
type Solve<'a> = &'a mut dyn FnMut(&[Case]) -> Result<Outcome, PlanError>;

/// Solves the plan's states, then those that the errors ask for within the budget, which the plan gets. `solve` writes the states to the
/// folder `database`, `cpu_s` is the processor time of the process so far, and `say` gets a line for each change of the plan.
///
/// # Errors
/// I/O errors; states that cannot be trained on.
pub fn solve_and_refine(
    family: &Family,
    plan: &mut Plan,
    (folder, budget): (&Path, Budget),
    solve: Solve<'_>,
    cpu_s: &dyn Fn() -> f64,
    say: &mut dyn FnMut(String),
) -> Result<Outcome, PlanError> {
    let mut outcome = solve_until_touching(plan, solve, say)?;
    let (mut added, mut longest_s) = (0, 0.0_f64);
    while added < budget.states {
        let before_s = cpu_s();
        // A round that would end behind the budget is not begun.
        if before_s + longest_s > budget.cpu_s {
            break;
        }
        let data = database::read(folder, family.actuator.obstacle_kind())?;
        let (model, sheet) = train::train(&data, &TrainConfig::of_database(folder)?, &mut |_| ())?;
        // The free states also decide where contact begins: they come first.
        let values = largest_values(&data);
        let asks = |kind: &RegimeKind| worst_share(&values, &sheet, *kind) > GOOD;
        let Some(kind) = [RegimeKind::Free, RegimeKind::Contact].into_iter().find(asks) else { break };
        let wanted = AT_ONCE.min(budget.states - added);
        let further: Vec<Case> = places(&data, (&model, &sheet), kind, wanted, SEED)?
            .iter()
            .map(|place| {
                let gap_mm = Some(rounded(place.gap_mm(), 1e4)).filter(|gap| gap.is_finite());
                let case = Case::new("", rounded(place.pressure_mpa(), 1e7), gap_mm);
                Case { regime: kind.name().into(), ..case }
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
        say(format!("{} more {} states, where the errors ask for them", further.len(), kind.name()));
        for case in further {
            added += 1;
            plan.cases.push(Case { name: format!("further{added:02}"), ..case });
        }
        outcome = solve_until_touching(plan, solve, say)?;
        longest_s = longest_s.max(cpu_s() - before_s);
    }
    Ok(outcome)
}

/// Solves the plan's states. Contact states that turn out to touch nothing are pressed further, at last left out: without force they
/// are no contact states, to learn from or to check with.
fn solve_until_touching(
    plan: &mut Plan,
    solve: Solve<'_>,
    say: &mut dyn FnMut(String),
) -> Result<Outcome, PlanError> {
    for round in 0..=PRESSED {
        let outcome = solve(&plan.cases)?;
        let untouched = names_without_force(&plan.cases, &outcome);
        if untouched.is_empty() {
            return Ok(outcome);
        }
        let names = untouched.join(", ");
        if round < PRESSED {
            say(format!("{} touch nothing and are pressed further: {names}", untouched.len()));
            press_further(&mut plan.cases, &untouched, plan.contact_mpa);
        } else {
            say(format!("{} touch nothing and are left out: {names}", untouched.len()));
            plan.cases.retain(|case| !untouched.contains(&case.name));
        }
    }
    solve(&plan.cases)
}

/// Names of the solved contact states without force.
fn names_without_force(cases: &[Case], outcome: &Outcome) -> Vec<String> {
    let solved = outcome.solved.iter().map(|(index, solved)| (&cases[*index], solved.contact_force_n));
    let without = solved.filter(|(case, force_n)| case.gap_mm.is_some() && *force_n <= 0.0);
    without.map(|(case, _)| case.name.clone()).collect()
}

/// Solves further cases, near the states that a simulation left beside the database, and writes the database with them to `out`. Returns
/// the names of those that were solved.
///
/// # Errors
/// I/O errors; a database of another layout or mesh.
pub fn add_states(
    (database, out): (&Path, &Path),
    family: &Family,
    further: &[Case],
    threads: usize,
    notify: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Vec<String>, PlanError> {
    let known = database.join("states");
    let (folder, mut list) = if known.is_dir() {
        (known, cases::read(&database.join("cases.csv"))?)
    } else {
        (out.join("states"), Vec::new())
    };
    let before = list.len();
    list.extend_from_slice(further);
    let store = Store::new(&folder, fingerprint(&family.problem))?;
    let run = Run { family, store, threads, sensitivities: false, searches_behind_limits: false };
    let solved = run.solve(&list, notify)?.solved;
    let solved: Vec<_> =
        solved.into_iter().filter_map(|(index, state)| Some((index.checked_sub(before)?, state))).collect();
    run::extend(database, out, family, further, &solved)?;
    Ok(solved.iter().map(|(index, _)| further[*index].name.clone()).collect())
}
