//! The finger as a body that swings: its inertial load acts as a further pressure. Simulated truths with swing, play, lag, creep, bias and
//! stiffness; the swing before the first reading is unknown.

use crate::model::{Finger, GAP, PRESSURE, Random, STIFFNESS, setup_with_middle};
use estimate::{
    Estimate, Filter, InputRole, MAX_INPUTS, Measurement, Model, MotionEnd, MotionState, Predicted, Setup,
    Status, Swing, Unknown,
};
use std::f64::consts::TAU;

const LOAD: usize = 3;
const REST: f64 = 9810.0;
/// Load per pressure at a fixed position, mm/s2 per MPa.
const PER_MPA: f64 = 343_000.0;
const RATE_HZ: f64 = 50.0;
const SUBSTEPS: usize = 20;
/// Standard deviation of the model's frequency, as a fraction.
const FREQUENCY_ERROR: f64 = 0.005;
/// Damping ratio.
const DAMPING: f64 = 0.03;

/// Motion: position as the pressure of its equilibrium, and its rate.
#[derive(Clone, Copy, Debug)]
struct Body {
    position_mpa: f64,
    rate: f64,
    touches: bool,
    /// Frequency over that of the model.
    frequency: f64,
}

impl Body {
    fn load(&self, pressure: f64) -> f64 {
        REST + PER_MPA * (self.position_mpa - pressure)
    }

    /// Straight pressure between both readings; half of the velocity is lost in a landing. Returns true if it landed or left.
    fn step(&mut self, [from, to]: [f64; 2], [gap, stiffness]: [f64; 2], seconds: f64) -> bool {
        let mut has_changed = false;
        let dt = seconds / SUBSTEPS as f64;
        for k in 0..SUBSTEPS {
            let pressure = from + (to - from) * (k as f64 + 0.5) / SUBSTEPS as f64;
            let hertz = if self.touches { 12.0 } else { 4.0 };
            let omega = self.frequency * TAU * hertz * (stiffness / 0.8).sqrt();
            self.rate -=
                dt * (omega * omega * (self.load(pressure) - REST) + 2.0 * DAMPING * omega * self.rate);
            self.position_mpa += dt * self.rate / PER_MPA;
            let now = self.position_mpa > Finger::onset_mpa(gap, stiffness);
            if now && !self.touches {
                self.rate *= 0.5;
            }
            has_changed |= now != self.touches;
            self.touches = now;
        }
        has_changed
    }
}

/// Model of the body, as exact as the truth.
struct Swinging {
    base: Option<(f64, Body)>,
    arrived: Body,
}

impl Swinging {
    fn new() -> Self {
        Self { base: None, arrived: Body { position_mpa: 0.0, rate: 0.0, touches: false, frequency: 1.0 } }
    }
}

impl Model for Swinging {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        let mut at = *inputs;
        at[PRESSURE] += (inputs[LOAD] - REST) / PER_MPA;
        let touches = Finger.predict(&at, out);
        out.iter_mut().for_each(|row| row.gradient[LOAD] = row.gradient[PRESSURE] / PER_MPA);
        touches
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        let mut at = *inputs;
        at[PRESSURE] += (inputs[LOAD] - REST) / PER_MPA;
        Finger.onset_gap_mm(&at)
    }

    fn step(&mut self, from: &MotionState, t_s: f64, inputs: &[f64; MAX_INPUTS]) -> Option<MotionEnd> {
        let (base_s, base) = self.base?;
        let pressure = from.inputs[PRESSURE];
        let position_mpa = pressure + (from.inputs[LOAD] - REST) / PER_MPA;
        let mut body = Body { position_mpa, rate: from.rate, ..base };
        let has_changed =
            body.step([pressure, inputs[PRESSURE]], [inputs[GAP], inputs[STIFFNESS]], t_s - base_s);
        self.arrived = body;
        Some(MotionEnd { load: body.load(inputs[PRESSURE]), rate: body.rate, has_changed })
    }

    fn settle(&mut self, at: &MotionState, in_contact: bool) {
        self.base = Some((at.t_s, Body { touches: in_contact, ..self.arrived }));
    }
}

/// Hidden values: gap, gauge bias, stiffness; play (kPa), line and creep of the plant, which the readings are put behind.
#[derive(Clone, Copy, Debug)]
struct Truth {
    unknowns: [f64; 3],
    play_kpa: f64,
    line_s: f64,
    creep: f64,
    has_obstacle: bool,
    /// Frequency over that of the model.
    frequency: f64,
}

/// The plant between gauge and cavity: line, play, creep of 3 s.
#[derive(Clone, Copy)]
struct Chain {
    line: f64,
    play: f64,
    creep: f64,
}

impl Chain {
    fn at(pressure: f64) -> Self {
        Self { line: pressure, play: pressure, creep: pressure }
    }

