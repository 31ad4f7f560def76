//! Counters and latencies for Prometheus (OpenMetrics text).

use crate::bridge::{BridgeCounters, BridgeDevices};
use crate::http;
use crate::thread_group::ThreadGroup;
use crate::valve::ValveCounters;
use axum::http::{Method, Request, StatusCode, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::service::service_fn;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use recording::RecordSummary;
use std::cell::RefCell;
use std::convert::Infallible;
use std::net::{SocketAddr, TcpListener};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use wire::layout::{estimate_alarm, flags, unpack_name, valve_reason};
use wire::{Estimate, Health, Outcome, Topic};

/// How often the end of the process is checked for.
const STOP_CHECK: Duration = Duration::from_millis(50);
/// Content type of the metrics.
const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

const SECOND: f64 = 1e-9;

/// Name, help, value.
type Metric<T> = (&'static str, &'static str, fn(&Health) -> T);

/// Counters; in the exposition format their names end with `_total`.
const COUNTERS: [Metric<u64>; 8] = [
    ("softtwin_readings", "Readings taken from the sensor topic", |h| h.received),
    ("softtwin_missed", "Readings that never arrived", |h| h.missed),
    ("softtwin_sensor_restarts", "Restarts of the bridge seen", |h| h.sensor_restarts),
    ("softtwin_deadline_misses", "Times without a good reading within the deadline", |h| h.deadline_misses),
    ("softtwin_fields", "Fields sent over all node sets", |h| h.fields_sent),
    ("softtwin_states", "States sent", |h| h.states_sent),
    ("softtwin_late", "Readings sent later than the configured limit", |h| h.late),
    ("softtwin_log_lost", "Events and lines that are missing in the log", |h| h.log_lost),
];

const GAUGES: [Metric<f64>; 5] = [
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

/// A number of each estimated quantity, by its place.
type OfEstimates = (&'static str, &'static str, fn(&Estimate, usize) -> Option<f64>);

/// Metrics of every estimated quantity.
const ESTIMATES: [OfEstimates; 3] = [
    ("softtwin_estimate", "Estimated value, in the unit of its name", |e, at| e.values.get(at).copied()),
    ("softtwin_estimate_sigma", "Its standard deviation", |e, at| e.sigmas.get(at).copied()),
    ("softtwin_estimate_identifiable", "1 if the readings identify it", |e, at| {
        Some(f64::from(e.identifiable >> at & 1))
    }),
];

/// Labels of a sample.
type Labels = Vec<(&'static str, String)>;

/// Metrics of a twin process: one sample per actuator and per estimated quantity.
pub fn twins(healths: &[Health], estimates: &[Estimate]) -> String {
    let mut page = Registry::default();
    let named = || healths.iter().map(|health| (vec![("actuator", unpack_name(&health.actuator))], health));
    for (name, help, read) in COUNTERS {
        counters(&mut page, name, help, named().map(|(labels, health)| (labels, read(health))));
    }
    for (name, help, read) in GAUGES {
        gauges(&mut page, name, help, named().map(|(labels, health)| (labels, read(health))));
    }
    let outcomes = named().flat_map(|(labels, health)| {
        Outcome::ALL
            .iter()
            .map(move |outcome| (with(&labels, "outcome", outcome.as_str()), health.count(*outcome)))
    });
    counters(&mut page, "softtwin_outcomes", "Readings by outcome", outcomes);
    let latencies = named().flat_map(|(labels, health)| {
        [("0.5", health.latency_p50_ns), ("0.99", health.latency_p99_ns)]
            .map(|(quantile, ns)| (with(&labels, "quantile", quantile), ns as f64 * SECOND))
    });
    gauges(&mut page, "softtwin_latency_seconds", "Sensor stamp to sent over the last interval", latencies);
    let set = named().flat_map(|(labels, health)| {
        let is_set = |bit: u32| f64::from(u8::from(health.flags & bit != 0));
        flags::ALL.iter().map(move |flag| (with(&labels, "flag", flag.name), is_set(flag.number)))
    });
    gauges(&mut page, "softtwin_flag", "1 while the flag is set", set);
    if !estimates.is_empty() {
        self::estimates(&mut page, estimates);
    }
    text(&page)
}

fn estimates(page: &mut Registry, estimates: &[Estimate]) {
    let named = || estimates.iter().map(|e| (vec![("actuator", unpack_name(&e.actuator))], e));
    for (name, help, read) in ESTIMATES {
        let values = named().flat_map(|(labels, e)| {
            let count = e.unknown_count as usize;
            (0..count).filter_map(move |at| Some((with(&labels, "quantity", &e.name(at)), read(e, at)?)))
        });
        gauges(page, name, help, values);
    }
    let nis = named().map(|(labels, e)| (labels, e.nis));
    gauges(page, "softtwin_estimate_nis", "Normalised innovation squared of the last reading", nis);
    let alarms = named().flat_map(|(labels, e)| {
        estimate_alarm::ALL.iter().map(move |alarm| {
            (with(&labels, "alarm", alarm.name), f64::from(u8::from(e.alarm == alarm.number)))
        })
    });
    gauges(page, "softtwin_estimate_alarm", "1 for what has not fitted lately", alarms);
}

/// Metrics of a recorder process; `free_bytes` of its file system.
pub fn recorder(summary: &RecordSummary, free_bytes: Option<u64>) -> String {
    let mut page = Registry::default();
    let by_topic = summary.messages.iter().map(|(topic, count)| (vec![("topic", topic.clone())], *count));
    counters(&mut page, "softtwin_recorder_messages", "Messages recorded", by_topic);
    for (name, help, value) in [
        ("softtwin_recorder_dropped", "Messages dropped because the disk was too slow", summary.dropped),
        ("softtwin_recorder_removed_files", "Old files removed", summary.disk.removed),
        ("softtwin_recorder_flushes", "Times that everything was forced onto the disk", summary.flushes),
    ] {
        counters(&mut page, name, help, [(Vec::new(), value)]);
    }
    for (name, help, value) in [
        (
            "softtwin_recorder_missing",
            "Samples that were published and did not arrive yet",
            Some(summary.missing),
        ),
        ("softtwin_recorder_files", "Files of the series", Some(summary.disk.files as u64)),
        ("softtwin_recorder_bytes", "Bytes of the series", Some(summary.disk.bytes)),
        ("softtwin_recorder_free_bytes", "Free in the file system", free_bytes),
        (
            "softtwin_recorder_errors",
            "Topics that cannot be recorded at the moment",
            Some(summary.errors.len() as u64),
        ),
        (
            "softtwin_recorder_skipped",
            "Topics of programs of another version",
            Some(summary.skipped.len() as u64),
        ),
    ] {
        gauges(&mut page, name, help, value.map(|value| (Vec::new(), value as f64)));
    }
    text(&page)
}

/// Metrics of a gateway process: name, help and value of its counters, samples lost before it, and the longest time to send a message, s.
pub fn gateway(values: &[(&'static str, &'static str, u64)], lost: u64, longest_send_s: f64) -> String {
    let mut page = Registry::default();
    for (name, help, value) in values {
        counters(&mut page, name, help, [(Vec::new(), *value)]);
    }
    for (name, help, value) in [
        ("softtwin_gateway_lost", "Samples that did not arrive before the gateway yet", lost as f64),
        ("softtwin_gateway_longest_send_seconds", "Slowest hand-over to the network", longest_send_s),
    ] {
        gauges(&mut page, name, help, [(Vec::new(), value)]);
    }
    text(&page)
}

/// An address of this machine, from the command line.
///
/// # Errors
/// Expected form.
pub fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr =
        text.parse().map_err(|_| "expected an address such as 127.0.0.1:9464".to_owned())?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("expected a loopback address: the endpoint has no password; use a proxy for access from elsewhere".into())
    }
}

/// Opens the port, if there is to be one.
///
/// # Errors
/// A port in use.
pub fn listen(address: Option<SocketAddr>) -> std::io::Result<Option<TcpListener>> {
    let Some(address) = address else { return Ok(None) };
    let listener = TcpListener::bind(address).map_err(|error| {
        let text = format!("--metrics {address}: cannot listen there: {error}; is the port in use?");
        std::io::Error::new(error.kind(), text)
    })?;
    tracing::info!("metrics: http://{}/metrics", listener.local_addr()?);
    Ok(Some(listener))
}

/// Serves the metrics in a thread of the group, if there is a port. `page` is created in that thread and returns the metrics for
/// each request.
///
/// # Errors
/// The system refuses a thread.
pub fn start<P: FnMut() -> String + 'static>(
    group: &mut ThreadGroup,
    listener: Option<TcpListener>,
    page: impl FnOnce() -> P + Send + 'static,
) -> std::io::Result<()> {
    let Some(listener) = listener else { return Ok(()) };
    group.start("metrics", move |end| Ok(serve(listener, end.as_atomic(), page())?))
}

