//! The branches of a balloon under pressure against its closed form: a thin sphere of Mooney-Rivlin rubber, of unit radius.

use rom::branch::{BranchSample, BranchState, Follower};
use rom::inputs::Inputs;
use std::f64::consts::PI;

const INPUT: usize = 2;
const MAXIMUM: f64 = 1.6;
const MINIMUM: f64 = 4.0;

/// Pressure and its derivative with respect to the stretch; `alpha` is the ratio of the two moduli.
fn pressure_mpa(alpha: f64, stretch: f64) -> [f64; 2] {
    let [a, b] = [1.0 / stretch - stretch.powi(-7), 1.0 + alpha * stretch * stretch];
    let slope = (7.0 * stretch.powi(-8) - stretch.powi(-2)) * b + a * 2.0 * alpha * stretch;
    [0.1 * a * b, 0.1 * slope]
}

fn volume_mm3(stretch: f64) -> f64 {
    4.0 / 3.0 * PI * (stretch.powi(3) - 1.0)
}

fn balloon(alpha: f64, to: f64) -> Follower {
    let sample = |k: u32| {
        let volume_mm3 = volume_mm3(to) * f64::from(k) / 8192.0;
        let stretch = (1.0 + 0.75 * volume_mm3 / PI).cbrt();
        let [pressure_mpa, slope] = pressure_mpa(alpha, stretch);
        BranchSample { volume_mm3, pressure_mpa, slope: slope / (4.0 * PI * stretch * stretch) }
    };
    Follower::new(INPUT, &(0..=8192).map(sample).collect::<Vec<_>>()).expect("a branch")
}

/// Stretch at which `holds` ends, between two.
fn end(mut from: f64, mut to: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..80 {
        let middle = 0.5 * (from + to);
        if holds(middle) { from = middle } else { to = middle }
    }
    from
}

fn follow(follower: &mut Follower, t_s: f64, pressure_mpa: f64) -> BranchState {
    let mut inputs = Inputs::new(pressure_mpa, f64::INFINITY);
    let found = follower.advance((t_s * 1e9) as u64, &mut inputs);
    assert_eq!(inputs.values()[INPUT], found.volume_mm3);
    found
}

#[test]
fn loading_and_unloading_between_the_limits_have_the_volumes_of_two_branches() {
    const ALPHA: f64 = 0.1;
    let rises = |stretch: f64| pressure_mpa(ALPHA, stretch)[1] > 0.0;
    let (top, bottom) = (end(1.0, MAXIMUM, rises), end(MAXIMUM, MINIMUM, |s| !rises(s)));
    let [highest, lowest] = [top, bottom].map(|stretch| pressure_mpa(ALPHA, stretch)[0]);
    assert!(top < 1.6 && bottom < 3.5 && lowest < highest, "{top} {bottom}");
    let volume =
        |mpa: f64, range: [f64; 2]| volume_mm3(end(range[0], range[1], |s| pressure_mpa(ALPHA, s)[0] < mpa));
    let mut follower = balloon(ALPHA, 7.0);
    let steps = 400;
    let up = (0..=steps).map(|k| f64::from(k) / f64::from(steps));
    let (from, to) = (0.5 * lowest, 1.1 * highest);
    let (mut jumps, mut branch) = (Vec::new(), 0);
    for (k, fraction) in up.clone().chain(up.rev().skip(1)).enumerate() {
        let mpa = from + fraction * (to - from);
        let found = follow(&mut follower, 0.01 * k as f64, mpa);
        let is_loading = k <= steps as usize;
        let expected = if is_loading { usize::from(mpa > highest) } else { usize::from(mpa >= lowest) };
        if (mpa - highest).abs() > 1e-5 && (mpa - lowest).abs() > 1e-5 {
            assert_eq!(
                (found.branch, found.is_behind, found.is_unknown),
                (expected, false, false),
                "{k} {mpa}"
            );
            let exact = volume(mpa, [[1.0, top], [bottom, 7.0]][expected]);
            // The inverse is singular at a limit.
            assert!(
                (found.volume_mm3 - exact).abs() < 2e-3 * volume_mm3(top),
                "{mpa}: {} {exact}",
                found.volume_mm3
            );
        }
        if found.branch != branch {
            jumps.push(mpa);
            branch = found.branch;
        }
    }
    let step = (to - from) / f64::from(steps);
    assert!(
        jumps.len() == 2 && (jumps[0] - highest).abs() < step && (jumps[1] - lowest).abs() < step,
        "{jumps:?}"
    );
}

#[test]
fn start_between_the_limits_is_marked_until_a_limit_is_passed() {
    let mut follower = balloon(0.1, 7.0);
    let between = 0.5 * (pressure_mpa(0.1, 1.5)[0] + pressure_mpa(0.1, 2.5)[0]);
    let started = follow(&mut follower, 0.0, between);
    assert_eq!((started.branch, started.is_unknown), (0, true));
    let fallen = follow(&mut follower, 0.1, 0.01);
    assert_eq!((fallen.branch, fallen.is_unknown), (0, false));
    assert!(!follow(&mut follower, 0.2, between).is_unknown);
    // Over a gap of two seconds the pressure may have been anywhere; in a recording it may not.
    let mut recorded = follower.clone();
    recorded.hold_never();
    assert!(
        follow(&mut follower, 2.3, between).is_unknown && !follow(&mut recorded, 2.3, between).is_unknown
    );
    let risen = follow(&mut follower, 2.4, 1.2 * pressure_mpa(0.1, 1.5)[0]);
    assert_eq!((risen.branch, risen.is_unknown), (1, false));
}

#[test]
fn pressure_above_the_last_limit_is_outside_until_the_actuator_is_at_rest() {
    let mut follower = balloon(0.0, 3.0);
    let highest = pressure_mpa(0.0, 7.0_f64.powf(1.0 / 6.0))[0];
    assert!(!follow(&mut follower, 0.0, 0.999 * highest).is_behind);
    let behind = follow(&mut follower, 0.1, 1.001 * highest);
    let limit = volume_mm3(7.0_f64.powf(1.0 / 6.0));
    assert!(behind.is_behind && (behind.volume_mm3 / limit - 1.0).abs() < 1e-5, "{behind:?}");
    assert!(follow(&mut follower, 0.2, 0.5 * highest).is_behind);
    let back = follow(&mut follower, 0.3, 0.0);
    assert!(!back.is_behind && back.volume_mm3.abs() < 1e-9, "{back:?}");
    follower.restart();
    assert!(!follow(&mut follower, 0.1, 0.5 * highest).is_behind);
}

#[test]
fn fold_of_the_interpolation_is_no_limit() {
    let flat = |k: u32| {
        let volume_mm3 = f64::from(k);
        let [wave, by] = [3e-4 * volume_mm3.sin(), 3e-4 * volume_mm3.cos()];
        BranchSample { volume_mm3, pressure_mpa: 1e-4 * volume_mm3 + wave, slope: 1e-4 + by }
    };
    let mut follower = Follower::new(INPUT, &(0..=10_000).map(flat).collect::<Vec<_>>()).expect("a branch");
    for k in 0..=100 {
        let found = follow(&mut follower, 0.01 * f64::from(k), 0.01 * f64::from(k));
        assert_eq!((found.branch, found.is_behind, found.is_unknown), (0, false, false));
        assert!((found.volume_mm3 - 100.0 * f64::from(k)).abs() < 10.0, "{found:?}");
    }
    assert!(Follower::new(INPUT, &[]).is_none() && Follower::new(0, &[flat(0), flat(1)]).is_none());
}
