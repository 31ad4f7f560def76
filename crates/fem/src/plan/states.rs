//! One complete list of states: rest, maximum, free, contact from the onset to the maximum, and held-out states.

use super::PlanError;
use super::pressures::Pressures;
use crate::actuator::Actuator;
use crate::cases::{Case, rounded};
use crate::sample::latin_hypercube;
use rom::regime::OnsetTable;

/// How much may be added to a plan.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Number of states that may be added.
    pub states: usize,
    /// Processor time of the whole build after which no state is added, s.
    pub cpu_s: f64,
}

/// How many states of each kind.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// Further pressures between two of those with which the range was found.
    between: usize,
    /// Gaps at which the states right behind the onset and those at the largest pressure are solved.
    edge: usize,
    /// Pressures between these two at which the smallest and the largest gap are solved. States spread over the region lie half their
    /// spacing away from its edges, and at small gaps the force bends most.
    side: usize,
    /// Contact states in between.
    inner: usize,
    /// Held-out contact states.
    check: usize,
    /// What may be added where the leave-one-out errors ask for it.
    pub further: Budget,
}

impl Counts {
    /// Enough for use.
    pub const FULL: Self = Self {
        between: 1,
        edge: 8,
        side: 5,
        inner: 36,
        check: 16,
        further: Budget { states: 24, cpu_s: 1800.0 },
    };
    /// For a first look.
    pub const QUICK: Self = Self {
        between: 0,
        edge: 4,
        side: 2,
        inner: 8,
        check: 5,
        further: Budget { states: 12, cpu_s: 200.0 },
    };
}

/// Share of the way from the onset to the largest pressure at which the first states behind the onset lie: at the onset itself
/// there is no force to learn from.
const BEHIND_ONSET: f64 = 0.05;

/// The list and the gaps it covers.
#[derive(Debug)]
pub struct Plan {
    /// All states, each name and each pair of loads once.
    pub cases: Vec<Case>,
    /// Smallest and largest gap, mm; `None` without an obstacle.
    pub gaps_mm: Option<[f64; 2]>,
    /// Inputs that are pressures of further cavities.
    pub cavities: Vec<String>,
    /// Largest pressure of the contact states, or without an obstacle of all, MPa.
    pub contact_mpa: f64,
}

impl Plan {
    /// The states for the pressures found. The gaps reach from a clear press on the plate at rest (or, where the actuator hardly
    /// sags, 10 % of its reach) to 80 % of the way that pressure bends it down. With further cavities the states are free ones
    /// over all pressures from 0 to 80 % of the largest, and touching ones in which only the pressure of `cavity` acts; [`landing_cases`] are
    /// those with all.
    ///
    /// # Errors
    /// An actuator that never comes nearer to a plate.
    pub fn new(actuator: &Actuator, pressures: &Pressures, counts: Counts) -> Result<Self, PlanError> {
        let cavities: Vec<String> =
            actuator.pressure_mpa.keys().map(|name| format!("pressure_mpa.{name}")).collect();
        let mut plan = match &actuator.obstacle {
            Some(_) => Self::with_contact(pressures, counts)?,
            None => Self {
                cases: free_cases(pressures, counts),
                gaps_mm: None,
                cavities: Vec::new(),
                contact_mpa: pressures.largest_mpa(),
            },
        };
        for case in &mut plan.cases {
            case.settings = cavities.iter().map(|name| (name.clone(), 0.0)).collect();
        }
        plan.cases.extend(cavity_cases(&cavities, pressures.largest_mpa(), counts));
        Ok(Self { cavities, ..plan })
    }

