//! Gateways as real processes, and a plain Zenoh client (the far end).

use serde_json::{Value, json};
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use tests::wait::wait_until;
use tests::{PATIENCE, Program, Stage};
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

pub const FAST_SINE: &str = r#"kind = "simulate"
rate_hz = 500.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 2.0 }"#;

/// A free TCP port.
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port").port()
}

/// Starts a gateway with this configuration and waits until it is ready.
pub fn gateway(stage: &Stage, config: &str) -> Program {
    let mut gateway = gateway_unready(stage, config);
    gateway.wait_for("ready:");
    gateway
}

/// The same without waiting.
pub fn gateway_unready(stage: &Stage, config: &str) -> Program {
    gateway_in(stage, config, &[])
}

/// The same with more in its environment.
pub fn gateway_in(stage: &Stage, config: &str, environment: &[(&str, String)]) -> Program {
    let settings: String = environment.iter().map(|(name, value)| format!("{name}='{value}' ")).collect();
    started(stage, config, &settings, "")
}

/// A gateway with a metrics endpoint at this address.
pub fn gateway_with_metrics(stage: &Stage, config: &str, address: &str) -> Program {
    let mut gateway = started(stage, config, "", &format!("--metrics {address}"));
    gateway.wait_for("ready:");
    gateway
}

fn started(stage: &Stage, config: &str, settings: &str, options: &str) -> Program {
    let path = stage.write("gateway.toml", config).display().to_string();
    Program::shell(stage, &format!("{settings}exec softtwin-gateway --config {path} {options}"))
}

/// Settings of a plain Zenoh client of this endpoint.
pub fn client(endpoint: &str) -> Value {
    json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint] },
        "scouting": { "multicast": { "enabled": false } },
    })
}

/// Opens a session.
pub fn join(settings: &Value) -> zenoh::Result<Session> {
    zenoh::open(zenoh::Config::from_json5(&settings.to_string())?).wait()
}

/// A far end that calls the gateway on this port.
pub fn far_end(port: u16) -> Session {
    join(&client(&format!("tcp/127.0.0.1:{port}"))).expect("the gateway takes callers")
}

/// Subscribes; samples come out of the channel until it is dropped.
pub fn subscribe(session: &Session, key: &str) -> Receiver<Sample> {
    let (sender, receiver) = channel();
    let take = move |sample| drop(sender.send(sample));
    session.declare_subscriber(key).callback(take).background().wait().expect("a subscription");
    receiver
}

/// Waits for a sample that `wanted` has an answer for.
pub fn wait_sample<T>(
    samples: &Receiver<Sample>,
    what: &str,
    mut wanted: impl FnMut(&Sample) -> Option<T>,
) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        match samples.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(sample) => {
                if let Some(found) = wanted(&sample) {
                    return found;
                }
            }
            Err(RecvTimeoutError::Timeout) => panic!("{what} did not come"),
            Err(RecvTimeoutError::Disconnected) => panic!("the subscription ended before {what}"),
        }
    }
}

/// The JSON of a sample.
pub fn json_of(sample: &Sample) -> Value {
    serde_json::from_slice(&sample.payload().to_bytes()).expect("JSON")
}

/// Sends one query: the reply or the refusal; `None` without an answer.
pub fn get(session: &Session, selector: &str) -> Option<Result<Sample, String>> {
    let replies = session.get(selector).timeout(Duration::from_secs(5)).wait().expect("a question");
    let reply = replies.recv().ok()?;
    Some(
        reply.into_result().map_err(|error| error.payload().try_to_string().unwrap_or_default().into_owned()),
    )
}

/// Repeats a query until the answer satisfies `wanted`.
pub fn get_until<T>(
    session: &Session,
    selector: &str,
    wanted: impl Fn(Result<Sample, String>) -> Option<T>,
) -> T {
    wait_until(selector, || get(session, selector).and_then(&wanted))
}

/// Keys of all living twins.
pub fn living(session: &Session, key: &str) -> Vec<String> {
    let replies = session.liveliness().get(key).timeout(Duration::from_secs(5)).wait().expect("a question");
    let mut keys: Vec<String> = replies
        .iter()
        .filter_map(|reply| reply.into_result().ok().map(|sample| sample.key_expr().as_str().to_owned()))
        .collect();
    keys.sort();
    keys
}
