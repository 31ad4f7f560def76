//! Faults that readings show while a controller drives: each ends the control until it is released.

use serde::Serialize;

/// Why a controller has let go of the valve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// The gauge does not follow what the valve was given: supply gone, tube off, valve stuck, gauge frozen.
    NoResponse,
    /// The quantity moves against its model: sign of a sensor, of an axis, or another actuator.
    OppositeSign,
    /// The correction stays at its largest: the model does not explain the measurement.
    Unexplained,
    /// The measured quantity is absent for too long: marker hidden, load cell beyond its range.
    MeasurementLost,
}

impl Fault {
    pub fn name(self) -> &'static str {
        match self {
            Self::NoResponse => "no-response",
            Self::OppositeSign => "opposite-sign",
            Self::Unexplained => "unexplained",
            Self::MeasurementLost => "measurement-lost",
        }
    }

    /// Cause and remedy.
    pub fn advice(self) -> &'static str {
        match self {
            Self::NoResponse => "the gauge does not follow the valve: look at supply, tube, valve and gauge",
            Self::OppositeSign => {
                "the quantity moves against its model: look at the sign of the sensor and at the camera's frame"
            }
            Self::Unexplained => {
                "the model does not explain the measurement: look at gap, stiffness and sensor, or raise correction_max_mpa"
            }
            Self::MeasurementLost => "no measurement of the quantity: look at load cell or camera",
        }
    }
}

/// Signs of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Signs {
    /// Pressure that the valve was given, without the correction of its error, MPa.
    pub(crate) written_mpa: f64,
    /// What the gauge should show of it, MPa.
    pub(crate) expected_mpa: f64,
    /// What the gauge shows, MPa.
    pub(crate) read_mpa: f64,
    /// Correction of the valve's error, MPa.
    pub(crate) bias_mpa: f64,
    /// Pressure behind the play, which drives the quantity, MPa.
    pub(crate) driven_mpa: f64,
    /// Pressure at which the model has the measured value, MPa; `None` where that says nothing.
    pub(crate) found_mpa: Option<f64>,
    /// The correction is at its largest.
    pub(crate) is_at_limit: bool,
    /// The quantity has to be measured and is not.
    pub(crate) is_missing: bool,
}

/// Difference of the read pressure to the expected and to the written one from which the gauge has to move, MPa.
const APART_MPA: f64 = 5e-3;
/// Least such movement towards the written pressure, relative to the last `MEMORY_S`, MPa.
const MOVED_MPA: f64 = 5e-4;
/// Movement of what was written from which a gauge that shows the same value all the time is frozen, MPa. The sign above misses that where the
/// pressure swings around the frozen value, and where the slow correction of the valve's error takes the difference for its own.
const FROZEN_MPA: f64 = 1e-2;
/// Movement behind the play from which the quantity has to follow, MPa.
const DRIVEN_MPA: f64 = 3e-3;
/// Part of it that counts as the opposite direction.
const AGAINST: f64 = 0.3;
/// Time over which movements are seen, s.
const MEMORY_S: f64 = 0.5;
/// The faults and the time for which the sign of each has to last, s.
const WATCHED: [(Fault, f64); 4] = [
    (Fault::NoResponse, 0.5),
    (Fault::OppositeSign, 0.2),
    (Fault::Unexplained, 1.0),
    (Fault::MeasurementLost, 0.5),
];

/// A value minus its mean over the last `MEMORY_S`.
#[derive(Debug, Clone, Copy)]
struct Movement {
    mean: f64,
}

impl Movement {
    const UNKNOWN: Self = Self { mean: f64::NAN };

    fn step(&mut self, value: f64, dt_s: f64) -> f64 {
        if self.mean.is_nan() {
            self.mean = value;
        }
        self.mean += (value - self.mean) * (1.0 - (-dt_s / MEMORY_S).exp());
        value - self.mean
    }
}

/// Lowest and highest pressure that the gauge should have shown since it last moved.
#[derive(Debug, Clone, Copy)]
struct Still {
    read_mpa: f64,
    should_mpa: [f64; 2],
}

