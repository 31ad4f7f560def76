//! The gateway's configuration: endpoints, certificates and users, topics. The file is parsed and then checked as a whole, so that all
//! errors are reported at once.

use crate::ros::{self, Ros2, Ros2File};
use runtime::config::ConfigError;
use runtime::file;
use serde::Deserialize;
use std::fmt;
use std::net::IpAddr;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
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
    pub mode: Mode,
    pub listen: Vec<Endpoint>,
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
    pub ros2: Option<Ros2>,
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
    let known = check_security(file.security, path, problems);
    for endpoint in &listen {
        problems.extend(unprotected("listen", endpoint, known.authenticates_callers()));
        if endpoint.is_tls && known.own.is_none() {
            problems.push(format!("listen {endpoint}: needs security.certificate and security.private_key"));
        }
    }
    for endpoint in &connect {
        problems.extend(unprotected("connect", endpoint, known.has_credentials()));
    }
    if is_client && !listen.is_empty() {
        problems.push("listen: a client listens nowhere; leave it out, or be a \"peer\"".into());
    }
    if !listen.is_empty() && known.has_credentials() && !known.authenticates_callers() {
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
        ros2: file.ros2.map(|ros2| ros::check_config(ros2, path, problems)),
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
    topic_named: impl Fn(&str) -> Result<Topic, WireError>,
    names: &[String],
    problems: &mut Vec<String>,
) -> Vec<Topic> {
    let mut topics: Vec<Topic> = Vec::new();
    for name in names {
        match topic_named(name) {
            Ok(topic) if topics.contains(&topic) => problems.push(format!("{key}: {name:?} twice")),
            Ok(topic) => topics.push(topic),
            Err(error) => problems.push(format!("{key}: {error}")),
        }
    }
    topics
}

/// One endpoint in Zenoh's notation: `tcp/<host>:<port>` or `tls/<host>:<port>`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    /// Encrypted, with a certificate for its host.
    pub is_tls: bool,
    host: String,
    port: u16,
}

impl Endpoint {
    /// Reads an endpoint. Zenoh's options behind `?` and `#` are refused: they could name other keys and interfaces than
    /// the ones that were checked.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = || format!("expected tcp/<host>:<port> or tls/<host>:<port>, found {text:?}");
        let (protocol, address) = text.split_once('/').ok_or_else(expected)?;
        let is_tls = match protocol {
            "tcp" => false,
            "tls" => true,
            _ => return Err(expected()),
        };
        let (host, port) = address.rsplit_once(':').ok_or_else(expected)?;
        let port = port.parse().ok().filter(|port| *port != 0).ok_or_else(expected)?;
        let bracketed = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        let plain = bracketed.unwrap_or(host);
        let is_address =
            plain.parse::<IpAddr>().is_ok_and(|address| address.is_ipv6() == bracketed.is_some());
        let is_name = bracketed.is_none()
            && plain.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'.');
        if plain.is_empty() || !(is_address || is_name) {
            return Err(expected());
        }
        Ok(Self { is_tls, host: plain.into(), port })
    }

    pub fn port(&self) -> u16 {
        self.port
    }

    /// True for an endpoint of this machine; false for names other than `localhost`.
    pub fn is_loopback(&self) -> bool {
        self.host == "localhost" || self.host.parse().is_ok_and(|address: IpAddr| address.is_loopback())
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let protocol = if self.is_tls { "tls" } else { "tcp" };
        let (open, close) = if self.host.contains(':') { ("[", "]") } else { ("", "") };
        write!(f, "{protocol}/{open}{}{close}:{}", self.host, self.port)
    }
}

/// Values separated by commas; "nothing" without any.
pub fn list(values: &[impl ToString]) -> String {
    let listed: Vec<String> = values.iter().map(ToString::to_string).collect();
    if listed.is_empty() { "nothing".into() } else { listed.join(", ") }
}

/// The table `[security]`, as written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct SecurityFile {
    certificate: Option<PathBuf>,
    private_key: Option<PathBuf>,
    root_certificate: Option<PathBuf>,
    users_file: Option<PathBuf>,
    user: Option<String>,
    password_file: Option<PathBuf>,
}

#[derive(Debug, Clone, Default)]
pub struct Security {
    /// Own certificate and its private key, PEM.
    pub own: Option<(PathBuf, PathBuf)>,
    pub root_certificate: Option<PathBuf>,
    /// Accepted users: one `user:password` per line.
    pub users_file: Option<PathBuf>,
    pub credentials: Option<(String, Password)>,
}

