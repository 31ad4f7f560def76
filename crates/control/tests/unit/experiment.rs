use super::*;

#[test]
fn setpoints_stay_within_range_and_rate() {
    let experiment = Experiment::new([0.01, 0.05], 0.3, 0.2);
    let at: Vec<f64> =
        (0..=(1e3 * experiment.end_s()) as usize).map(|ms| experiment.at(1e-3 * ms as f64)).collect();
    assert!(at.iter().all(|pressure_mpa| (0.01 - 1e-12..=0.05 + 1e-12).contains(pressure_mpa)));
    assert!(at.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 0.2e-3 + 1e-12));
    assert_eq!((at[0], *at.last().unwrap()), (0.01, 0.01));
    assert_eq!(experiment.at(-5.0), 0.01);
}

/// Drives with cycles of 5 ms that are late at some times of the drive; what was read, by time and setpoint.
fn driven(experiment: &Experiment, late_s: &[f64]) -> Option<Vec<[f64; 2]>> {
    let (mut progress, mut rows, mut late) =
        (Progress::begin(), Vec::<[f64; 2]>::new(), late_s.iter().peekable());
    for cycle in 0..200_000 {
        let elapsed_s = f64::from(cycle) * 5e-3;
        if late.peek().is_some_and(|at_s| **at_s <= elapsed_s) {
            late.next();
            let from_s = progress.repeat(experiment, elapsed_s)?;
            rows.retain(|row| row[0] < from_s);
        }
        let time_s = progress.time_s(elapsed_s);
        if time_s >= experiment.end_s() {
            break;
        }
        if progress.counts(time_s) {
            rows.push([time_s, experiment.at(time_s)]);
        }
    }
    Some(rows)
}

/// The record of a disturbed drive is that of one without disturbance: no time twice, none left out.
#[test]
fn a_late_cycle_repeats_its_part_and_leaves_no_trace() {
    let experiment = Experiment::new([0.01, 0.05], 0.3, 0.2);
    let calm = driven(&experiment, &[]).unwrap();
    for late_s in [&[0.0][..], &[2.0], &[11.0], &[11.0, 12.0], &[50.0], &[3.0, 30.0, 60.0, 90.0, 120.0]] {
        let found = driven(&experiment, late_s).unwrap();
        assert!(found.len().abs_diff(calm.len()) < 8, "{late_s:?}: {} {}", found.len(), calm.len());
        assert!(found.windows(2).all(|pair| (0.0..0.011).contains(&(pair[1][0] - pair[0][0]))), "{late_s:?}");
        let step = |rows: &[[f64; 2]]| rows.iter().map(|row| row[1]).sum::<f64>();
        assert!((step(&found) / step(&calm) - 1.0).abs() < 1e-3, "{late_s:?}");
    }
    assert!(driven(&experiment, &[1.0; MOST_REPEATS as usize + 1]).is_none());
}

/// Before a part counts again, the part before it has been driven from its rest on.
#[test]
fn the_part_before_is_driven_again_first() {
    let experiment = Experiment::new([0.01, 0.05], 0.3, 0.2);
    let mut progress = Progress::begin();
    // In the hold of the third step.
    let elapsed_s = experiment.holds_s[2][0] + 1.0;
    let from_s = progress.repeat(&experiment, elapsed_s).unwrap();
    assert_eq!(from_s, experiment.holds_s[1][1]);
    let again_s = progress.time_s(elapsed_s);
    assert!(again_s <= experiment.holds_s[0][1] - 3.9 && !progress.counts(again_s));
    assert!((experiment.at(again_s) - experiment.at(experiment.holds_s[0][0])).abs() < 1e-12);
}
