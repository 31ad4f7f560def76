//! Endpoints that the gateway listens on and connects to.

use std::fmt;
use std::net::IpAddr;

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

#[cfg(test)]
#[path = "../tests/unit/endpoint.rs"]
mod tests;
