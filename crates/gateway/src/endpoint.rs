//! Where the gateway listens and whom it calls, and whether that leaves the machine.

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

    /// Whether nobody outside this machine is at the other end. A name other than `localhost` may be anybody.
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

/// Endpoints for people.
pub fn list(endpoints: &[Endpoint]) -> String {
    endpoints.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_endpoints_come_back_as_they_were() {
        for (text, is_loopback) in [
            ("tcp/127.0.0.1:7447", true),
            ("tcp/127.8.8.8:1", true),
            ("tcp/localhost:7447", true),
            ("tls/[::1]:65535", true),
            ("tcp/0.0.0.0:7447", false),
            ("tcp/[::]:7447", false),
            ("tls/192.168.1.7:7447", false),
            ("tls/lab-3.example.org:7447", false),
            ("tcp/localhost.example.org:7447", false),
            ("tcp/[::ffff:10.0.0.1]:7447", false),
        ] {
            let endpoint = Endpoint::parse(text).unwrap();
            assert_eq!(endpoint.to_string(), text);
            assert_eq!(endpoint.is_loopback(), is_loopback, "{text}");
        }
    }

    #[test]
    fn whatever_else_is_refused_with_what_was_expected() {
        for text in [
            "",
            "127.0.0.1:7447",
            "udp/127.0.0.1:7447",
            "tcp/127.0.0.1",
            "tcp/127.0.0.1:0",
            "tcp/127.0.0.1:70000",
            "tcp/:7447",
            "tcp/::1:7447",
            "tcp/[127.0.0.1]:7447",
            "tcp/[x]:7447",
            "tcp/127.0.0.1:7447#iface=eth0",
            "tls/a:1?rel=0",
            "tls/a#root_ca_certificate=/x:1",
        ] {
            let refused = Endpoint::parse(text).unwrap_err();
            assert!(refused.contains("expected tcp/<host>:<port>") && refused.contains(text), "{refused}");
        }
    }
}
