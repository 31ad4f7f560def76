//! Counters and latencies in Prometheus' text format.

use crate::bridge::BridgeCounters;
use crate::source::live::SensorCounters;
use std::fmt::Write;
use std::sync::atomic::Ordering;
use wire::layout::{flags, unpack_name};
use wire::{Health, Outcome};

/// The value of one twin's health.
type Read = fn(&Health) -> f64;

const SECOND: f64 = 1e-9;

/// Name, kind, help, value.
const TWIN: [(&str, &str, &str, Read); 12] = [
    ("softtwin_readings_total", "counter", "Readings taken from the sensor topic.", |h| h.received as f64),
    ("softtwin_missed_total", "counter", "Readings that never arrived.", |h| h.missed as f64),
    ("softtwin_sensor_restarts_total", "counter", "Restarts of the bridge seen.", |h| {
        h.sensor_restarts as f64
    }),
    ("softtwin_deadline_misses_total", "counter", "Times without a good reading within the deadline.", |h| {
        h.deadline_misses as f64
    }),
    ("softtwin_fields_total", "counter", "Fields sent over all node sets.", |h| h.fields_sent as f64),
    ("softtwin_states_total", "counter", "States sent.", |h| h.states_sent as f64),
    ("softtwin_late_total", "counter", "Readings sent later than the configured limit.", |h| h.late as f64),
    ("softtwin_uptime_seconds", "gauge", "Time since the twin started.", |h| h.uptime_ns as f64 * SECOND),
    ("softtwin_age_seconds", "gauge", "Age of the newest good reading.", |h| h.age_ns as f64 * SECOND),
    ("softtwin_rate_hertz", "gauge", "Readings a second over the last interval.", |h| h.rate_hz),
    ("softtwin_latency_max_seconds", "gauge", "Sensor stamp to sent, slowest of the last interval.", |h| {
        h.latency_max_ns as f64 * SECOND
    }),
    ("softtwin_compute_max_seconds", "gauge", "Reading taken to sent, slowest of the last interval.", |h| {
        h.compute_max_ns as f64 * SECOND
    }),
];

/// The page of a twin process: one sample for each actuator.
pub fn twins(healths: &[Health]) -> String {
    let mut page = String::new();
    for (name, kind, help, read) in TWIN {
        head(&mut page, name, kind, help);
        for health in healths {
            sample(&mut page, name, &[("actuator", &unpack_name(&health.actuator))], read(health));
        }
    }
    head(&mut page, "softtwin_outcomes_total", "counter", "Readings by what became of them.");
    for health in healths {
        for outcome in Outcome::ALL {
            let labels =
                [("actuator", unpack_name(&health.actuator)), ("outcome", outcome.as_str().to_owned())];
            let labels = labels.each_ref().map(|(key, value)| (*key, value.as_str()));
            sample(&mut page, "softtwin_outcomes_total", &labels, health.count(*outcome) as f64);
        }
    }
    head(&mut page, "softtwin_latency_seconds", "gauge", "Sensor stamp to sent over the last interval.");
    for health in healths {
        let actuator = unpack_name(&health.actuator);
        for (quantile, ns) in [("0.5", health.latency_p50_ns), ("0.99", health.latency_p99_ns)] {
            let labels = [("actuator", actuator.as_str()), ("quantile", quantile)];
            sample(&mut page, "softtwin_latency_seconds", &labels, ns as f64 * SECOND);
        }
    }
    head(&mut page, "softtwin_flag", "gauge", "1 while the flag is set.");
    for health in healths {
        let actuator = unpack_name(&health.actuator);
        for (bit, flag) in flags::NAMES {
            let value = f64::from(u8::from(health.flags & bit != 0));
            sample(&mut page, "softtwin_flag", &[("actuator", &actuator), ("flag", flag)], value);
        }
    }
    page
}

/// The page of a bridge process; sensors with the name of their actuator.
pub fn bridge(counters: &BridgeCounters, sensors: &[(String, &SensorCounters)]) -> String {
    let mut page = String::new();
    for (name, help, counter) in [
        ("softtwin_bridge_sent_total", "Readings sent.", &counters.sent),
        ("softtwin_bridge_failed_total", "Readings that could not be sent.", &counters.failed),
        ("softtwin_bridge_late_total", "Readings sent late.", &counters.late),
    ] {
        head(&mut page, name, "counter", help);
        sample(&mut page, name, &[], counter.load(Ordering::Relaxed) as f64);
    }
    head(&mut page, "softtwin_sensor_events_total", "counter", "What became of the sensors' answers.");
    for (actuator, counters) in sensors {
        for (event, count) in counters.all() {
            let labels = [("actuator", actuator.as_str()), ("event", event)];
            sample(&mut page, "softtwin_sensor_events_total", &labels, count as f64);
        }
    }
    page
}

// Writing into a string cannot fail.
fn head(page: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(page, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

fn sample(page: &mut String, name: &str, labels: &[(&str, &str)], value: f64) {
    let labels: Vec<String> =
        labels.iter().map(|(key, value)| format!("{key}=\"{}\"", escape(value))).collect();
    let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
    let value = match value {
        value if value.is_nan() => "NaN".to_owned(),
        value if value.is_infinite() => if value > 0.0 { "+Inf" } else { "-Inf" }.to_owned(),
        value => value.to_string(),
    };
    let _ = writeln!(page, "{name}{labels} {value}");
}

fn escape(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::layout::pack_name;

    #[test]
    fn a_page_has_every_counter_of_every_twin_in_the_format() {
        let mut health =
            Health { actuator: pack_name("finger"), received: 7, age_ns: 1_500_000_000, ..Health::default() };
        health.outcomes[Outcome::HeldAbsurd.code() as usize] = 3;
        let page = twins(&[health, Health { actuator: pack_name("thumb"), ..health }]);
        for line in [
            "# TYPE softtwin_readings_total counter",
            "softtwin_readings_total{actuator=\"finger\"} 7",
            "softtwin_readings_total{actuator=\"thumb\"} 7",
            "softtwin_age_seconds{actuator=\"finger\"} 1.5",
            "softtwin_outcomes_total{actuator=\"finger\",outcome=\"held: absurd value\"} 3",
            "softtwin_flag{actuator=\"finger\",flag=\"no-data\"} 1",
        ] {
            assert!(page.lines().any(|found| found == line), "{line}\n{page}");
        }
        for line in page.lines().filter(|line| !line.starts_with('#')) {
            let (_, value) = line.rsplit_once(' ').unwrap();
            assert!(value.parse::<f64>().is_ok(), "{line}");
        }
    }

    #[test]
    fn labels_are_escaped_and_odd_numbers_have_their_spelling() {
        let mut page = String::new();
        sample(&mut page, "x", &[("a", "q\"\\\n")], f64::INFINITY);
        assert_eq!(page, "x{a=\"q\\\"\\\\\\n\"} +Inf\n");
        let counters = SensorCounters::default();
        counters.timeouts.store(2, Ordering::Relaxed);
        let page = bridge(&BridgeCounters::default(), &[("finger".into(), &counters)]);
        assert!(
            page.contains("softtwin_sensor_events_total{actuator=\"finger\",event=\"timeouts\"} 2\n"),
            "{page}"
        );
        assert!(page.contains("\nsofttwin_bridge_sent_total 0\n"), "{page}");
    }
}