    fn with_contact(pressures: &Pressures, counts: Counts) -> Result<Self, PlanError> {
        let clearances = while_clearance_rises(&pressures.states[..pressures.touching]);
        let (sag, reach) = (clearances[0].1, clearances[clearances.len() - 1].1);
        let largest = clearances[clearances.len() - 1].0;
        let gaps_mm = [(0.4 * sag).max(0.1 * reach), sag + 0.8 * (reach - sag)].map(|gap| rounded(gap, 1e3));
        if gaps_mm[1] - gaps_mm[0] <= 0.1 {
            return Err(PlanError::NoReach { moved_mm: reach - sag });
        }
        // The onset as the model will have it: a monotone cubic through the free states. Straight lines between states that lie far
        // apart put the first states behind the onset before it.
        let onset = OnsetTable::new(
            clearances.iter().map(|state| state.1).collect(),
            clearances.iter().map(|state| state.0).collect(),
        );
        let at = |gap: f64, share: f64| -> Result<(f64, f64), PlanError> {
            let onset_mpa =
                onset.onset(gap).pressure_mpa().ok_or(PlanError::NoReach { moved_mm: reach - sag })?;
            Ok((rounded(onset_mpa + share * (largest - onset_mpa), 1e7), gap))
        };
        let mut cases = free_cases(pressures, counts);
        let mut add = |name: &str, split: &str, points: Vec<(f64, f64)>| {
            cases.extend(points.into_iter().enumerate().map(|(k, (pressure_mpa, gap))| Case {
                split: split.into(),
                ..Case::new(format!("{name}{:02}", k + 1), pressure_mpa, Some(gap))
            }));
        };
        let gap = |share: f64| rounded(gaps_mm[0] + share * (gaps_mm[1] - gaps_mm[0]), 1e4);
        let edge = |share: f64| -> Result<Vec<(f64, f64)>, PlanError> {
            (0..counts.edge).map(|k| at(gap(k as f64 / (counts.edge - 1) as f64), share)).collect()
        };
        let cube = |n: usize, seed: u64| -> Result<Vec<(f64, f64)>, PlanError> {
            let bounds = [[BEHIND_ONSET, 1.0], [0.0, 1.0]];
            latin_hypercube(n, &bounds, seed).into_iter().map(|p| at(gap(p[1]), p[0])).collect()
        };
        // Below the sag its weight alone presses it on the plate: there the first state is the one without pressure.
        let onset =
            edge(BEHIND_ONSET)?.into_iter().map(|(p, gap)| (if gap < sag { 0.0 } else { p }, gap)).collect();
        let between = |k: usize| (k + 1) as f64 / (counts.side + 1) as f64;
        let side = (0..2 * counts.side).map(|k| {
            let share = BEHIND_ONSET + (1.0 - BEHIND_ONSET) * between(k / 2);
            at(gaps_mm[k % 2], share)
        });
        add("onset", "train", onset);
        add("side", "train", side.collect::<Result<_, PlanError>>()?);
        add("contact", "train", cube(counts.inner, 1)?);
        add("maximum", "train", edge(1.0)?);
        add("check", "check", cube(counts.check, 2)?);
        Ok(Self { cases, gaps_mm: Some(gaps_mm), cavities: Vec::new(), contact_mpa: largest })
    }
}

/// Contact states over the pressures of all cavities: each free state with pressure in a further cavity is brought down to a plate at a
/// gap between the smallest one and that at which the state touches. `clearances_mm` are those gaps of `free`.
pub fn landing_cases(free: &[Case], clearances_mm: &[f64], gaps_mm: [f64; 2]) -> Vec<Case> {
    let combined = free.iter().zip(clearances_mm);
    let combined = combined.filter(|(case, _)| case.settings.iter().any(|(_, mpa)| *mpa > 0.0));
    let landing = |(k, (case, clearance)): (usize, (&Case, &f64))| {
        let touches = clearance.min(gaps_mm[1]);
        let share = 0.05 + 0.9 * (GOLDEN * (k as f64 + 1.0)).fract();
        let gap_mm = rounded(gaps_mm[0] + share * (touches - gaps_mm[0]), 1e4);
        (touches > gaps_mm[0]).then(|| Case {
            name: format!("landing-{}", case.name),
            regime: "contact".into(),
            gap_mm: Some(gap_mm),
            ..case.clone()
        })
    };
    combined.enumerate().filter_map(landing).collect()
}

