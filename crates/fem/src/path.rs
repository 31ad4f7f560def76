//! Equilibrium paths through limit points: pressure and displacements are unknowns, the length along the path is given.
//!
//! ```text
//! K du - dp g = R,   t . du = 0        g = dV/du, t along y = K^-1 g
//! ```
//! The step starts along `y`, in the sense in which the last one went; corrections are normal to it (Riks). `dV/dp = g . y` is exact
//! at each point. A path has a limit of pressure where the sense of `y` turns, a limit of volume where that of `(g . y) y` turns.

use crate::algebra::{norm, sub};
use crate::config::Load;
use crate::contact::Obstacle;
use crate::newton::{Closure, Effort, NewtonError, product};
use crate::solver::{NotConverged, SolveError, SolveReport, Solver};
use crate::state::State;
use rom::cubic::Cubic;

/// Equilibrium on a path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// State; its load has the pressure.
    pub state: State,
    /// Volume of the cavity minus that of the undeformed one (mm3).
    pub injected_mm3: f64,
    /// Change of the volume by the pressure along the path (mm3/MPa).
    pub compliance_mm3_per_mpa: f64,
    /// Negative eigenvalues of the tangent at constant pressure.
    pub negative_eigenvalues: usize,
    /// Sense of the pressure along the path, 1 or -1.
    sense: f64,
}

impl PathPoint {
    /// Cavity pressure (MPa).
    #[must_use]
    pub fn pressure_mpa(&self) -> f64 {
        self.state.load.pressure_mpa
    }

    /// True if pressure and volume turn between two points, so that the two limits need separate steps.
    fn both_turn(&self, next: &Self) -> bool {
        self.sense * next.sense < 0.0 && self.compliance_mm3_per_mpa * next.compliance_mm3_per_mpa > 0.0
    }

    /// True if no neighbouring state has less energy at this pressure.
    #[must_use]
    pub fn is_stable_at_pressure(&self) -> bool {
        self.negative_eigenvalues == 0
    }

    /// True if no neighbouring state of the same volume has less energy.
    #[must_use]
    pub fn is_stable_at_volume(&self) -> bool {
        match self.negative_eigenvalues {
            0 => true,
            1 => self.compliance_mm3_per_mpa < 0.0,
            _ => false,
        }
    }
}

/// Kind of a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitKind {
    /// The pressure has a maximum: at rising pressure the state jumps.
    PressureMaximum,
    /// The pressure has a minimum: at falling pressure the state jumps.
    PressureMinimum,
    /// The volume has an extremum: at given volume the state jumps.
    Volume,
    /// The number of negative eigenvalues changes without a limit: another branch leaves the path.
    Bifurcation,
}

impl LimitKind {
    /// Name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PressureMaximum => "pressure_maximum",
            Self::PressureMinimum => "pressure_minimum",
            Self::Volume => "volume",
            Self::Bifurcation => "bifurcation",
        }
    }
}

/// Limit on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// What ends there: a rising pressure, a falling one, the volume, or the only branch.
    pub kind: LimitKind,
    /// Index of the point before it.
    pub after: usize,
    /// Pressure there (MPa).
    pub pressure_mpa: f64,
    /// Injected volume there (mm3).
    pub injected_mm3: f64,
    /// Injected volume (mm3) of the state to which a limit of pressure jumps: the next one on the path that is stable at that
    /// pressure, behind a maximum, before a minimum.
    pub next_injected_mm3: Option<f64>,
}

/// Extent of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSettings {
    /// Injected volume at the end (mm3).
    pub end_mm3: f64,
    /// Points, if the volume rises all the way.
    pub points: usize,
}

/// Path so far and why it ended before its volume.
#[derive(Clone, Debug, Default)]
pub struct Path {
    /// Points, in order.
    pub points: Vec<PathPoint>,
    /// Work spent so far.
    pub report: SolveReport,
    /// Why it ended.
    pub ended: Option<NewtonError>,
}

