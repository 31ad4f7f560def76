//! Pages stay in reach whatever other connections do.

use runtime::http::{HEADER_TIMEOUT, MAX_CONNECTIONS};
use runtime::metrics;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Runs `visit` beside a server of a page that says `hello`.
fn beside_server(visit: impl FnOnce(SocketAddr)) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| metrics::serve(listener, &done, || "hello".into()).unwrap());
        let end = EndOnDrop(&done);
        visit(address);
        drop(end);
    });
}

struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Requests `/metrics` and returns the duration.
fn visit(address: SocketAddr) -> Duration {
    let begin = Instant::now();
    let mut client = TcpStream::connect(address).unwrap();
    client.set_read_timeout(Some(20 * HEADER_TIMEOUT)).unwrap();
    client.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    client.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("hello"), "{answer}");
    begin.elapsed()
}

#[test]
fn head_answers_as_get_without_the_content() {
    beside_server(|address| {
        let mut client = TcpStream::connect(address).unwrap();
        client.set_read_timeout(Some(20 * HEADER_TIMEOUT)).unwrap();
        client.write_all(b"HEAD /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("content-length: 5"), "{answer}");
        assert!(answer.ends_with("\r\n\r\n"), "{answer}");
    });
}

/// Served in turns of [`MAX_CONNECTIONS`], 448 idle connections would delay a client by 14 s.
#[test]
fn idle_connections_delay_no_client() {
    beside_server(|address| {
        let idle: Vec<TcpStream> =
            (0..7 * MAX_CONNECTIONS).map(|_| TcpStream::connect(address).unwrap()).collect();
        let time = visit(address);
        assert!(time < HEADER_TIMEOUT, "{time:?} beside {} idle connections", idle.len());
    });
}

/// Connections that send half of a head are as idle.
#[test]
fn incomplete_requests_delay_no_client() {
    beside_server(|address| {
        let begin_request = |_| {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: loc").unwrap();
            stream
        };
        let half: Vec<TcpStream> = (0..3 * MAX_CONNECTIONS).map(begin_request).collect();
        let time = visit(address);
        assert!(time < HEADER_TIMEOUT, "{time:?} beside {} half requests", half.len());
    });
}

/// Connections that are kept after an answer take no place from others.
#[test]
fn kept_connections_are_closed_for_others() {
    beside_server(|address| {
        let ask = |_| {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
            let mut first = [0];
            stream.read_exact(&mut first).unwrap();
            stream
        };
        let kept: Vec<TcpStream> = (0..MAX_CONNECTIONS).map(ask).collect();
        let time = visit(address);
        assert!(time < 2 * HEADER_TIMEOUT, "{time:?} beside {} kept connections", kept.len());
    });
}
