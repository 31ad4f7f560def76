//! Counters and latencies for Prometheus (OpenMetrics text).

use crate::bridge::BridgeCounters;
use crate::http;
use crate::source::SensorCounters;
use axum::http::{Method, Request, StatusCode, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::service::service_fn;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::text::encode;
use prometheus_client::encoding::{DescriptorEncoder, EncodeLabelSet, NoLabelSet};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Registry;
use std::cell::RefCell;
use std::convert::Infallible;
use std::fmt::Error;
use std::net::TcpListener;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::layout::{Code, flags, unpack_name};
use wire::{Health, Outcome};

/// How often the end of the process is checked for.
const STOP_CHECK: Duration = Duration::from_millis(50);
/// Of the pages.
const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

const SECOND: f64 = 1e-9;

/// Name (on the page with `_total` behind it), help, value.
const COUNTERS: [(&str, &str, fn(&Health) -> u64); 8] = [
    ("softtwin_readings", "Readings taken from the sensor topic", |h| h.received),
    ("softtwin_missed", "Readings that never arrived", |h| h.missed),
    ("softtwin_sensor_restarts", "Restarts of the bridge seen", |h| h.sensor_restarts),
    ("softtwin_deadline_misses", "Times without a good reading within the deadline", |h| h.deadline_misses),
    ("softtwin_fields", "Fields sent over all node sets", |h| h.fields_sent),
    ("softtwin_states", "States sent", |h| h.states_sent),
    ("softtwin_late", "Readings sent later than the configured limit", |h| h.late),
    ("softtwin_log_lost", "Events and lines that are missing in the log", |h| h.log_lost),
];

const GAUGES: [(&str, &str, fn(&Health) -> f64); 5] = [
    ("softtwin_uptime_seconds", "Time since the twin started", |h| h.uptime_ns as f64 * SECOND),
    ("softtwin_age_seconds", "Age of the newest good reading", |h| h.age_ns as f64 * SECOND),
    ("softtwin_rate_hertz", "Readings a second over the last interval", |h| h.rate_hz),
    ("softtwin_latency_max_seconds", "Sensor stamp to sent, slowest of the last interval", |h| {
        h.latency_max_ns as f64 * SECOND
    }),
    ("softtwin_compute_max_seconds", "Reading taken to sent, slowest of the last interval", |h| {
        h.compute_max_ns as f64 * SECOND
    }),
];

/// The page of a twin process: one sample for each actuator.
pub fn twins(healths: Vec<Health>) -> String {
    page(Twins(healths))
}

/// The page of a bridge process; devices with the name of their actuator.
pub fn bridge(counters: &Arc<BridgeCounters>, devices: &[(String, Arc<SensorCounters>)]) -> String {
    page(BridgePage { counters: counters.clone(), devices: devices.to_vec() })
}

fn page(collector: impl Collector) -> String {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(collector));
    let mut text = String::new();
    match encode(&mut text, &registry) {
        Ok(()) => text,
        Err(error) => format!("# the page could not be written: {error}\n"),
    }
}

/// Answers requests for the page until `done`. `page` makes the text anew for each; a foreign name in `Host` is refused.
///
/// # Errors
/// The system refuses what the server needs.
pub fn serve(
    listener: TcpListener,
    done: &AtomicBool,
    page: impl FnMut() -> String + 'static,
) -> std::io::Result<()> {
    let page = Rc::new(RefCell::new(page));
    let service = service_fn(move |request: Request<Incoming>| {
        std::future::ready(Ok::<_, Infallible>(answer(&request, &mut *page.borrow_mut())))
    });
    let stopped = async {
        while !done.load(Ordering::Acquire) {
            tokio::time::sleep(STOP_CHECK).await;
        }
    };
    tokio::runtime::Builder::new_current_thread().enable_all().build()?.block_on(async {
        listener.set_nonblocking(true)?;
        http::serve(tokio::net::TcpListener::from_std(listener)?, service, stopped).await;
        Ok(())
    })
}

fn answer(request: &Request<Incoming>, page: &mut impl FnMut() -> String) -> Response {
    let host = request.headers().get(header::HOST).and_then(|value| value.to_str().ok());
    if !host.is_some_and(http::is_this_machine) {
        return (StatusCode::FORBIDDEN, "the metrics are for this machine; ask for localhost\n")
            .into_response();
    }
    if request.method() == Method::GET && request.uri().path() == "/metrics" {
        return ([(header::CONTENT_TYPE, CONTENT_TYPE)], page()).into_response();
    }
    (StatusCode::NOT_FOUND, "the metrics are at /metrics\n").into_response()
}

#[derive(Debug)]
struct Twins(Vec<Health>);