/// Iterations up to which the next step is longer, and from which it is shorter.
const EASY: usize = 4;
const HARD: usize = 8;
/// Fraction of the first step below which the path continues by descent, or ends.
const SHORTEST: f64 = 1.0e-3;
/// Steps per wanted point after which a path ends.
const MAX_POINTS: usize = 10;
/// Largest displacement of a step, in its length.
const MAX_LENGTHS: f64 = 3.0;
/// Steps within which a limit of the pressure is looked for, steps behind it within which its pressure is looked for, and the first
/// step as a fraction of the step that failed.
const SEARCH_STEPS: usize = 16;
const BEYOND_STEPS: usize = 24;
const SEARCH_STEP: f64 = 0.25;
/// States solved near the one behind a limit that has its pressure.
const REFINEMENTS: usize = 2;

/// Direction of the path at an equilibrium, with the length of a step per MPa.
struct Tangent {
    by: Vec<f64>,
    mm_per_mpa: f64,
}

/// Steps along a path.
struct Walk<'a> {
    /// First step (mm).
    length_mm: f64,
    /// Longest step from a point (mm).
    longest_mm: &'a dyn Fn(&PathPoint, &Tangent) -> f64,
    /// Steps, failed ones included, after which it ends.
    tries: usize,
    /// True if a step that no length converges for is taken by descent, which costs many corrections.
    descends: bool,
    /// True if the next point of these is behind the end.
    passed: &'a dyn Fn(&[PathPoint], &PathPoint) -> bool,
    /// True if this point is what the walk looks for; it then ends.
    is_found: &'a dyn Fn(&PathPoint) -> bool,
    /// Gets every point.
    notify: &'a mut dyn FnMut(&PathPoint),
}

impl Solver {
    /// Follows the path from a solved state to an injected volume. `notify` gets every point. The path ends before it where no step
    /// converges, or after ten times the wanted number of steps.
    ///
    /// # Errors
    /// [`SolveError`]: the start is not an equilibrium of this problem, or the volume is not a number.
    pub fn path(
        &mut self,
        from: &State,
        settings: PathSettings,
        notify: &mut dyn FnMut(&PathPoint),
    ) -> Result<Path, SolveError> {
        self.check(from, &Load { injected_mm3: Some(settings.end_mm3), ..from.load })?;
        let began = std::time::Instant::now();
        let (mut path, mut effort) = (Path::default(), Effort::default());
        let end_mm3 = settings.end_mm3;
        let begin_mm3 = self.injected_mm3(from);
        let up = (end_mm3 - begin_mm3).signum();
        let first = self.first(from, up, &mut effort).map_err(|e| self.stopped(from, e))?;
        let volume_step = (end_mm3 - begin_mm3).abs() / settings.points.max(1) as f64;
        let longest = self.problem().config().newton.step_length_mm;
        let wanted = |point: &PathPoint, tangent: &Tangent| {
            (volume_step / point.compliance_mm3_per_mpa.abs() * tangent.mm_per_mpa).min(longest)
        };
        let walk = Walk {
            length_mm: wanted(&first.0, &first.1),
            longest_mm: &wanted,
            tries: MAX_POINTS * settings.points,
            descends: true,
            passed: &|_, next| (end_mm3 - next.injected_mm3) * up <= 0.0,
            is_found: &|_| false,
            notify,
        };
        self.walk(first, walk, &mut path, &mut effort);
        if path.ended.is_none()
            && let Some(last) = path.points.last()
            && last.injected_mm3 != end_mm3
        {
            let state = last.state.clone();
            let load = Load { injected_mm3: Some(end_mm3), ..state.load };
            let (state, report) = self.solve_to(&state, &load)?;
            path.report = path.report.and(&report);
            let (last, _) = self.first(&state, up, &mut effort).map_err(|e| self.stopped(&state, e))?;
            notify(&last);
            path.points.push(last);
        }
        // Refining moves the points behind: the next limit is looked for among them.
        let mut done = 0;
        while let Some(limit) = limits(&path.points).into_iter().nth(done) {
            done += 1;
            if limit.next_injected_mm3.is_some() {
                let is_behind = limit.kind == LimitKind::PressureMaximum;
                self.refine(&mut path.points, (limit.after, is_behind), limit.pressure_mpa, &mut effort);
            }
        }
        path.report.factorisations += effort.factorisations;
        path.report.seconds = began.elapsed().as_secs_f64();
        Ok(path)
    }