/// Moves contact states that turned out to touch nothing towards the largest pressure at their gap, all but those that are there
/// already, which are left out.
pub fn press_further(cases: &mut Vec<Case>, untouched: &[String], largest_mpa: f64) {
    for case in cases.iter_mut().filter(|case| untouched.contains(&case.name)) {
        case.pressure_mpa =
            rounded(case.pressure_mpa + PRESS_FURTHER * (largest_mpa - case.pressure_mpa), 1e7);
    }
    cases.retain(|case| !untouched.contains(&case.name) || case.pressure_mpa < (1.0 - 1e-6) * largest_mpa);
}

/// Share of the way to the largest pressure by which a contact state without force is moved.
const PRESS_FURTHER: f64 = 0.1;

/// Multiples of the golden section, modulo 1, are spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Fraction of the largest pressure to which all cavities are inflated together, which weakens their walls.
pub const TOGETHER: f64 = 0.8;

/// Free states over the pressures of all cavities: the largest of one or all, and a sample of the range; a part held out.
fn cavity_cases(cavities: &[String], largest_mpa: f64, counts: Counts) -> Vec<Case> {
    if cavities.is_empty() {
        return Vec::new();
    }
    let case = |name: String, split: &str, shares: &[f64]| {
        let mpa: Vec<f64> = shares.iter().map(|share| rounded(share * TOGETHER * largest_mpa, 1e7)).collect();
        let settings = cavities.iter().cloned().zip(mpa[1..].iter().copied()).collect();
        Case { split: split.into(), settings, ..Case::new(name, mpa[0], None) }
    };
    let axes = cavities.len() + 1;
    let alone = |k: usize, share: f64| -> Vec<f64> {
        (0..axes).map(|axis| if axis == k { share } else { 0.0 }).collect()
    };
    let mut cases = Vec::new();
    for k in 1..axes {
        for (step, share) in [0.25, 0.5, 0.75, 1.0].into_iter().enumerate() {
            cases.push(case(format!("alone{k}{step}"), "train", &alone(k, share)));
        }
    }
    cases.push(case("all".into(), "train", &vec![1.0; axes]));
    let bounds = vec![[0.0, 1.0]; axes];
    let sample = |name: &str, split: &str, n: usize, seed: u64| -> Vec<Case> {
        let points = latin_hypercube(n, &bounds, seed).into_iter().enumerate();
        points.map(|(k, shares)| case(format!("{name}{:02}", k + 1), split, &shares)).collect()
    };
    cases.extend(sample("combined", "train", axes * counts.inner, 3));
    cases.extend(sample("combinedcheck", "check", counts.check, 4));
    cases
}

/// Rest and all pressures found, more in between, and two held-out ones.
fn free_cases(pressures: &Pressures, counts: Counts) -> Vec<Case> {
    let states = &pressures.states;
    let mut found: Vec<f64> = states.iter().map(|state| state.0).collect();
    for pair in states.windows(2) {
        let parts = counts.between + 1;
        found.extend((1..parts).map(|k| pair[0].0 + (pair[1].0 - pair[0].0) * k as f64 / parts as f64));
    }
    found.sort_by(f64::total_cmp);
    let last = found.len() - 1;
    let name = |k: usize| match k {
        0 => "rest".to_owned(),
        k if k == last => "largest".to_owned(),
        k => format!("free{k:02}"),
    };
    let mut cases: Vec<Case> =
        found.iter().enumerate().map(|(k, p)| Case::new(name(k), rounded(*p, 1e7), None)).collect();
    for (k, at) in [last / 3, 2 * last / 3].into_iter().enumerate() {
        let between = rounded(0.5 * (found[at] + found[at + 1]), 1e7);
        cases.push(Case {
            split: "check".into(),
            ..Case::new(format!("freecheck{:02}", k + 1), between, None)
        });
    }
    cases
}

/// The part in which a plate is met ever farther away: past it the tip lifts off again.
fn while_clearance_rises(states: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut rising: Vec<(f64, f64)> = Vec::new();
    for state in states {
        if rising.last().is_none_or(|before| state.1 > before.1) {
            rising.push(*state);
        }
    }
    rising
}

#[cfg(test)]
#[path = "../../tests/unit/plan.rs"]
mod tests;
