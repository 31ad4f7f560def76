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
    let text = granted.missing[0].to_string();
    assert!(text.starts_with("realtime.stay_awake: refused: ") && text.contains("udev"), "{text}");
    assert!(granted.request(false, "cores", "", || pin(&[])).is_none() && granted.missing.len() == 1);
}
