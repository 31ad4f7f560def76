//! Tests of `src/metrics.rs` that need its private parts.

use super::*;
use crate::source::SensorCounters;
use wire::layout::pack_name;

#[test]
fn a_page_has_every_counter_of_every_twin_in_the_format() {
    let mut health =
        Health { actuator: pack_name("finger"), received: 7, age_ns: 1_500_000_000, ..Health::default() };
    health.outcomes[Outcome::HeldAbsurd.code() as usize] = 3;
    let mut estimate =
        Estimate { actuator: pack_name("finger"), unknown_count: 1, identifiable: 1, ..Estimate::default() };
    estimate.set_name(0, "gap_mm");
    (estimate.values[0], estimate.sigmas[0], estimate.alarm) = (41.5, 0.25, estimate_alarm::SENSOR);
    let page = twins(&[health, Health { actuator: pack_name("thumb"), ..health }], &[estimate]);
    for line in [
        "# TYPE softtwin_readings counter",
        "softtwin_readings_total{actuator=\"finger\"} 7",
        "softtwin_readings_total{actuator=\"thumb\"} 7",
        "softtwin_age_seconds{actuator=\"finger\"} 1.5",
        "softtwin_outcomes_total{actuator=\"finger\",outcome=\"held: absurd value\"} 3",
        "softtwin_flag{actuator=\"finger\",flag=\"no-data\"} 1.0",
        "softtwin_estimate{actuator=\"finger\",quantity=\"gap_mm\"} 41.5",
        "softtwin_estimate_sigma{actuator=\"finger\",quantity=\"gap_mm\"} 0.25",
        "softtwin_estimate_identifiable{actuator=\"finger\",quantity=\"gap_mm\"} 1.0",
        "softtwin_estimate_alarm{actuator=\"finger\",alarm=\"sensor\"} 1.0",
    ] {
        assert!(page.lines().any(|found| found == line), "{line}\n{page}");
    }
    for line in page.lines().filter(|line| !line.starts_with('#')) {
        let (_, value) = line.rsplit_once(' ').unwrap();
        assert!(value.parse::<f64>().is_ok(), "{line}");
    }
    // No metric of the pages before this format is missing.
    for name in ["missed_total", "sensor_restarts_total", "deadline_misses_total", "fields_total"]
        .into_iter()
        .chain(["states_total", "late_total", "uptime_seconds", "rate_hertz", "latency_max_seconds"])
        .chain(["compute_max_seconds"])
    {
        assert!(page.contains(&format!("\nsofttwin_{name}{{actuator=\"finger\"}} ")), "{name}\n{page}");
    }
    let quantile = "softtwin_latency_seconds{actuator=\"thumb\",quantile=\"0.99\"} ";
    assert!(page.contains(quantile), "{page}");
}

#[test]
fn labels_are_escaped_and_a_bridge_has_its_devices() {
    let device = Arc::new(SensorCounters::default());
    device.timeouts.store(2, Ordering::Relaxed);
    let devices =
        vec![("q\"\\\n".into(), String::new(), device.clone()), ("finger".into(), "gauge".into(), device)];
    let page = bridge(&BridgeCounters::default(), &devices, &[]);
    let named = "softtwin_sensor_events_total{actuator=\"finger\",sensor=\"gauge\",event=\"timeouts\"} 2\n";
    assert!(page.contains(named), "{page}");
    let event = "softtwin_sensor_events_total{actuator=\"q\\\"\\\\\\n\",event=\"timeouts\"} 2\n";
    assert!(page.contains(event), "{page}");
    assert!(page.contains("\nsofttwin_bridge_sent_total 0\n"), "{page}");
}