impl Still {
    const UNKNOWN: Self = Self { read_mpa: f64::NAN, should_mpa: [f64::NAN; 2] };

    /// The width of that range, MPa.
    fn step(&mut self, read_mpa: f64, should_mpa: f64) -> f64 {
        let is_still = (read_mpa - self.read_mpa).abs() < MOVED_MPA;
        if is_still {
            let [low, high] = self.should_mpa;
            self.should_mpa = [low.min(should_mpa), high.max(should_mpa)];
        } else {
            *self = Self { read_mpa, should_mpa: [should_mpa; 2] };
        }
        self.should_mpa[1] - self.should_mpa[0]
    }
}

/// Time for which the gauge stays below what was written until the supply is taken for low, and until its not following even that is a fault, s.
const SHORT_S: f64 = 0.2;
const STAYS_S: f64 = 1.0;
/// Pressure with which nothing is held any more: a supply that gives less is gone, MPa.
const NOTHING_MPA: f64 = 5e-3;

/// The highest pressure that a low supply gives, by what the gauge shows.
#[derive(Debug, Clone, Copy)]
struct Supply {
    is_held: bool,
    most_mpa: f64,
    short_s: f64,
    stays_s: f64,
}

impl Supply {
    /// Whether a gauge that stays below the written pressure is explained by the supply.
    fn explains(&mut self, read_mpa: f64, is_below: bool, dt_s: f64) -> bool {
        // A supply that comes back lets the gauge rise to the last limit, and the limit with it.
        self.most_mpa = self.most_mpa.max(read_mpa);
        self.short_s = if is_below { self.short_s + dt_s } else { 0.0 };
        self.stays_s = if is_below { self.stays_s + dt_s } else { 0.0 };
        if self.short_s > SHORT_S && read_mpa > NOTHING_MPA {
            if self.most_mpa - read_mpa > MOVED_MPA {
                self.stays_s = 0.0;
            }
            (self.most_mpa, self.short_s) = (read_mpa, 0.0);
        }
        self.is_held && is_below && read_mpa > NOTHING_MPA && self.stays_s < STAYS_S
    }
}

/// Movements and how long each sign lasts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Monitor {
    gauge: Movement,
    still: Still,
    driven: Movement,
    found: Movement,
    supply: Supply,
    /// For how long the sign of each fault has been there, in the order of [`WATCHED`], s.
    since_s: [f64; WATCHED.len()],
    /// Gauge minus its mean over the last `MEMORY_S`, MPa.
    pub(crate) gauge_moved_mpa: f64,
}

impl Monitor {
    /// `holds_low_supply`: a gauge that stays below what was written is a limit first.
    pub(crate) fn new(holds_low_supply: bool) -> Self {
        Self {
            gauge: Movement::UNKNOWN,
            still: Still::UNKNOWN,
            driven: Movement::UNKNOWN,
            found: Movement::UNKNOWN,
            supply: Supply { is_held: holds_low_supply, most_mpa: f64::INFINITY, short_s: 0.0, stays_s: 0.0 },
            since_s: [0.0; _],
            gauge_moved_mpa: 0.0,
        }
    }

    /// The highest pressure that the supply gives; infinite where nothing shows it.
    pub(crate) fn most_mpa(&self) -> f64 {
        if self.supply.is_held { self.supply.most_mpa } else { f64::INFINITY }
    }