/// One line for a log: files and names, no password.
impl fmt::Display for Security {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = |path: Option<&PathBuf>| path.map_or("none".into(), |path| path.display().to_string());
        let certificate = file(self.own.as_ref().map(|(certificate, _)| certificate));
        let (root, users) = (file(self.root_certificate.as_ref()), file(self.users_file.as_ref()));
        let user = self.credentials.as_ref().map_or("none", |(user, _)| user.as_str());
        write!(f, "certificate {certificate}, root certificate {root}, users file {users}, user {user}")
    }
}

#[derive(Clone)]
pub struct Password(pub String);

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("***")
    }
}

/// The error of an endpoint beyond this machine without encryption or passwords.
fn unprotected(key: &str, endpoint: &Endpoint, knows_users: bool) -> Option<String> {
    if endpoint.is_loopback() || (endpoint.is_tls && knows_users) {
        return None;
    }
    let users = match key {
        "listen" => "security.users_file",
        _ => "security.user and security.password_file",
    };
    Some(format!(
        "{key} {endpoint}: leaves this machine, so it needs tls/ (found {}/) and {users} ({}); or stay on 127.0.0.1",
        if endpoint.is_tls { "tls" } else { "tcp" },
        if knows_users { "given" } else { "missing" },
    ))
}

impl Security {
    fn authenticates_callers(&self) -> bool {
        self.users_file.is_some()
    }

    fn has_credentials(&self) -> bool {
        self.credentials.is_some()
    }
}

/// Reads and checks the table; its paths count from the folder of the configuration file `config`.
fn check_security(file: SecurityFile, config: &Path, problems: &mut Vec<String>) -> Security {
    let mut read = |key: &str, path: Option<PathBuf>, is_secret: bool| {
        let path = file::named_in(config, path?);
        let found = readable(&path, is_secret);
        let text =
            found.map_err(|error| problems.push(format!("security.{key}: {}: {error}", path.display())));
        Some((path, text.ok()?))
    };
    let certificate = read("certificate", file.certificate.clone(), false);
    let private_key = read("private_key", file.private_key.clone(), true);
    let root_certificate = read("root_certificate", file.root_certificate, false);
    let users = read("users_file", file.users_file, true);
    let password = read("password_file", file.password_file.clone(), true);
    if file.certificate.is_some() != file.private_key.is_some() {
        problems.push("security: certificate and private_key go together, one of them is missing".into());
    }
    if file.user.is_some() != file.password_file.is_some() {
        problems.push("security: user and password_file go together, one of them is missing".into());
    }
    if let Some((path, text)) = &users {
        problems.extend(
            users_problem(text).map(|problem| format!("security.users_file: {}: {problem}", path.display())),
        );
    }
    let credentials =
        file.user.zip(password).map(|(user, (_, text))| (user, Password(text.trim().to_owned())));
    if credentials.as_ref().is_some_and(|(user, password)| user.is_empty() || password.0.is_empty()) {
        problems.push("security: user and password must not be empty".into());
    }
    Security {
        own: certificate.zip(private_key).map(|((certificate, _), (key, _))| (certificate, key)),
        root_certificate: root_certificate.map(|(path, _)| path),
        users_file: users.map(|(path, _)| path),
        credentials,
    }
}

/// The content of a file; secrets must not be accessible to all users.
fn readable(path: &Path, is_secret: bool) -> Result<String, String> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)
        .map_err(|error| format!("cannot be read: {}", error.cause()))?;
    let mode = std::fs::metadata(path).map_err(|error| error.to_string())?.permissions().mode();
    if is_secret && mode & 0o007 != 0 {
        return Err(format!("all users of this machine have access (mode {:o}); chmod 600", mode & 0o777));
    }
    Ok(text)
}

/// The error in a list of users. With an empty list Zenoh would authenticate no callers.
fn users_problem(text: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let is_good = |line: &&str| {
        line.split_once(':').is_some_and(|(user, word)| !user.trim().is_empty() && !word.trim().is_empty())
    };
    match lines.iter().position(|line| !is_good(line)) {
        _ if lines.is_empty() => Some("expected one `user:password` per line, found none".into()),
        Some(at) => Some(format!("expected one `user:password` per line; entry {} is different", at + 1)),
        None => None,
    }
}

#[cfg(test)]
#[path = "../tests/unit/config.rs"]
mod tests;
