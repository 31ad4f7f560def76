//! HTTP client for the metrics endpoints.

use crate::PATIENCE;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

/// Unused address of this machine.
///
/// # Panics
/// If no port is free.
pub fn free_address() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("an address").to_string()
}

/// Response to a request for a path.
///
/// # Panics
/// If there is no response.
pub fn get(address: &str, path: &str) -> String {
    get_as(address, address, path)
}

/// As [`get`], with this `Host`.
///
/// # Panics
/// As [`get`].
pub fn get_as(host: &str, address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).expect("a page");
    stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").expect("asked");
    let mut reply = String::new();
    stream.read_to_string(&mut reply).expect("an answer");
    reply
}

/// Value of a metric, named with its labels as in the exposition format; `None` if it is absent.
///
/// # Panics
/// If there is no response or the value is not a number.
pub fn metric(address: &str, sample: &str) -> Option<f64> {
    let page = get(address, "/metrics");
    assert!(page.starts_with("HTTP/1.1 200 OK"), "{page}");
    let value = page.lines().find_map(|line| {
        let rest = line.strip_prefix(sample)?;
        rest.strip_prefix("{}").unwrap_or(rest).strip_prefix(' ')
    });
    value.map(|value| value.parse().expect("a number"))
}
