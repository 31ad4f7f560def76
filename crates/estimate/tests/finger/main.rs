//! Filter, fit, alarms and plan on a finger in closed form.

mod cost;
mod faults;
mod memory;
mod model;
mod plan;
mod swing;

use estimate::{Filter, InputRole, Measurement, Status, fit};
use model::{Finger, PRESSURE, Random, STIFFNESS, Truth, readings, run, setup, setup_with_middle, truth};

#[test]
fn gap_bias_and_stiffness_are_found_with_force_and_tip() {
    // One inflation does not distinguish a bias of the gauge from play.
    let identifiable = [true, false, true];
    let mut random = Random(42);
    let (mut covered, mut consistent, mut counted) = (0, 0, 0);
    for _ in 0..20 {
        let truth = truth(&mut random);
        let readings = readings(truth, &mut random);
        let (filter, updates) = run(setup(true), &readings);
        let estimates: Vec<_> = filter.estimates().collect();
        assert_eq!(
            estimates.iter().map(|e| e.identifiable).collect::<Vec<_>>(),
            identifiable,
            "{estimates:?}"
        );
        for (estimate, truth) in estimates.iter().zip([truth.gap, truth.bias, truth.stiffness]) {
            let off = (estimate.value - truth).abs() / estimate.sigma;
            assert!(off < 4.5, "{off} standard deviations: {truth} {estimate:?}");
            covered += u32::from(off < 1.645);
        }
        assert!((estimates[0].value - truth.gap).abs() < 0.25, "{truth:?} {estimates:?}");
        for update in updates.iter().filter(|update| update.status == Status::Used) {
            counted += 1;
            consistent += usize::from(update.nis >= update.nis_band[0] && update.nis <= update.nis_band[1]);
        }
    }
    assert!(covered >= 46, "90 % bands cover {covered} of 60");
    let share = consistent as f64 / counted as f64;
    assert!((0.92..0.98).contains(&share), "NIS is inside its 95 % band for {share}");
}

#[test]
fn gap_and_bias_are_unidentifiable_from_force_alone() {
    let mut random = Random(7);
    for _ in 0..20 {
        let truth = truth(&mut random);
        let mut setup = setup(false);
        setup.rows[0].model_sigma = 0.005; // a model with an error of 5 mN over the whole recording
        setup.model_correlation_s = 10.0;
        // Gap and bias alone: the stiffness is given.
        setup.unknowns.truncate(2);
        setup.inputs[STIFFNESS] = InputRole::Given(truth.stiffness);
        let (filter, _) = run(setup, &readings(truth, &mut random));
        let estimates: Vec<_> = filter.estimates().collect();
        for (estimate, truth) in estimates.iter().zip([truth.gap, truth.bias]) {
            assert!(!estimate.identifiable, "{truth:?}: {estimates:?}");
            assert!(
                (estimate.value - truth).abs() < 3.0 * estimate.sigma,
                "confident and wrong: {truth} {estimate:?}"
            );
        }
        assert!(estimates[1].sigma > 0.8 * 0.002, "the bias stays at its prior: {estimates:?}");
    }
}

/// With the marker alone a contact is detected some tenths of a second late. Estimates made meanwhile without contact are discarded;
/// otherwise the stiffness has an error of several standard deviations even without sensor noise.
#[test]
fn contact_detected_late_leaves_the_stiffness_unbiased() {
    let mut random = Random(23);
    for _ in 0..10 {
        let truth = truth(&mut random);
        let mut setup = setup(true);
        for row in &mut setup.rows {
            row.model_sigma = 0.03;
        }
        setup.model_correlation_s = 10.0;
        let mut readings = readings(truth, &mut random);
        readings.iter_mut().for_each(|reading| reading.rows[0] = f64::NAN);
        let (filter, updates) = run(setup, &readings);
        let onset = (Finger::onset_mpa(truth.gap, truth.stiffness) / 0.1 * 2000.0) as usize;
        let noticed = updates.iter().position(|update| update.in_contact).expect("a contact");
        assert!(noticed > onset + 10, "noticed at reading {noticed}, onset at {onset}: nothing to take back");
        for (estimate, truth) in filter.estimates().zip([truth.gap, truth.bias, truth.stiffness]) {
            let off = (estimate.value - truth).abs() / estimate.sigma;
            assert!(off < 2.5, "{off} standard deviations: {truth} {estimate:?}");
        }
    }
}

