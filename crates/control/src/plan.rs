//! Predictive law: the command that keeps the pressure behind the swing at its reference over a horizon.
//!
//! ```text
//! c' = (u - b - c) / tau of filling or emptying,   v = H(c),   q'' = w^2 (v - q) - 2 z w q'
//! min  sum_k (q_k - r_k)^2 + W_s (v_k - q_k)^2  +  sum_j W_u (u_j - u_(j-1))^2  +  W_f s + W_f s^2
//! low <= u_j <= high,   |u_j - u_(j-1)| <= rate (t_j - t_(j-1)),   q_k <= q_max + s,   0 <= s
//! ```
//!
//! `r` is the model's inverse of the target plus the error of the model, approached with `approach_s`: pressures behind the swing, in which
//! force limit and observables are linear. Each cycle moves the last plan on, predicts along it with derivatives, and solves one quadratic
//! program for the change (real-time iteration); the plan's first command is given.

use crate::settings::{Limits, Settings};
use crate::shape::{Plays, lag};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use rom::memory::MAX_PLAYS;

/// Stages of the horizon.
const STAGES: usize = 50;
/// Stages over which each move is constant.
const BLOCKS: [usize; MOVES] = [1, 1, 2, 2, 3, 3, 4, 5, 6, 7, 8, 8];
const MOVES: usize = 12;
/// Unknowns: changes of the moves, and what is beyond the force limit.
const UNKNOWNS: usize = MOVES + 1;
/// Stages between two points of time at which the target is inverted.
const KNOT_STAGES: usize = 5;
const KNOTS: usize = STAGES / KNOT_STAGES + 1;
/// Pressure in whose unit the program is stated, MPa.
const UNIT_MPA: f64 = 0.01;
/// Weights relative to that of the difference to the reference: of what accelerates the swing, of each change of the command, of what is beyond
/// the force limit.
const SWING_WEIGHT: f64 = 0.5;
const MOVE_WEIGHT: f64 = 0.02;
const BEYOND_WEIGHT: f64 = 1e3;
/// Share of the swing's frequency with which the prediction of the swing follows what is measured.
const SEEN_SHARE: f64 = 0.3;
/// Time constant of the approach relative to `approach_s`: the plan has no shaper, and this much slower a swing that is off by a third, or a body
/// that is softer by as much, overshoots by less than 5 %.
const APPROACH: f64 = 1.6;
/// Part of the program's change that is taken in a cycle: within the play the derivatives are those at its end, and whole changes would lead to
/// and fro from cycle to cycle.
const RELAXED: f64 = 0.3;
/// Commands that are remembered until they reach the valve.
const SENT: usize = 256;

/// A time at which the target is inverted.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Knot {
    pub(crate) ahead_s: f64,
    /// Pressure that the target has in the model, MPa.
    pub(crate) reference_mpa: f64,
}

/// Pressures known at a cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlanInput {
    /// Pressure in the cavity and the state of the play there.
    pub(crate) cavity_mpa: f64,
    pub(crate) plays: Plays,
    /// The valve's error, MPa.
    pub(crate) bias_mpa: f64,
    /// The last command, MPa.
    pub(crate) command_mpa: f64,
    /// Error of the model as a pressure, MPa.
    pub(crate) shift_mpa: f64,
    /// Measured pressure behind the swing minus the one before it, MPa.
    pub(crate) missing_mpa: Option<f64>,
    /// Pressure behind the swing at the force limit.
    pub(crate) most_mpa: f64,
}

/// A value and its derivatives by the moves (a dual number).
#[derive(Debug, Clone, Copy)]
struct Dual {
    value: f64,
    by: [f64; MOVES],
}

impl Dual {
    fn constant(value: f64) -> Self {
        Self { value, by: [0.0; MOVES] }
    }

    /// `factor self + other_factor other`.
    fn mixed(&self, factor: f64, other: &Self, other_factor: f64) -> Self {
        let mut by = self.by;
        by.iter_mut()
            .zip(&other.by)
            .for_each(|(mine, theirs)| *mine = factor * *mine + other_factor * theirs);
        Self { value: factor * self.value + other_factor * other.value, by }
    }
}

/// Exact step of the swing over a time with constant input: `[q, q']` relative to that input.
#[derive(Debug, Clone, Copy)]
struct Swing([[f64; 2]; 2]);

