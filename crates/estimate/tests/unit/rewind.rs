use super::*;
use crate::matrix::MAX_STATES;

fn keep(kept: &mut Rewind, t_s: f64, gap_floor_mm: f64) {
    kept.keep(t_s, &[t_s; MAX_STATES], &Symmetric::diagonal(&[1.0]), gap_floor_mm);
}

#[test]
fn last_estimate_before_the_contact_is_found_until_forgotten() {
    let mut kept = Rewind::new();
    (0..1000).for_each(|k| keep(&mut kept, f64::from(k), 0.1 * f64::from(k)));
    assert_eq!((kept.0.len(), kept.0.capacity()), (KEPT, KEPT));
    let found = kept.before_contact(90.0).expect("one");
    assert!((88.0..=88.5).contains(&found.gap_floor_mm), "{found:?}");
    assert!(kept.clone().0.capacity() >= KEPT);
    assert!(kept.before_contact(20.0).is_none(), "dropped for newer ones");
    kept.forget();
    assert!(kept.before_contact(90.0).is_none(), "all are removed");
}

#[test]
fn lower_estimates_are_removed_when_the_bound_rises() {
    let mut kept = Rewind::new();
    for floor_mm in [10.0, 20.0, 30.0, 5.0, 12.0] {
        keep(&mut kept, floor_mm, floor_mm);
    }
    let found = kept.before_contact(40.0).expect("one");
    assert_eq!(found.gap_floor_mm, 12.0);
}