/// At the ends of inflations the noise of a steadily changing pressure is halved, and the unknowns are bit-identical.
#[test]
fn steadily_changing_pressure_has_half_the_noise() {
    let mut random = Random(17);
    let (mut alone, mut steady) = (0.0, 0.0);
    for _ in 0..20 {
        let truth = truth(&mut random);
        let readings = readings(truth, &mut random);
        let mut with = setup(true);
        with.inputs[PRESSURE] =
            InputRole::Measured { sigma: 0.0005, bias: Some(1), rate_change: Some(0.005), pasts: [None; 2] };
        let (of_each, by_each) = run(setup(true), &readings);
        let (of_all, by_all) = run(with, &readings);
        for (a, b) in of_each.estimates().zip(of_all.estimates()) {
            assert_eq!((a.value.to_bits(), a.sigma.to_bits()), (b.value.to_bits(), b.sigma.to_bits()));
        }
        let bias = of_each.estimates().nth(1).expect("bias").value;
        let true_mpa = 0.1 * readings.last().expect("readings").t_s / 10.0 + truth.bias - bias;
        let square =
            |updates: &[estimate::Update]| (updates[updates.len() - 1].inputs[PRESSURE] - true_mpa).powi(2);
        let one = readings.last().expect("readings").inputs[PRESSURE] - bias;
        alone += (one - true_mpa).powi(2);
        steady += square(&by_all);
        assert!(square(&by_each).is_finite());
        let mut by_pressure = [0.0; estimate::MAX_INPUTS];
        by_pressure[PRESSURE] = 1.0;
        assert!(of_all.sigma_of(&by_pressure) < of_each.sigma_of(&by_pressure));
    }
    assert!(steady < 0.3 * alone, "{} of {} kPa2", steady * 1e6 / 20.0, alone * 1e6 / 20.0);
}

#[test]
fn readings_without_contact_exclude_only_smaller_gaps() {
    let mut random = Random(3);
    let truth = Truth { gap: 60.0, bias: 0.0, stiffness: 0.8 };
    let readings = readings(truth, &mut random);
    let onset = (Finger::onset_mpa(60.0, 0.8) / 0.1 * 2000.0) as usize;
    let (filter, updates) = run(setup(true), &readings[..onset - 100]);
    let gap = filter.estimates().next().expect("gap");
    let early = updates.iter().position(|update| update.in_contact);
    assert_eq!(
        early,
        None,
        "contact before the onset at {onset}: {:?}",
        early.map(|at| (updates[at], readings[at].rows))
    );
    assert!(gap.value > 55.0 && gap.sigma > 3.0 && !gap.identifiable, "{gap:?}");
    let (filter, _) = run(setup(true), &readings[..onset + 200]);
    let gap = filter.estimates().next().expect("gap");
    assert!((gap.value - 60.0).abs() < 0.5 && gap.identifiable, "{gap:?}");
}

/// A camera without a picture sends 0, which must not begin a contact.
#[test]
fn wild_first_markers_begin_no_contact() {
    for wild in [1, 2, 10] {
        let mut random = Random(3);
        let truth = Truth { gap: 60.0, bias: 0.001, stiffness: 0.8 };
        let mut readings = readings(truth, &mut random);
        readings[..wild].iter_mut().for_each(|reading| reading.rows[1..3].fill(0.0));
        let onset = (Finger::onset_mpa(60.0, 0.8) / 0.1 * 2000.0) as usize;
        let (filter, updates) = run(setup(true), &readings[..onset - 100]);
        let gap = filter.estimates().next().expect("gap");
        assert!(!updates.iter().any(|update| update.in_contact), "{wild}: {gap:?}");
        assert!(gap.value > 55.0 && !gap.identifiable, "{wild}: {gap:?}");
    }
}

#[test]
fn outliers_are_rejected_and_counted() {
    let mut random = Random(11);
    let truth = Truth { gap: 38.0, bias: 0.001, stiffness: 0.85 };
    let mut readings = readings(truth, &mut random);
    readings.iter_mut().for_each(|reading| reading.rows[2] = f64::NAN);
    let (clean, _) = run(setup(true), &readings);
    let mut with = readings.clone();
    for reading in with.iter_mut().skip(1500).step_by(10) {
        reading.rows[1] = 60.0;
    }
    let (filter, updates) = run(setup(true), &with);
    let rejected = updates[1500..].iter().step_by(10).filter(|update| update.rejected == 0b10).count();
    assert_eq!(rejected, 50, "rejected at the readings that were changed");
    for (a, b) in clean.estimates().zip(filter.estimates()) {
        assert!((a.value - b.value).abs() < b.sigma, "{a:?} {b:?}");
    }
}

