//! The metrics pages, as a scraper sees them.

use crate::PATIENCE;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

/// An address of this machine that nobody listens on.
///
/// # Panics
/// When the system has none.
pub fn free_address() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("an address").to_string()
}

/// The whole answer to a request for a path.
///
/// # Panics
/// When nobody answers.
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

/// The value of a sample of the metrics page, named with its labels (if it has any) as on the page; none when the page has no such
/// sample.
///
/// # Panics
/// When nobody answers, or the value is no number.
pub fn metric(address: &str, sample: &str) -> Option<f64> {
    let page = get(address, "/metrics");
    assert!(page.starts_with("HTTP/1.1 200 OK"), "{page}");
    let value = page.lines().find_map(|line| {
        let rest = line.strip_prefix(sample)?;
        rest.strip_prefix("{}").unwrap_or(rest).strip_prefix(' ')
    });
    value.map(|value| value.parse().expect("a number"))
}
