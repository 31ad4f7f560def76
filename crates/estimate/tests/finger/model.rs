//! Finger in closed form: force, tip and middle over pressure, gap and stiffness, with a contact onset.

use estimate::{
    Filter, InputRole, MAX_INPUTS, MeasuredRow, Measurement, Model, Predicted, Setup, Unknown, Update,
};

pub(crate) const PRESSURE: usize = 0;
pub(crate) const GAP: usize = 1;
pub(crate) const STIFFNESS: usize = 2;

/// Finger that sags by 27 mm, bends down with pressure over stiffness, and presses on the plate from the onset on.
pub(crate) struct Finger;

impl Finger {
    pub(crate) fn onset_mpa(gap: f64, stiffness: f64) -> f64 {
        stiffness * (gap - 27.4) / 900.0
    }
}

impl Model for Finger {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        let [pressure, gap, stiffness, ..] = *inputs;
        let zero = || Predicted::default();
        let (mut force, mut x, mut y) = (zero(), zero(), zero());
        let excess = pressure - Self::onset_mpa(gap, stiffness);
        let touches = excess > 0.0;
        let curl = pressure / stiffness;
        x.value = 115.0 - 300.0 * curl;
        x.gradient[PRESSURE] = -300.0 / stiffness;
        x.gradient[STIFFNESS] = 300.0 * curl / stiffness;
        if touches {
            let slope = 8.0 + 60.0 * curl;
            force.value = excess * slope;
            force.gradient[PRESSURE] = slope + excess * 60.0 / stiffness;
            force.gradient[GAP] = -slope * stiffness / 900.0;
            force.gradient[STIFFNESS] = -slope * (gap - 27.4) / 900.0 - excess * 60.0 * curl / stiffness;
            y.value = -1.05 * gap + 70.0 * excess;
            y.gradient[PRESSURE] = 70.0;
            y.gradient[GAP] = -1.05 - 70.0 * stiffness / 900.0;
            y.gradient[STIFFNESS] = -70.0 * (gap - 27.4) / 900.0;
        } else {
            y.value = -1.05 * (27.4 + 900.0 * curl);
            y.gradient[PRESSURE] = -945.0 / stiffness;
            y.gradient[STIFFNESS] = 945.0 * curl / stiffness;
        }
        // The middle moves by a third in x and a quarter in y, and is 57 mm nearer to the base.
        let share = |mut of: Predicted, share: f64, shift: f64| {
            of.value = share * of.value + shift;
            of.gradient.iter_mut().for_each(|by| *by *= share);
            of
        };
        let middle = [share(x, 1.0 / 3.0, 19.0), share(y, 0.25, 0.0)];
        out.copy_from_slice(&[force, x, y, middle[0], middle[1]][..out.len()]);
        touches
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        Some(27.4 + 900.0 * inputs[PRESSURE] / inputs[STIFFNESS])
    }

    fn inside_contact_mm(&self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        // With the largest permitted error.
        Some(1.4 * (27.4 + 900.0 * inputs[PRESSURE] / inputs[STIFFNESS] - inputs[GAP]))
    }
}

/// Random numbers that are the same on every machine (xorshift*), with a normal distribution by Box and Muller.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Truth {
    pub(crate) gap: f64,
    pub(crate) bias: f64,
    pub(crate) stiffness: f64,
}

pub(crate) fn setup(markers: bool) -> Setup {
    let unknown = |name: &str, prior, sigma, range| Unknown {
        name: name.into(),
        prior,
        sigma,
        drift_per_sqrt_s: 0.0,
        range,
    };
    let row = |name: &str, block, sigma| MeasuredRow {
        name: name.into(),
        block,
        sigma,
        model_sigma: 0.0,
        bias: None,
    };
    let mut rows = vec![row("force", 0, 0.005), row("tip x", 1, 0.2), row("tip y", 1, 0.2)];
    rows.truncate(if markers { 3 } else { 1 });
    Setup {
        unknowns: vec![
            unknown("gap_mm", 40.0, 15.0, [5.0, 80.0]),
            unknown("pressure_bias_mpa", 0.0, 0.002, [-0.02, 0.02]),
            unknown("stiffness_mpa", 0.8, 0.12, [0.4, 1.3]),
        ],
        inputs: vec![
            InputRole::Measured { sigma: 0.0005, bias: Some(1), rate_change: None, pasts: [None; 2] },
            InputRole::Estimated(0),
            InputRole::Estimated(2),
        ],
        rows,
        gap: Some(GAP),
        model_correlation_s: 0.0,
        alarm_hold_s: 10.0,
        swing: None,
    }
}

/// With a second marker, half way along.
pub(crate) fn setup_with_middle() -> Setup {
    let mut setup = setup(true);
    for name in ["middle x", "middle y"] {
        setup.rows.push(MeasuredRow {
            name: name.into(),
            block: 2,
            sigma: 0.2,
            model_sigma: 0.0,
            bias: None,
        });
    }
    setup
}

pub(crate) fn truth(random: &mut Random) -> Truth {
    Truth {
        gap: random.between(30.0, 50.0),
        bias: random.between(-0.002, 0.002),
        stiffness: random.between(0.7, 0.9),
    }
}

/// A slow inflation of 10 s at 200 Hz; 10 % of the marker's values missing, 1 % outliers.
pub(crate) fn readings(truth: Truth, random: &mut Random) -> Vec<Measurement> {
    let reading = |k: usize| {
        let t_s = k as f64 / 200.0;
        let pressure = 0.1 * t_s / 10.0;
        let mut predicted = [Predicted::default(); 3];
        let mut inputs = [f64::NAN; MAX_INPUTS];
        inputs[..3].copy_from_slice(&[pressure, truth.gap, truth.stiffness]);
        Finger.predict(&inputs, &mut predicted);
        let mut out = Measurement::at(t_s);
        out.inputs[PRESSURE] = pressure + truth.bias + 0.0005 * random.normal();
        for (row, sigma) in [0.005, 0.2, 0.2].into_iter().enumerate() {
            out.rows[row] = predicted[row].value + sigma * random.normal();
        }
        if random.uniform() < 0.1 {
            out.rows[1..3].fill(f64::NAN);
        }
        if random.uniform() < 0.01 {
            out.rows[2] += 30.0;
        }
        out
    };
    (0..2000).map(reading).collect()
}

pub(crate) fn run(setup: Setup, readings: &[Measurement]) -> (Filter, Vec<Update>) {
    let mut filter = Filter::new(setup).expect("a valid setup");
    let updates = readings.iter().map(|reading| filter.update(reading, &mut Finger)).collect();
    (filter, updates)
}