    /// First limit of pressure on the way from a state to another pressure: looked for along the path, beginning with a part of the
    /// step that failed, until that pressure is passed. Behind a limit the path is followed until its pressure is reached again by a
    /// stable state, at most [`BEYOND_STEPS`]; with an obstacle it is not, nor where nobody asks for that state. The loss of stability
    /// before a limit ends the search too.
    pub(crate) fn limit_before(
        &mut self,
        from: &State,
        to_mpa: f64,
        effort: &mut Effort,
    ) -> Option<NewtonError> {
        let up = (to_mpa - from.load.pressure_mpa).signum();
        let (mut point, tangent) = self.first(from, up, effort).ok()?;
        // The pressure is to move towards the goal: the sense of the volume is that of the path.
        point.sense = up;
        let longest = self.problem().config().newton.step_length_mm;
        let has_obstacle = from.load.obstacle != Obstacle::None;
        let ends_at_limit = has_obstacle || !self.searches_behind_limits;
        let longest_mm = |point: &PathPoint, _: &Tangent| {
            if point.sense == up && !has_obstacle { 0.5 * longest } else { longest }
        };
        let passed = |points: &[PathPoint], next: &PathPoint| {
            let Some(turn) = points.iter().position(|point| point.sense != up) else {
                let at_end = (next.pressure_mpa() - to_mpa) * up > 0.0 || points.len() > SEARCH_STEPS;
                let loses =
                    points.last().is_some_and(|last| next.negative_eigenvalues > last.negative_eigenvalues);
                return next.sense == up && (at_end || loses);
            };
            let limit_mpa = points.iter().map(|point| up * point.pressure_mpa()).fold(f64::MIN, f64::max);
            let again = next.is_stable_at_pressure() && up * next.pressure_mpa() >= limit_mpa;
            again || points.len() - turn > BEYOND_STEPS
        };
        let walk = Walk {
            length_mm: SEARCH_STEP * (to_mpa - point.pressure_mpa()).abs() * tangent.mm_per_mpa,
            longest_mm: &longest_mm,
            tries: SEARCH_STEPS + BEYOND_STEPS,
            descends: false,
            passed: &passed,
            // The limit lies before the first point whose pressure moves back.
            is_found: &|point| ends_at_limit && point.sense != up,
            notify: &mut |_| {},
        };
        let mut path = Path::default();
        let last = self.walk((point, tangent), walk, &mut path, effort);
        path.points.extend(last);
        let limit = limits(&path.points).into_iter().find(|limit| limit.kind != LimitKind::Volume)?;
        let Limit { pressure_mpa, injected_mm3, after, .. } = limit;
        if limit.kind == LimitKind::Bifurcation {
            return Some(NewtonError::Unstable { pressure_mpa, injected_mm3 });
        }
        let next_injected_mm3 = if ends_at_limit {
            None
        } else {
            self.refine(&mut path.points, (after, true), pressure_mpa, effort)
        };
        Some(NewtonError::Limit {
            pressure_mpa,
            injected_mm3,
            next_injected_mm3,
            searched_mm3: path.points.last().map_or(injected_mm3, |point| point.injected_mm3),
        })
    }