#[test]
fn bad_readings_are_ignored_with_a_status() {
    let mut filter = Filter::new(setup(true)).expect("a valid setup");
    let mut reading = Measurement::at(1.0);
    assert_eq!(filter.update(&reading, &mut Finger).status, Status::InputMissing);
    reading.inputs[PRESSURE] = 0.01;
    assert_eq!(
        filter.update(&reading, &mut Finger).status,
        Status::Used,
        "no measured value: only time passes"
    );
    assert_eq!(filter.update(&reading, &mut Finger).status, Status::NotLater);
    let before: Vec<_> = filter.estimates().collect();
    reading.t_s = 2.0;
    reading.inputs[PRESSURE] = f64::NAN;
    assert_eq!(filter.update(&reading, &mut Finger).status, Status::InputMissing);
    assert_eq!(before, filter.estimates().collect::<Vec<_>>());
}

/// Also if a contact began in it, for which earlier estimates were restored.
#[test]
fn unused_reading_changes_no_estimate() {
    let mut random = Random(29);
    let (mut unused, mut begun) = (0, 0);
    for _ in 0..30 {
        let truth = truth(&mut random);
        let mut filter = Filter::new(setup_with_middle()).expect("a valid setup");
        for mut reading in readings(truth, &mut random).into_iter().step_by(4) {
            // Markers with arbitrary values.
            if random.uniform() < 0.7 {
                reading.rows[0] = f64::NAN;
                reading.rows[1..5].fill_with(|| random.between(-80.0, 120.0));
            }
            let before: Vec<_> = filter.estimates().collect();
            let update = filter.update(&reading, &mut Finger);
            begun += usize::from(update.in_contact);
            if update.status != Status::Used {
                unused += 1;
                assert_eq!(before, filter.estimates().collect::<Vec<_>>(), "{truth:?} {update:?}");
            }
        }
    }
    assert!(unused > 100 && begun > 100, "{unused} readings not used, {begun} in contact");
}

#[test]
fn setup_check_returns_all_errors() {
    let mut wrong = setup(true);
    wrong.unknowns[0].sigma = 0.0;
    wrong.unknowns[1].prior = 1.0;
    wrong.inputs[1] = InputRole::Estimated(9);
    wrong.rows[1].block = 3;
    let errors = Filter::new(wrong).expect_err("wrong");
    assert_eq!((errors.len(), errors[0].place.as_str()), (5, "gap_mm: sigma"), "{errors:#?}");
}

#[test]
fn fit_is_robust_against_outliers() {
    let mut random = Random(5);
    let mut covered = 0;
    for _ in 0..10 {
        let truth = truth(&mut random);
        let readings: Vec<_> = readings(truth, &mut random).into_iter().step_by(4).collect();
        let fit = fit(&setup(true), &readings, &mut Finger).expect("a valid setup");
        assert!(fit.converged && fit.skipped == 0, "{truth:?}: {fit:?}");
        assert!((0.87..1.13).contains(&fit.chi2_per_dof), "{truth:?}: {}", fit.chi2_per_dof);
        assert!(fit.outliers >= 1 && fit.outliers < 60, "{}", fit.outliers);
        for (estimate, truth) in fit.estimates.iter().zip([truth.gap, truth.bias, truth.stiffness]) {
            let off = (estimate.value - truth).abs() / estimate.sigma;
            assert!(off < 4.5, "{off}: {truth} {estimate:?}");
            covered += u32::from(off < 1.645);
        }
    }
    assert!(covered >= 22, "90 % bands cover {covered} of 30");
}

#[test]
fn gap_is_unidentifiable_without_contact() {
    let mut random = Random(6);
    let truth = Truth { gap: 70.0, bias: 0.001, stiffness: 0.8 };
    let readings: Vec<_> = readings(truth, &mut random).into_iter().take(600).collect();
    let fit = fit(&setup(true), &readings, &mut Finger).expect("a valid setup");
    assert!(fit.converged && !fit.estimates[0].identifiable, "{fit:?}");
    assert!(fit.estimates[0].sigma > 5.0, "{fit:?}");
}