impl Twins {
    /// Each twin with its label.
    fn all(&self) -> impl Iterator<Item = (String, &Health)> {
        self.0.iter().map(|health| (unpack_name(&health.actuator), health))
    }
}

impl Collector for Twins {
    fn encode(&self, mut encoder: DescriptorEncoder) -> Result<(), Error> {
        for (name, help, read) in COUNTERS {
            let values = self.all().map(|(actuator, health)| ([("actuator", actuator)], read(health)));
            counters(&mut encoder, name, help, values)?;
        }
        for (name, help, read) in GAUGES {
            let values = self.all().map(|(actuator, health)| ([("actuator", actuator)], read(health)));
            gauges(&mut encoder, name, help, values)?;
        }
        let outcomes = self.all().flat_map(|(actuator, health)| {
            Outcome::ALL.iter().map(move |outcome| {
                let outcome_label = ("outcome", outcome.as_str().to_owned());
                ([("actuator", actuator.clone()), outcome_label], health.count(*outcome))
            })
        });
        counters(&mut encoder, "softtwin_outcomes", "Readings by what became of them", outcomes)?;
        let latencies = self.all().flat_map(|(actuator, health)| {
            [("0.5", health.latency_p50_ns), ("0.99", health.latency_p99_ns)].map(|(quantile, ns)| {
                ([("actuator", actuator.clone()), ("quantile", quantile.to_owned())], ns as f64 * SECOND)
            })
        });
        gauges(
            &mut encoder,
            "softtwin_latency_seconds",
            "Sensor stamp to sent over the last interval",
            latencies,
        )?;
        let set = self.all().flat_map(|(actuator, health)| {
            flags::ALL.iter().map(move |Code { number: bit, name: flag, .. }| {
                let is_set = f64::from(u8::from(health.flags & bit != 0));
                ([("actuator", actuator.clone()), ("flag", (*flag).to_owned())], is_set)
            })
        });
        gauges(&mut encoder, "softtwin_flag", "1 while the flag is set", set)
    }
}

#[derive(Debug)]
struct BridgePage {
    counters: Arc<BridgeCounters>,
    devices: Vec<(String, Arc<SensorCounters>)>,
}

impl Collector for BridgePage {
    fn encode(&self, mut encoder: DescriptorEncoder) -> Result<(), Error> {
        let value = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        for (name, help, counter) in [
            ("softtwin_bridge_sent", "Readings sent", &self.counters.sent),
            ("softtwin_bridge_failed", "Readings that could not be sent", &self.counters.failed),
            ("softtwin_bridge_late", "Readings sent late", &self.counters.late),
        ] {
            let mut metric = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
            metric.encode_counter::<NoLabelSet, _, u64>(&value(counter), None)?;
        }
        let events = self.devices.iter().flat_map(|(actuator, device)| {
            device.all().map(|(event, count)| ([("actuator", actuator.as_str()), ("event", event)], count))
        });
        counters(&mut encoder, "softtwin_sensor_events", "What became of the sensors' answers", events)
    }
}

fn counters<L: EncodeLabelSet>(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    values: impl Iterator<Item = (L, u64)>,
) -> Result<(), Error> {
    let mut metric = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
    for (labels, value) in values {
        metric.encode_family(&labels)?.encode_counter::<NoLabelSet, _, u64>(&value, None)?;
    }
    Ok(())
}

fn gauges<L: EncodeLabelSet>(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    values: impl Iterator<Item = (L, f64)>,
) -> Result<(), Error> {
    let mut metric = encoder.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (labels, value) in values {
        metric.encode_family(&labels)?.encode_gauge(&value)?;
    }
    Ok(())
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
        let page = twins(vec![health, Health { actuator: pack_name("thumb"), ..health }]);
        for line in [
            "# TYPE softtwin_readings counter",
            "softtwin_readings_total{actuator=\"finger\"} 7",
            "softtwin_readings_total{actuator=\"thumb\"} 7",
            "softtwin_age_seconds{actuator=\"finger\"} 1.5",
            "softtwin_outcomes_total{actuator=\"finger\",outcome=\"held: absurd value\"} 3",
            "softtwin_flag{actuator=\"finger\",flag=\"no-data\"} 1.0",
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
        let counters = Arc::new(BridgeCounters::default());
        let device = Arc::new(SensorCounters::default());
        device.timeouts.store(2, Ordering::Relaxed);
        let page = bridge(&counters, &[("q\"\\\n".into(), device)]);
        let event = "softtwin_sensor_events_total{actuator=\"q\\\"\\\\\\n\",event=\"timeouts\"} 2\n";
        assert!(page.contains(event), "{page}");
        assert!(page.contains("\nsofttwin_bridge_sent_total 0\n"), "{page}");
    }
}