impl Swing {
    fn new(hz: f64, damping: f64, dt_s: f64) -> Self {
        let w = std::f64::consts::TAU * hz;
        let (decay, damped) = (damping * w, w * (1.0 - damping * damping).sqrt());
        let (fade, (sine, cosine)) = ((-decay * dt_s).exp(), (damped * dt_s).sin_cos());
        Self([
            [fade * (cosine + decay / damped * sine), fade * sine / damped],
            [-fade * w * w / damped * sine, fade * (cosine - decay / damped * sine)],
        ])
    }
}

/// The plan and what it begins from.
#[derive(Debug)]
pub(crate) struct Planner {
    stage_s: f64,
    limits: Limits,
    moves_mpa: [f64; MOVES],
    knots: [Knot; KNOTS],
    /// Begin and end of the last reference's first part, and what is left of the way to it, MPa.
    last_mpa: [f64; 2],
    away_mpa: f64,
    /// Pressure behind the swing, MPa, its change, MPa/s, and the pressure before the swing.
    swing: [f64; 2],
    before_mpa: f64,
    /// Commands, MPa, and the times for which they were given, s; the newest at `newest`.
    sent: [[f64; 2]; SENT],
    newest: usize,
    program: Program,
    pub(crate) max_iterations: u32,
}

impl Planner {
    pub(crate) fn new(settings: &Settings, limits: &Limits) -> Self {
        let stage_s = settings.horizon_s / STAGES as f64;
        let ahead = |knot: usize| (knot * KNOT_STAGES) as f64 * stage_s + settings.delay_s;
        Self {
            stage_s,
            limits: *limits,
            moves_mpa: [0.0; MOVES],
            knots: std::array::from_fn(|knot| Knot { ahead_s: ahead(knot), reference_mpa: 0.0 }),
            last_mpa: [0.0; 2],
            away_mpa: 0.0,
            swing: [0.0; 2],
            before_mpa: 0.0,
            sent: [[0.0; 2]; SENT],
            newest: 0,
            program: Program::new(UNKNOWNS),
            max_iterations: MAX_ITERATIONS,
        }
    }

    /// At rest at a pressure.
    pub(crate) fn start(&mut self, command_mpa: f64, behind_mpa: f64, shift_mpa: f64) {
        (self.last_mpa, self.away_mpa) = ([behind_mpa - shift_mpa; 2], 0.0);
        self.moves_mpa = [command_mpa; MOVES];
        self.swing = [behind_mpa, 0.0];
        self.before_mpa = behind_mpa;
        self.sent = [[command_mpa, 0.0]; SENT];
    }

    /// Times at which the target is wanted, with the references of the last cycle.
    pub(crate) fn knots(&mut self) -> &mut [Knot] {
        &mut self.knots
    }

    /// The next command; `None` where the program has no solution within its iterations.
    pub(crate) fn command(&mut self, settings: &Settings, now: &PlanInput, dt_s: f64) -> Option<f64> {
        self.observe(settings, now, dt_s);
        let start = self.at_the_valve(settings, now);
        self.move_on(dt_s);
        self.approach(settings, dt_s);
        self.build_program(settings, now, start, dt_s);
        let change = self.program.solve(self.max_iterations)?;
        for (moved, by) in self.moves_mpa.iter_mut().zip(&change) {
            *moved += RELAXED * UNIT_MPA * by;
        }
        Some(self.moves_mpa[0])
    }

    /// Follows the readings while the first law commands; a plan that begins later begins at its command.
    pub(crate) fn rest(&mut self, settings: &Settings, now: &PlanInput, dt_s: f64) {
        self.observe(settings, now, dt_s);
        self.approach(settings, dt_s);
        self.moves_mpa = [now.command_mpa; MOVES];
    }

    /// The target is the same over the horizon, within a pressure.
    pub(crate) fn is_flat(&self, within_mpa: f64) -> bool {
        let [first, ..] = self.knots;
        self.knots.iter().all(|knot| (knot.reference_mpa - first.reference_mpa).abs() <= within_mpa)
    }