    /// Adds states where the cubics of a path have the pressure of a limit again: behind the point `after`, or before it. Returns the
    /// injected volume of the first one that is stable.
    fn refine(
        &mut self,
        points: &mut Vec<PathPoint>,
        (mut after, is_behind): (usize, bool),
        pressure_mpa: f64,
        effort: &mut Effort,
    ) -> Option<f64> {
        let found = |points: &[PathPoint], after: usize| {
            let at = |index: usize| Some((index, crossing(points.get(index..index + 2)?, pressure_mpa)?));
            if is_behind { (after + 1..points.len()).find_map(at) } else { (0..after).rev().find_map(at) }
        };
        for _ in 0..REFINEMENTS {
            let (at, injected_mm3) = found(points, after)?;
            let state = points[at].state.clone();
            let up = (injected_mm3 - points[at].injected_mm3).signum();
            let load = Load { injected_mm3: Some(injected_mm3), ..state.load };
            let Ok((state, report)) = self.solve_to(&state, &load) else { break };
            effort.factorisations += report.factorisations;
            let Ok((point, _)) = self.first(&state, up, effort) else { break };
            points.insert(at + 1, point);
            after += usize::from(!is_behind);
        }
        found(points, after).map(|(_, injected_mm3)| injected_mm3)
    }

    /// Steps along a path until a point has passed its end, which is returned and not recorded. A path that ends before says why.
    fn walk(
        &mut self,
        (mut point, mut tangent): (PathPoint, Tangent),
        walk: Walk,
        path: &mut Path,
        effort: &mut Effort,
    ) -> Option<PathPoint> {
        let mut record = |points: &mut Vec<PathPoint>, point: &PathPoint| {
            (walk.notify)(point);
            points.push(point.clone());
        };
        record(&mut path.points, &point);
        if (walk.passed)(&[], &point) {
            return Some(point);
        }
        let mut length = walk.length_mm;
        for _ in 0..walk.tries {
            let longest = (walk.longest_mm)(&point, &tangent);
            let step = length.min(longest);
            let before = effort.factorisations;
            let failed = match self.arc(&point, &tangent, step, effort) {
                Ok((next, _)) if point.both_turn(&next) && step > SHORTEST * walk.length_mm => None,
                Ok((next, along)) => {
                    let spent = effort.factorisations - before;
                    length = if spent <= EASY + 1 {
                        1.5 * step
                    } else if spent >= HARD {
                        0.6 * step
                    } else {
                        step
                    };
                    path.report.steps += 1;
                    if (walk.passed)(&path.points, &next) {
                        return Some(next);
                    }
                    if let Some(limit) = self.at_limit(&point, &next, effort) {
                        record(&mut path.points, &limit);
                    }
                    (point, tangent) = (next, along);
                    record(&mut path.points, &point);
                    if (walk.is_found)(&point) {
                        return None;
                    }
                    continue;
                }
                Err(reason) => Some(reason),
            };
            path.report.cuts += 1;
            length = 0.5 * step;
            if length >= SHORTEST * walk.length_mm || failed.is_none() {
                continue;
            }
            let across = walk.descends.then(|| self.across(&point, &tangent, longest, effort));
            let Some(Ok((next, along))) = across else {
                path.ended = failed;
                return None;
            };
            if (walk.passed)(&path.points, &next) {
                return Some(next);
            }
            (point, tangent, length) = (next, along, walk.length_mm);
            record(&mut path.points, &point);
        }
        path.ended = Some(NewtonError::PathTooLong { points: path.points.len() });
        None
    }

    /// Point near the limit of pressure between two points, which makes the cubic there exact to a few digits more.
    fn at_limit(&mut self, a: &PathPoint, b: &PathPoint, effort: &mut Effort) -> Option<PathPoint> {
        if a.sense == b.sense || a.both_turn(b) {
            return None;
        }
        let cubic = pressure_over_volume([a, b]);
        let injected_mm3 = Some(cubic.x_at(cubic.root(|[_, slope]| slope)));
        let (state, report) = self.solve_to(&a.state, &Load { injected_mm3, ..a.state.load }).ok()?;
        effort.factorisations += report.factorisations;
        Some(self.first(&state, (b.injected_mm3 - a.injected_mm3).signum(), effort).ok()?.0)
    }