    fn advance(&mut self, truth: &Truth, read: f64) -> f64 {
        let dt = 1.0 / RATE_HZ;
        if truth.line_s > 0.0 {
            self.line += (read - self.line) * (1.0 - (-dt / truth.line_s).exp());
        } else {
            self.line = read;
        }
        let width = 0.5e-3 * truth.play_kpa;
        self.play = self.play.clamp(self.line - width, self.line + width);
        self.creep += (self.play - self.creep) * (1.0 - (-dt / 3.0).exp());
        self.play + truth.creep * (self.creep - self.play)
    }
}

/// Steps of 10 to 25 kPa every 0.6 to 1.2 s, through a valve of 50 ms, then a deflation.
fn pressures(random: &mut Random, seconds: f64) -> Vec<f64> {
    let (mut target, mut next_s, mut value) = (0.03, 0.0, 0.03);
    let one = |k: usize| {
        let t_s = k as f64 / RATE_HZ;
        if t_s >= next_s {
            next_s = t_s + random.between(0.6, 1.2);
            let step = random.between(0.01, 0.025);
            target = if target + step > 0.085 || (target > 0.03 && random.uniform() < 0.4) {
                target - step
            } else {
                target + step
            };
        }
        value += (target - value) * (1.0 - (-1.0 / (0.05 * RATE_HZ)).exp());
        value
    };
    (0..(seconds * RATE_HZ) as usize).map(one).collect()
}

/// Readings from the middle of a motion on, put behind the known plant; the body at the last one.
fn readings(truth: &Truth, seconds: f64, random: &mut Random) -> (Vec<Measurement>, Body) {
    let [gap, bias, stiffness] = truth.unknowns;
    let before_s = 2.0;
    let reads = pressures(random, before_s + seconds);
    let gap = if truth.has_obstacle { gap } else { f64::INFINITY };
    let mut acting = Chain::at(reads[0]);
    let mut body = Body { position_mpa: reads[0], rate: 0.0, touches: false, frequency: truth.frequency };
    let mut last = reads[0];
    // States taken for true, from the smallest and the largest past, and of line and play alone.
    let mut known: Option<([Chain; 3], [f64; 2])> = None;
    let mut out = Vec::new();
    for (k, read) in reads.iter().enumerate() {
        let now = acting.advance(truth, *read);
        body.step([last, now], [gap, stiffness], 1.0 / RATE_HZ);
        last = now;
        let t_s = k as f64 / RATE_HZ - before_s;
        if t_s < 0.0 {
            continue;
        }
        let gauge = *read + 0.0005 * random.normal();
        let (chains, open) = known.get_or_insert_with(|| {
            let low_high = [0.0, 0.1].map(|past| Chain { line: past, play: past, creep: past });
            ([Chain::at(gauge), low_high[0], low_high[1]], [gauge, 0.1 - gauge])
        });
        let [nominal, low, high] = chains.each_mut().map(|chain| chain.advance(truth, gauge));
        let fade = (-1.0 / (3.0 * RATE_HZ)).exp();
        *open = open.map(|open| open * fade);
        let all = (high - nominal).max(nominal - low).max(0.0);
        let of_creep = (truth.creep * open[0].max(open[1])).min(all);
        let mut inputs = [f64::NAN; MAX_INPUTS];
        inputs[..4].copy_from_slice(&[now, gap, stiffness, body.load(now)]);
        let mut predicted = [Predicted::default(); 5];
        Swinging::new().predict(&inputs, &mut predicted);
        let mut reading = Measurement::at(t_s);
        reading.inputs[PRESSURE] = nominal + bias;
        reading.spread[PRESSURE] = [all - of_creep, of_creep];
        for (row, sigma) in [0.005, 0.2, 0.2, 0.2, 0.2].into_iter().enumerate() {
            reading.rows[row] = predicted[row].value + sigma * random.normal();
        }
        out.push(reading);
    }
    (out, body)
}

fn rig() -> Setup {
    let mut setup = setup_with_middle();
    let unknown = |name: &str, prior, sigma, end: f64| Unknown {
        name: name.into(),
        prior,
        sigma,
        drift_per_sqrt_s: 0.0,
        range: [prior - end, prior + end],
    };
    setup.unknowns.extend([
        unknown("pressure_past", 0.0, 1.0, 1.0),
        unknown("pressure_creep_past", 0.0, 1.0, 1.0),
        unknown("load", REST, 10_000.0, 100_000.0),
        unknown("load_rate", 0.0, 250_000.0, 1e7),
    ]);
    let InputRole::Measured { pasts, .. } = &mut setup.inputs[PRESSURE] else {
        panic!("a measured pressure")
    };
    *pasts = [Some(3), Some(4)];
    setup.inputs.push(InputRole::Estimated(5));
    setup.swing = Some(Swing { load: 5, rate: 6, frequency_error: FREQUENCY_ERROR });
    setup
}

fn draw(random: &mut Random) -> Truth {
    Truth {
        unknowns: [random.between(32.0, 60.0), random.between(-0.002, 0.002), random.between(0.68, 0.92)],
        play_kpa: 0.0,
        line_s: 0.0,
        creep: 0.0,
        has_obstacle: true,
        frequency: 1.0 + FREQUENCY_ERROR * random.normal(),
    }
}

#[derive(Debug, Default)]
struct Counts {
    covered: usize,
    values: usize,
    consistent: usize,
    readings: usize,
    alarms: usize,
    silent: Vec<String>,
}