    /// Moves the swing's state to the time of the reading.
    fn observe(&mut self, settings: &Settings, now: &PlanInput, dt_s: f64) {
        let behind_mpa = now.plays.output(&settings.play, now.cavity_mpa);
        let input_mpa = 0.5 * (self.before_mpa + behind_mpa);
        self.before_mpa = behind_mpa;
        self.swing = swung(settings, self.swing, input_mpa, dt_s);
        if let Some(missing_mpa) = now.missing_mpa.filter(|_| settings.swing_hz > 0.0) {
            let share = 1.0 - (-SEEN_SHARE * std::f64::consts::TAU * settings.swing_hz * dt_s).exp();
            self.swing[0] += share * (behind_mpa + missing_mpa - self.swing[0]);
        }
        self.newest = (self.newest + 1) % SENT;
        self.sent[self.newest] = [now.command_mpa, dt_s];
    }

    /// Cavity, play and swing when the next command reaches the valve.
    fn at_the_valve(&self, settings: &Settings, now: &PlanInput) -> PlanStart {
        let mut start = PlanStart { cavity_mpa: now.cavity_mpa, plays: now.plays, swing: self.swing };
        let (mut back, mut past_s) = (0, 0.0);
        while back < SENT - 1 && past_s < settings.delay_s {
            past_s += self.sent[(self.newest + SENT - back) % SENT][1];
            back += 1;
        }
        let mut left_s = settings.delay_s;
        for at in (0..back).rev() {
            let [command_mpa, given_s] = self.sent[(self.newest + SENT - at) % SENT];
            let step_s = given_s.min(left_s);
            left_s -= step_s;
            start.cavity_mpa = lag(start.cavity_mpa, command_mpa - now.bias_mpa, settings.line, step_s);
            let input_mpa = start.plays.follow(&settings.play, start.cavity_mpa);
            start.swing = swung(settings, start.swing, input_mpa, step_s);
        }
        start
    }

    /// The last plan, `dt_s` later.
    fn move_on(&mut self, dt_s: f64) {
        for (index, stages) in BLOCKS.iter().enumerate().take(MOVES - 1) {
            let share = (dt_s / (*stages as f64 * self.stage_s)).min(1.0);
            self.moves_mpa[index] += share * (self.moves_mpa[index + 1] - self.moves_mpa[index]);
        }
        let [low, high] = self.limits.range_mpa;
        self.moves_mpa.iter_mut().for_each(|moved| *moved = moved.clamp(low, high));
    }

    /// The way to a target that has jumped, first order in time; a target that was known ahead is followed.
    fn approach(&mut self, settings: &Settings, dt_s: f64) {
        let [first, second] = self.last_mpa;
        let expected_mpa = first + (second - first) * dt_s / (KNOT_STAGES as f64 * self.stage_s);
        self.last_mpa = [self.knots[0].reference_mpa, self.knots[1].reference_mpa];
        self.away_mpa =
            (self.away_mpa + expected_mpa - self.last_mpa[0]) * (-dt_s / approach_s(settings)).exp();
    }

    /// Writes the quadratic program: what is predicted along the plan, weights, limits.
    fn build_program(&mut self, settings: &Settings, now: &PlanInput, start: PlanStart, dt_s: f64) {
        self.program.clear();
        let mut along = Prediction::new(settings, &start, self.stage_s);
        let mut stage = 0;
        let mut last = Dual::constant(now.command_mpa);
        for (index, stages) in BLOCKS.iter().enumerate() {
            let mut command = Dual::constant(self.moves_mpa[index]);
            command.by[index] = 1.0;
            self.add_limits(&command, &last, index, dt_s);
            self.add_square_of(&command.mixed(1.0, &last, -1.0), MOVE_WEIGHT.sqrt());
            for _ in 0..*stages {
                let before = along.step(&command, now.bias_mpa);
                let time_s = (stage + 1) as f64 * self.stage_s;
                let reference_mpa = self.reference(time_s);
                let away = now.shift_mpa + self.away_mpa * (-time_s / approach_s(settings)).exp();
                let after = along.swing[0];
                self.add_square_of(&after.mixed(1.0, &Dual::constant(reference_mpa + away), -1.0), 1.0);
                if settings.swing_hz > 0.0 {
                    self.add_square_of(&before.mixed(1.0, &after, -1.0), SWING_WEIGHT.sqrt());
                }
                if now.most_mpa < f64::INFINITY && stage % 2 == 1 {
                    let bound = (now.most_mpa - after.value) / UNIT_MPA;
                    self.program
                        .add_row(bound, |column| if column < MOVES { after.by[column] } else { -1.0 });
                }
                stage += 1;
            }
            last = command;
        }
        self.program.hessian[UNKNOWNS * UNKNOWNS - 1] += BEYOND_WEIGHT;
        self.program.gradient[UNKNOWNS - 1] += BEYOND_WEIGHT;
        self.program.add_row(0.0, |column| if column == MOVES { -1.0 } else { 0.0 });
    }