    /// Point of a solved state from which the volume moves in the direction `up`.
    fn first(
        &mut self,
        state: &State,
        up: f64,
        effort: &mut Effort,
    ) -> Result<(PathPoint, Tangent), NewtonError> {
        let (mut point, tangent) = self.point(state.clone(), effort)?;
        point.sense = up * same(point.compliance_mm3_per_mpa, 1.0);
        Ok((point, tangent))
    }

    fn point(&mut self, mut state: State, effort: &mut Effort) -> Result<(PathPoint, Tangent), NewtonError> {
        state.load.injected_mm3 = None;
        let [by, gradient] = self.newton().direction(&state, effort)?;
        let injected_mm3 = self.injected_mm3(&state);
        let point = PathPoint {
            compliance_mm3_per_mpa: product(&gradient, &by),
            negative_eigenvalues: self.newton().tangent.negative_eigenvalues(),
            injected_mm3,
            state,
            sense: 1.0,
        };
        let mm_per_mpa = by.as_chunks::<3>().0.iter().map(|u| norm(*u)).fold(f64::MIN_POSITIVE, f64::max);
        Ok((point, Tangent { by, mm_per_mpa }))
    }

    /// One step along the path.
    fn arc(
        &mut self,
        from: &PathPoint,
        tangent: &Tangent,
        length_mm: f64,
        effort: &mut Effort,
    ) -> Result<(PathPoint, Tangent), NewtonError> {
        let mut state = from.state.clone();
        let newton = self.newton();
        newton.push(&mut state, &tangent.by, from.sense * length_mm / tangent.mm_per_mpa)?;
        newton.closure = Some(Closure::Normal(tangent.by.clone()));
        let load = state.load;
        let result = newton.iterate(&mut state, &load, effort);
        newton.closure = None;
        result?;
        self.reached(from, tangent, state, length_mm, effort)
    }

    /// Stable equilibrium of the volume that a step along the tangent has: behind the snap of a single element, at which no step
    /// converges.
    fn across(
        &mut self,
        from: &PathPoint,
        tangent: &Tangent,
        length_mm: f64,
        effort: &mut Effort,
    ) -> Result<(PathPoint, Tangent), NewtonError> {
        let mut state = from.state.clone();
        let cavity_mpa = from.sense * length_mm / tangent.mm_per_mpa;
        let injected_mm3 = from.injected_mm3 + from.compliance_mm3_per_mpa * cavity_mpa;
        let volume_mm3 = self.problem().undeformed_volume_mm3() + injected_mm3;
        self.newton().push(&mut state, &tangent.by, cavity_mpa)?;
        self.newton().descend(&mut state, volume_mm3, effort)?;
        let longest_mm = self.problem().config().newton.step_length_mm;
        self.reached(from, tangent, state, longest_mm, effort)
    }

    /// The error of a path that ends at its first state.
    fn stopped(&self, from: &State, reason: NewtonError) -> SolveError {
        let config = self.problem().config();
        SolveError::NotConverged(Box::new(NotConverged {
            fraction: 0.0,
            to: from.load,
            last: from.load,
            cavities_mpa: config.cavities_mpa.clone(),
            newton: config.newton,
            reason,
            report: SolveReport::default(),
        }))
    }

    /// The next point of a path, if it is near the last one.
    fn reached(
        &mut self,
        from: &PathPoint,
        tangent: &Tangent,
        state: State,
        length_mm: f64,
        effort: &mut Effort,
    ) -> Result<(PathPoint, Tangent), NewtonError> {
        let moved = state.displacement_mm.iter().zip(&from.state.displacement_mm);
        let moved_mm = moved.map(|(a, b)| norm(sub(*a, *b))).fold(0.0, f64::max);
        let allowed_mm = MAX_LENGTHS * length_mm;
        if moved_mm > allowed_mm {
            return Err(NewtonError::Jumped { moved_mm, allowed_mm });
        }
        let (mut next, along) = self.point(state, effort)?;
        next.sense = from.sense * same(product(&along.by, &tangent.by), 1.0);
        Ok((next, along))
    }
}

