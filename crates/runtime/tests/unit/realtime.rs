//! Tests of `src/realtime.rs` that need its private parts.

use super::*;

/// The kernel reads the request as one native i32; a plain file shows what was written.
#[test]
fn staying_awake_asks_for_no_latency_and_a_missing_device_is_named() {
    let device = tempfile::NamedTempFile::new().unwrap();
    let _held = stay_awake(device.path()).unwrap();
    assert_eq!(std::fs::read(device.path()).unwrap(), 0_i32.to_ne_bytes());
    let mut granted = Granted { missing: Vec::new(), _awake: None };
    let refused = granted.request(true, "stay_awake", AWAKE_REMEDY, || stay_awake("/no/such/device"));
    assert!(refused.is_none() && granted.missing.len() == 1);
    assert_eq!(granted.missing[0].setting, "stay_awake");
    assert!(granted.request(false, "cores", "", || pin(&[])).is_none() && granted.missing.len() == 1);
}

#[test]
fn a_thread_runs_on_the_cores_it_is_given_and_on_no_others() {
    let before = cores().unwrap();
    let of_another_thread = std::thread::spawn(move || {
        let one = &before[before.len() - 1..];
        pin(one).unwrap();
        assert_eq!(cores().unwrap(), one);
        assert!(pin(&[]).is_err() && pin(&[CORES]).is_err(), "no core is none");
        pin(&before).unwrap();
        assert_eq!(cores().unwrap(), before);
    });
    of_another_thread.join().unwrap();
}