    /// The first fault whose sign has lasted long enough.
    pub(crate) fn step(&mut self, signs: Signs, dt_s: f64) -> Option<Fault> {
        let Signs { written_mpa, expected_mpa, read_mpa, .. } = signs;
        let apart_mpa = (expected_mpa - read_mpa).abs().min((written_mpa - read_mpa).abs());
        self.gauge_moved_mpa = self.gauge.step(read_mpa, dt_s);
        let moved_mpa = self.gauge_moved_mpa * (written_mpa - read_mpa).signum();
        let is_opposite = match signs.found_mpa {
            Some(found_mpa) => {
                let driven_mpa = self.driven.step(signs.driven_mpa, dt_s);
                let found_mpa = self.found.step(found_mpa, dt_s) * driven_mpa.signum();
                driven_mpa.abs() > DRIVEN_MPA && found_mpa < -AGAINST * driven_mpa.abs()
            }
            None => {
                (self.driven, self.found) = (Movement::UNKNOWN, Movement::UNKNOWN);
                false
            }
        };
        let is_away = apart_mpa > APART_MPA && moved_mpa < MOVED_MPA;
        let is_below = is_away && read_mpa < written_mpa.min(expected_mpa);
        let is_explained = self.supply.explains(read_mpa, is_below, dt_s);
        let is_away = is_away && !is_explained;
        let should_mpa = (expected_mpa + signs.bias_mpa).min(self.most_mpa());
        let is_frozen = self.still.step(read_mpa, should_mpa) > FROZEN_MPA;
        let is_there = [is_frozen || is_away, is_opposite, signs.is_at_limit, signs.is_missing];
        for (since_s, is_there) in self.since_s.iter_mut().zip(is_there) {
            *since_s = if is_there { *since_s + dt_s } else { 0.0 };
        }
        let mut watched = self.since_s.iter().zip(WATCHED);
        watched.find(|(since_s, (_, patience_s))| *since_s > patience_s).map(|(_, (fault, _))| fault)
    }
}

/// Turns of the command that nothing asks for: a loop that oscillates.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Turns {
    /// Where the command has turned last, and the farthest from there since, MPa.
    turned_mpa: f64,
    farthest_mpa: f64,
    /// Wanted pressure and the direction in which it went last, MPa.
    wanted_mpa: f64,
    direction: f64,
    since_s: f64,
    /// Turns in a row, and the time from the first of them, s.
    count: u32,
    run_s: f64,
    is_started: bool,
    is_oscillating: bool,
}

/// Smallest way between two turns beyond that through the play, MPa, and longest time, s.
const TURN_MPA: f64 = 1e-2;
const TURN_S: f64 = 0.4;
/// Turns in a row from which a loop oscillates, and the time that they take at least, s: a plan that looks for the other side of the play turns
/// as often, but for a shorter time.
const TURNS: u32 = 8;
const RUN_S: f64 = 1.5;

impl Turns {
    /// Takes a command and the pressure of the target, whose own turns and steps are none of the loop's. `play_mpa` is the whole width of the play.
    pub(crate) fn step(&mut self, command_mpa: f64, wanted_mpa: f64, play_mpa: f64, dt_s: f64) {
        if self.is_oscillating {
            return;
        }
        if !self.is_started {
            *self = Self {
                turned_mpa: command_mpa,
                farthest_mpa: command_mpa,
                wanted_mpa,
                is_started: true,
                ..Self::default()
            };
        }
        let change_mpa = wanted_mpa - self.wanted_mpa;
        if change_mpa.abs() > MOVED_MPA {
            if change_mpa * self.direction <= 0.0 {
                self.count = 0;
            }
            (self.direction, self.wanted_mpa) = (change_mpa.signum(), wanted_mpa);
        }
        self.since_s += dt_s;
        self.run_s += dt_s;
        let way_mpa = self.farthest_mpa - self.turned_mpa;
        if (command_mpa - self.farthest_mpa) * way_mpa >= 0.0 {
            self.farthest_mpa = command_mpa;
        } else if (command_mpa - self.farthest_mpa).abs() > TURN_MPA + play_mpa {
            self.count += 1;
            if self.since_s > TURN_S || self.count == 1 {
                (self.count, self.run_s) = (1, 0.0);
            }
            self.is_oscillating = self.count >= TURNS && self.run_s >= RUN_S;
            (self.turned_mpa, self.farthest_mpa, self.since_s) = (self.farthest_mpa, command_mpa, 0.0);
        }
    }

    pub(crate) fn is_oscillating(self) -> bool {
        self.is_oscillating
    }
}