/// Metrics of a bridge process; devices and valves with the name of their actuator.
pub fn bridge(
    bridge: &BridgeCounters,
    devices: &BridgeDevices,
    valves: &[(Topic, Arc<ValveCounters>)],
) -> String {
    let mut page = Registry::default();
    for (name, help, value) in [
        ("softtwin_bridge_sent", "Readings sent", &bridge.sent),
        ("softtwin_bridge_failed", "Readings that could not be sent", &bridge.failed),
        ("softtwin_bridge_late", "Readings sent late", &bridge.late),
    ] {
        let counter: Counter = Counter::default();
        counter.inc_by(value.load(Ordering::Relaxed));
        page.register(name, help, counter);
    }
    let events = devices.iter().flat_map(|(actuator, sensor, device)| {
        let mut labels = vec![("actuator", actuator.clone())];
        labels.extend((!sensor.is_empty()).then(|| ("sensor", sensor.clone())));
        device.all().map(|(event, count)| (with(&labels, "event", event), count))
    });
    counters(&mut page, "softtwin_sensor_events", "Answers of the sensors by outcome", events);
    let labels = |valve: &Topic| {
        let mut labels = vec![("actuator", valve.actuator().to_owned())];
        labels.extend(valve.cavity().map(|cavity| ("cavity", cavity.to_owned())));
        labels
    };
    let events = valves.iter().flat_map(|(topic, valve)| {
        let labels = labels(topic);
        valve.all().map(|(event, count)| (with(&labels, "event", event), count))
    });
    counters(&mut page, "softtwin_valve_events", "Writes to valves, and what has closed them", events);
    let reasons = valves.iter().flat_map(|(topic, valve)| {
        let now = valve.reason.load(Ordering::Relaxed);
        let labels = labels(topic);
        valve_reason::ALL.iter().map(move |reason| {
            (with(&labels, "reason", reason.name), f64::from(u8::from(reason.number == now)))
        })
    });
    gauges(&mut page, "softtwin_valve_reason", "1 for why the valve has its value", reasons);
    text(&page)
}

