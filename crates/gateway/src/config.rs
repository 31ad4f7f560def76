//! The gateway's configuration: parsed, then checked as a whole; all errors are reported at once.

use crate::endpoint::Endpoint;
use crate::ros::{self, Ros2, Ros2File};
use crate::security::{self, Security, SecurityFile};
use runtime::config::ConfigError;
use serde::Deserialize;
use std::path::Path;
use std::time::Duration;
use wire::{KeyExpr, Topic, WireError};

/// Role of the gateway in the Zenoh network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Exchanges data with all connected peers.
    #[default]
    Peer,
    /// Connects to one router, the first that answers.
    Client,
    /// As a peer; also forwards between all connected programs.
    Router,
}

/// Default endpoint: reachable from this machine only.
const DEFAULT_LISTEN: &str = "tcp/127.0.0.1:7447";

/// The file, as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct File {
    mode: Mode,
    listen: Option<Vec<String>>,
    connect: Vec<String>,
    prefix: String,
    keys: Vec<String>,
    field_rate_hz: f64,
    readings_from_network: Vec<String>,
    targets_from_network: Vec<String>,
    ros2: Option<Ros2File>,
    security: SecurityFile,
}

impl Default for File {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            listen: None,
            connect: Vec::new(),
            prefix: String::new(),
            keys: vec!["softtwin/**".into()],
            field_rate_hz: 30.0,
            readings_from_network: Vec::new(),
            targets_from_network: Vec::new(),
            ros2: None,
            security: SecurityFile::default(),
        }
    }
}

/// Checked configuration of the gateway.
#[derive(Debug, Clone)]
pub struct Config {
    /// Role in the network.
    pub mode: Mode,
    /// Endpoints that it listens on.
    pub listen: Vec<Endpoint>,
    /// Endpoints that it connects to.
    pub connect: Vec<Endpoint>,
    /// Prefix of every key on the network: empty, or chunks with a `/` at the end.
    pub prefix: String,
    /// Local topics that are published.
    pub keys: Vec<KeyExpr>,
    /// Time between two fields of a topic.
    pub field_period: Duration,
    /// Sensor topics that are fed from the network.
    pub inlets: Vec<Topic>,
    /// Target topics that are fed from nodes of ROS 2.
    pub targets: Vec<Topic>,
    /// The node of ROS 2, if configured.
    pub ros2: Option<Ros2>,
    /// Certificates and users.
    pub security: Security,
}

impl Config {
    /// Reads and checks a file. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// All errors in the file at once.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let file: File = runtime::config::read(path)?;
        let mut problems = Vec::new();
        let config = check(file, path, &mut problems);
        if problems.is_empty() { Ok(config) } else { Err(ConfigError { path: path.into(), problems }) }
    }
}

fn check(file: File, path: &Path, problems: &mut Vec<String>) -> Config {
    let is_client = file.mode == Mode::Client;
    if !is_client && file.listen.as_ref().is_some_and(Vec::is_empty) && file.connect.is_empty() {
        problems.push("listen, connect: expected at least one endpoint, found none".into());
    }
    if is_client && file.connect.is_empty() {
        problems.push("connect: expected the endpoint of a router for mode \"client\", found none".into());
    }
    let listen = match file.listen {
        Some(listed) => endpoints("listen", &listed, problems),
        None if is_client => Vec::new(),
        None => endpoints("listen", &[DEFAULT_LISTEN.to_owned()], problems),
    };
    let connect = endpoints("connect", &file.connect, problems);
    let known = security::check(file.security, path, problems);
    for endpoint in &listen {
        problems.extend(security::closed("listen", endpoint, known.may_listen()));
        if endpoint.is_tls && known.own.is_none() {
            problems.push(format!("listen {endpoint}: needs security.certificate and security.private_key"));
        }
    }
    for endpoint in &connect {
        problems.extend(security::closed("connect", endpoint, known.may_connect()));
    }
    if is_client && !listen.is_empty() {
        problems.push("listen: a client listens nowhere; leave it out, or be a \"peer\"".into());
    }
    if !listen.is_empty() && known.may_connect() && !known.may_listen() {
        problems.push(
            "security.user: a gateway with a password also asks its callers for one; give users_file, or listen = []".into(),
        );
    }
    if file.ros2.is_some() && file.mode == Mode::Peer && !connect.is_empty() {
        let mode = if listen.is_empty() { "client" } else { "router" };
        problems.push(format!(
            "mode: expected \"{mode}\", found \"peer\": the router of ROS 2 passes nothing on from one peer to another"
        ));
    }
    if file.ros2.is_none() && !file.targets_from_network.is_empty() {
        problems
            .push("targets_from_network: expected a table [ros2], whose nodes send them, found none".into());
    }
    if !(0.001..=1000.0).contains(&file.field_rate_hz) {
        problems.push(format!("field_rate_hz: expected 0.001 to 1000, found {}", file.field_rate_hz));
    }
    Config {
        mode: file.mode,
        listen,
        connect,
        prefix: prefix(&file.prefix, problems),
        keys: keys(&file.keys, problems),
        field_period: Duration::try_from_secs_f64(1.0 / file.field_rate_hz).unwrap_or_default(),
        inlets: topics("readings_from_network", Topic::sensor, &file.readings_from_network, problems),
        targets: topics("targets_from_network", Topic::target, &file.targets_from_network, problems),
        ros2: file.ros2.map(|ros2| ros::check(ros2, path, problems)),
        security: known,
    }
}

fn endpoints(key: &str, listed: &[String], problems: &mut Vec<String>) -> Vec<Endpoint> {
    let mut take =
        |text: &String| Endpoint::parse(text).map_err(|error| problems.push(format!("{key}: {error}"))).ok();
    listed.iter().filter_map(&mut take).collect()
}

fn prefix(text: &str, problems: &mut Vec<String>) -> String {
    if text.is_empty() {
        return String::new();
    }
    let is_plain = |chunk: &str| {
        !chunk.is_empty()
            && chunk.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-')
    };
    let text = text.strip_suffix('/').unwrap_or(text);
    if !text.split('/').all(is_plain) {
        problems.push(format!(
            "prefix: expected chunks of letters, digits, `_`, `-`, separated by `/`, found {text:?}"
        ));
    }
    format!("{text}/")
}

fn keys(listed: &[String], problems: &mut Vec<String>) -> Vec<KeyExpr> {
    let mut take =
        |text: &String| KeyExpr::new(text).map_err(|error| problems.push(format!("keys: {error}"))).ok();
    listed.iter().filter_map(&mut take).collect()
}

fn topics(
    key: &str,
    of: impl Fn(&str) -> Result<Topic, WireError>,
    names: &[String],
    problems: &mut Vec<String>,
) -> Vec<Topic> {
    let mut topics: Vec<Topic> = Vec::new();
    for name in names {
        match of(name) {
            Ok(topic) if topics.contains(&topic) => problems.push(format!("{key}: {name:?} twice")),
            Ok(topic) => topics.push(topic),
            Err(error) => problems.push(format!("{key}: {error}")),
        }
    }
    topics
}