    /// Range of a move, and its rate from the one before.
    fn add_limits(&mut self, command: &Dual, last: &Dual, move_index: usize, dt_s: f64) {
        let [low, high] = self.limits.range_mpa.map(|end| (end - command.value) / UNIT_MPA);
        let by = |column: usize| f64::from(u8::from(column == move_index));
        self.program.add_row(high, by);
        self.program.add_row(-low, |column| -by(column));
        let time_s = if move_index == 0 { dt_s } else { BLOCKS[move_index - 1] as f64 * self.stage_s };
        let step = command.mixed(1.0, last, -1.0);
        let [up, down] =
            [1.0, -1.0].map(|sign| (self.limits.rate_mpa_per_s * time_s - sign * step.value) / UNIT_MPA);
        let by = |column: usize| step.by.get(column).copied().unwrap_or(0.0);
        self.program.add_row(up, by);
        self.program.add_row(down, |column| -by(column));
    }

    /// Adds the square of a residual to what the program minimises.
    fn add_square_of(&mut self, residual: &Dual, weight: f64) {
        let mut by = [0.0; UNKNOWNS];
        by.iter_mut().zip(&residual.by).for_each(|(mine, theirs)| *mine = weight * theirs);
        self.program.add_square(&by, weight * residual.value / UNIT_MPA);
    }

    /// Reference between the knots.
    fn reference(&self, time_s: f64) -> f64 {
        let knot = time_s / (KNOT_STAGES as f64 * self.stage_s);
        let before = (knot as usize).min(KNOTS - 2);
        let [first, second] = [before, before + 1].map(|knot| self.knots[knot].reference_mpa);
        first + (second - first) * (knot - before as f64).min(1.0)
    }
}

fn approach_s(settings: &Settings) -> f64 {
    APPROACH * settings.approach_s
}

/// Iterations after which there is no plan: twice what the hardest of the studies' plants needed.
const MAX_ITERATIONS: u32 = 40;

/// Begin of a prediction.
#[derive(Debug, Clone, Copy)]
struct PlanStart {
    cavity_mpa: f64,
    plays: Plays,
    swing: [f64; 2],
}

fn swung(settings: &Settings, [at, speed]: [f64; 2], input_mpa: f64, dt_s: f64) -> [f64; 2] {
    if settings.swing_hz <= 0.0 {
        return [input_mpa, 0.0];
    }
    let Swing([away_row, speed_row]) = Swing::new(settings.swing_hz, settings.swing_damping, dt_s);
    let away = at - input_mpa;
    [input_mpa + away_row[0] * away + away_row[1] * speed, speed_row[0] * away + speed_row[1] * speed]
}

/// A prediction on its way, with derivatives.
struct Prediction<'a> {
    settings: &'a Settings,
    stage_s: f64,
    swing_step: Option<Swing>,
    cavity: Dual,
    plays: [Dual; MAX_PLAYS],
    before: Dual,
    swing: [Dual; 2],
}

impl<'a> Prediction<'a> {
    fn new(settings: &'a Settings, start: &PlanStart, stage_s: f64) -> Self {
        let before = start.plays.output(&settings.play, start.cavity_mpa);
        let swing_step =
            (settings.swing_hz > 0.0).then(|| Swing::new(settings.swing_hz, settings.swing_damping, stage_s));
        Self {
            settings,
            stage_s,
            swing_step,
            cavity: Dual::constant(start.cavity_mpa),
            plays: start.plays.states().map(Dual::constant),
            before: Dual::constant(before),
            swing: start.swing.map(Dual::constant),
        }
    }