fn follow(
    setup: &Setup,
    truth: &Truth,
    (readings, end): &(Vec<Measurement>, Body),
    counts: &mut Counts,
    limit: f64,
) -> Filter {
    let mut filter = Filter::new(setup.clone()).expect("a valid setup");
    let mut model = Swinging::new();
    let (mut alarm, mut inputs) = (None, [f64::NAN; MAX_INPUTS]);
    for reading in readings {
        let update = filter.update(reading, &mut model);
        (alarm, inputs) = (update.alarm, update.inputs);
        if update.status == Status::Used {
            counts.readings += 1;
            counts.consistent += usize::from((update.nis_band[0]..=update.nis_band[1]).contains(&update.nis));
        }
    }
    counts.alarms += usize::from(alarm.is_some());
    let estimates: Vec<Estimate> = filter.estimates().collect();
    let swing = setup.swing.expect("a swing");
    // The position of the body, as a load at a fixed pressure.
    let position = inputs[PRESSURE] + (inputs[LOAD] - REST) / PER_MPA;
    let offs = (0..3).map(|at| (estimates[at].value - truth.unknowns[at], estimates[at].sigma));
    let moving = [
        ((position - end.position_mpa) * PER_MPA, estimates[swing.load].sigma),
        (estimates[swing.rate].value - end.rate, estimates[swing.rate].sigma),
    ];
    for (at, (off, sigma)) in offs.chain(moving).enumerate() {
        let (off, estimate) = (off.abs() / sigma, estimates[at]);
        counts.values += 1;
        counts.covered += usize::from(off <= 1.96);
        if off > limit && alarm.is_none() {
            counts.silent.push(format!("{truth:?}: unknown {at}, {off} standard deviations, {estimate:?}"));
        }
    }
    filter
}

#[test]
fn swing_of_unknown_beginning_tells_stiffness_bias_and_gap() {
    let (mut random, mut counts) = (Random(77), Counts::default());
    let mut found = [0; 3];
    for _ in 0..100 {
        let truth = draw(&mut random);
        let readings = readings(&truth, 4.0, &mut random);
        let filter = follow(&rig(), &truth, &readings, &mut counts, 3.5);
        for (found, estimate) in found.iter_mut().zip(filter.estimates()) {
            *found += usize::from(estimate.identifiable);
        }
    }
    let share = |part: usize, all: usize| part as f64 / all as f64;
    let covered = share(counts.covered, counts.values);
    let consistent = share(counts.consistent, counts.readings);
    println!(
        "within 95 % bounds {:.1} %, NIS within its band {:.1} %, {} far and silent, {} false alarms",
        100.0 * covered,
        100.0 * consistent,
        counts.silent.len(),
        counts.alarms
    );
    assert!((0.90..=0.99).contains(&covered), "{counts:?}");
    assert!((0.92..=0.98).contains(&consistent), "{counts:?}");
    assert!(counts.silent.is_empty() && counts.alarms <= 5, "{counts:?}");
    assert!(found.iter().all(|found| *found >= 90), "{found:?}");
}

/// A body that never touches: the swing alone tells the stiffness.
#[test]
fn free_swing_tells_the_stiffness() {
    let (mut random, mut counts) = (Random(11), Counts::default());
    for _ in 0..20 {
        let truth = Truth { has_obstacle: false, ..draw(&mut random) };
        let readings = readings(&truth, 4.0, &mut random);
        let mut setup = rig();
        setup.inputs[GAP] = InputRole::Given(f64::INFINITY);
        let filter = follow(&setup, &truth, &readings, &mut counts, 3.5);
        let estimates: Vec<_> = filter.estimates().collect();
        assert!(estimates[2].identifiable || estimates[2].sigma < 0.06, "{truth:?} {estimates:?}");
    }
}

/// Twelve recordings of plants with play of 0 to 5 kPa, a line of 0.1 to 1.5 s, creep and a swing, drawn at random.
#[test]
fn hidden_recordings_with_play_line_creep_and_swing() {
    let mut random = Random(12);
    for number in 0..12 {
        let mut truth = draw(&mut random);
        truth.play_kpa = random.between(0.0, 5.0);
        truth.line_s = random.between(0.1, 1.5);
        truth.creep = random.between(0.0, 0.2);
        let readings = readings(&truth, 24.0, &mut random);
        let mut counts = Counts::default();
        let filter = follow(&rig(), &truth, &readings, &mut counts, 3.0);
        let off: Vec<String> = filter
            .estimates()
            .zip(truth.unknowns)
            .map(|(estimate, truth)| format!("{:+.1}", (estimate.value - truth) / estimate.sigma))
            .collect();
        println!(
            "{number}: play {:.1} kPa, line {:.2} s, creep {:.2}: gap, bias, stiffness off by {} sigma, {} alarms",
            truth.play_kpa,
            truth.line_s,
            truth.creep,
            off.join(", "),
            counts.alarms
        );
        assert!(counts.silent.is_empty() && counts.alarms == 0, "{counts:?}");
    }
}
