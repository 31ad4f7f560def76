//! Certificates, users and passwords. Endpoints beyond this machine need all of them.

use crate::endpoint::Endpoint;
use runtime::file;
use serde::Deserialize;
use std::fmt;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// The table `[security]`, as written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SecurityFile {
    certificate: Option<PathBuf>,
    private_key: Option<PathBuf>,
    root_certificate: Option<PathBuf>,
    users_file: Option<PathBuf>,
    user: Option<String>,
    password_file: Option<PathBuf>,
}

/// Certificates and passwords.
#[derive(Debug, Clone, Default)]
pub struct Security {
    /// Own certificate and its private key, PEM.
    pub own: Option<(PathBuf, PathBuf)>,
    /// Root certificate of the other programs, PEM.
    pub root_certificate: Option<PathBuf>,
    /// Accepted users: one `user:password` per line.
    pub users_file: Option<PathBuf>,
    /// Name and password for outgoing connections.
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

/// A password, hidden from logs.
#[derive(Clone)]
pub struct Password(pub String);

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("***")
    }
}

/// The error of an endpoint beyond this machine without encryption or passwords.
pub fn closed(key: &str, endpoint: &Endpoint, knows_users: bool) -> Option<String> {
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
    /// True if callers are authenticated.
    pub fn may_listen(&self) -> bool {
        self.users_file.is_some()
    }

    /// True if the gateway has credentials.
    pub fn may_connect(&self) -> bool {
        self.credentials.is_some()
    }
}

/// Reads and checks the table; its paths count from the folder of the configuration file `config`.
pub fn check(file: SecurityFile, config: &Path, problems: &mut Vec<String>) -> Security {
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
    let text =
        file::read_text(path, file::MAX_TEXT_BYTES).map_err(|error| format!("cannot be read: {error}"))?;
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