fn with(labels: &[(&'static str, String)], key: &'static str, value: &str) -> Labels {
    [labels, &[(key, value.to_owned())]].concat()
}

fn counters(page: &mut Registry, name: &str, help: &str, values: impl IntoIterator<Item = (Labels, u64)>) {
    let family = Family::<Labels, Counter>::default();
    for (labels, value) in values {
        family.get_or_create(&labels).inc_by(value);
    }
    page.register(name, help, family);
}

fn gauges(page: &mut Registry, name: &str, help: &str, values: impl IntoIterator<Item = (Labels, f64)>) {
    let family = Family::<Labels, Gauge<f64, AtomicU64>>::default();
    for (labels, value) in values {
        family.get_or_create(&labels).set(value);
    }
    page.register(name, help, family);
}

fn text(page: &Registry) -> String {
    let mut text = String::new();
    match encode(&mut text, page) {
        Ok(()) => text,
        Err(error) => format!("# the metrics could not be written: {error}\n"),
    }
}

/// Answers requests for the metrics until `done`. `page` returns them for each request; foreign names in `Host` are refused.
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
    if matches!(*request.method(), Method::GET | Method::HEAD) && request.uri().path() == "/metrics" {
        return ([(header::CONTENT_TYPE, CONTENT_TYPE)], page()).into_response();
    }
    (StatusCode::NOT_FOUND, "the metrics are at /metrics\n").into_response()
}

#[cfg(test)]
#[path = "../tests/unit/metrics.rs"]
mod tests;