    /// One stage; returns the pressure before the swing.
    fn step(&mut self, command: &Dual, bias_mpa: f64) -> Dual {
        let into = command.mixed(1.0, &Dual::constant(bias_mpa), -1.0);
        let line = self.settings.line;
        let time_s = if into.value >= self.cavity.value { line.fill_s } else { line.empty_s };
        let stays = (-self.stage_s / time_s).exp();
        self.cavity = self.cavity.mixed(stays, &into, 1.0 - stays);
        let mut output = self.cavity;
        for (play, state) in self.settings.play.iter().zip(&mut self.plays) {
            // Within the play the output does not move; its derivative is that at the end to which the cavity moves, which leads there.
            *state = Dual { value: play.follow(state.value, self.cavity.value), by: self.cavity.by };
            output = output.mixed(1.0, &state.mixed(1.0, &self.cavity, -1.0), play.weight);
        }
        let input = self.before.mixed(0.5, &output, 0.5);
        self.before = output;
        let [at, speed] = &self.swing;
        self.swing = match &self.swing_step {
            None => [output, Dual::constant(0.0)],
            Some(Swing([away_row, speed_row])) => {
                let away = at.mixed(1.0, &input, -1.0);
                [
                    input.mixed(1.0, &away.mixed(away_row[0], speed, away_row[1]), 1.0),
                    away.mixed(speed_row[0], speed, speed_row[1]),
                ]
            }
        };
        output
    }
}

// ---- the quadratic program: its unknowns are few, its rows dense ----

/// `min z' H z / 2 + g' z` subject to `rows z <= bounds`.
#[derive(Debug)]
pub(crate) struct Program {
    size: usize,
    /// Column by column.
    pub(crate) hessian: Vec<f64>,
    pub(crate) gradient: Vec<f64>,
    rows: Vec<f64>,
    bounds: Vec<f64>,
}

impl Program {
    pub(crate) fn new(size: usize) -> Self {
        let (hessian, gradient) = (vec![0.0; size * size], vec![0.0; size]);
        Self { size, hessian, gradient, rows: Vec::new(), bounds: Vec::new() }
    }

    /// Without terms and rows.
    pub(crate) fn clear(&mut self) {
        self.hessian.fill(0.0);
        self.gradient.fill(0.0);
        self.rows.clear();
        self.bounds.clear();
    }

    /// Adds half of the square of `residual + by z`.
    pub(crate) fn add_square(&mut self, by: &[f64], residual: f64) {
        for (column, of_column) in by.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            self.gradient[column] += of_column * residual;
            for (row, of_row) in by.iter().enumerate() {
                self.hessian[column * self.size + row] += of_column * of_row;
            }
        }
    }

    /// Adds `row z <= bound`; rows with an infinite bound are left out.
    pub(crate) fn add_row(&mut self, bound: f64, row: impl Fn(usize) -> f64) {
        if bound < f64::INFINITY {
            self.rows.extend((0..self.size).map(row));
            self.bounds.push(bound);
        }
    }

    /// The optimum; `None` without one after `max_iterations`. Allocates.
    pub(crate) fn solve(&self, max_iterations: u32) -> Option<Vec<f64>> {
        let upper = |row: usize, column: usize| {
            if row <= column { self.hessian[column * self.size + row] } else { 0.0 }
        };
        let hessian = sparse(self.size, self.size, upper);
        let rows = sparse(self.bounds.len(), self.size, |row, column| self.rows[row * self.size + column]);
        let settings =
            DefaultSettings { verbose: false, max_iter: max_iterations, ..DefaultSettings::default() };
        let cones = [NonnegativeConeT(self.bounds.len())];
        let mut solver =
            DefaultSolver::new(&hessian, &self.gradient, &rows, &self.bounds, &cones, settings).ok()?;
        solver.solve();
        let is_solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        (is_solved && solver.solution.x.iter().all(|value| value.is_finite())).then_some(solver.solution.x)
    }
}

/// Entries other than 0, by columns.
fn sparse(rows: usize, columns: usize, value: impl Fn(usize, usize) -> f64) -> CscMatrix<f64> {
    let (mut starts, mut places, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..columns {
        for row in 0..rows {
            let entry = value(row, column);
            if entry != 0.0 {
                places.push(row);
                values.push(entry);
            }
        }
        starts.push(values.len());
    }
    CscMatrix::new(rows, columns, starts, places, values)
}

#[cfg(test)]
#[path = "../tests/unit/plan.rs"]
mod tests;