/// 1 if two numbers have one sign, otherwise -1.
fn same(a: f64, b: f64) -> f64 {
    if (a < 0.0) == (b < 0.0) { 1.0 } else { -1.0 }
}

/// Pressure over volume between two points.
fn pressure_over_volume([a, b]: [&PathPoint; 2]) -> Cubic {
    Cubic {
        x: [a.injected_mm3, b.injected_mm3],
        y: [a.pressure_mpa(), b.pressure_mpa()],
        slope: [1.0 / a.compliance_mm3_per_mpa, 1.0 / b.compliance_mm3_per_mpa],
    }
}

/// Volume over pressure between two points.
fn volume_over_pressure([a, b]: [&PathPoint; 2]) -> Cubic {
    Cubic {
        x: [a.pressure_mpa(), b.pressure_mpa()],
        y: [a.injected_mm3, b.injected_mm3],
        slope: [a.compliance_mm3_per_mpa, b.compliance_mm3_per_mpa],
    }
}

/// Limits between the points of a path, in order.
#[must_use]
pub fn limits(points: &[PathPoint]) -> Vec<Limit> {
    let segment = |(after, pair): (usize, &[PathPoint])| {
        let [a, b] = pair else { return None };
        let pressure_turns = a.sense * b.sense < 0.0;
        let volume_turns = a.sense * a.compliance_mm3_per_mpa * b.sense * b.compliance_mm3_per_mpa < 0.0;
        let (kind, pressure_mpa, injected_mm3) = if pressure_turns {
            let cubic = pressure_over_volume([a, b]);
            let t = cubic.root(|[_, slope]| slope);
            let kind = if a.sense > 0.0 { LimitKind::PressureMaximum } else { LimitKind::PressureMinimum };
            (kind, cubic.at(t)[0], cubic.x_at(t))
        } else if volume_turns {
            let cubic = volume_over_pressure([a, b]);
            let t = cubic.root(|[_, slope]| slope);
            (LimitKind::Volume, cubic.x_at(t), cubic.at(t)[0])
        } else if a.negative_eigenvalues != b.negative_eigenvalues {
            (
                LimitKind::Bifurcation,
                0.5 * (a.pressure_mpa() + b.pressure_mpa()),
                0.5 * (a.injected_mm3 + b.injected_mm3),
            )
        } else {
            return None;
        };
        let next_injected_mm3 = match kind {
            LimitKind::PressureMaximum => {
                points[after + 1..].windows(2).find_map(|pair| crossing(pair, pressure_mpa))
            }
            LimitKind::PressureMinimum => {
                points[..=after].windows(2).rev().find_map(|pair| crossing(pair, pressure_mpa))
            }
            LimitKind::Volume | LimitKind::Bifurcation => None,
        };
        Some(Limit { kind, after, pressure_mpa, injected_mm3, next_injected_mm3 })
    };
    points.windows(2).enumerate().filter_map(segment).collect()
}

/// Injected volume at which a stable part of the path between two points has that pressure.
fn crossing(pair: &[PathPoint], pressure_mpa: f64) -> Option<f64> {
    let [a, b] = pair else { return None };
    let (low, high) = (a.pressure_mpa() - pressure_mpa, b.pressure_mpa() - pressure_mpa);
    let stable = a.is_stable_at_pressure() || b.is_stable_at_pressure();
    let rising = a.compliance_mm3_per_mpa > 0.0 || b.compliance_mm3_per_mpa > 0.0;
    (low * high <= 0.0 && stable && rising).then(|| {
        let cubic = pressure_over_volume([a, b]);
        cubic.x_at(cubic.root(|[pressure, _]| pressure - pressure_mpa))
    })
}
