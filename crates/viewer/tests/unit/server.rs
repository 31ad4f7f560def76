//! Tests of `src/server.rs`.

use super::*;
use crate::catalogue::Catalogue;
use crate::pictures::Picture;
use runtime::http::{HEADER_TIMEOUT, MAX_CONNECTIONS};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Instant;

/// Answer of a new server without models to a request, while `idle` other connections send nothing.
fn answer(request: &str, idle: usize, pictures: Vec<Picture>) -> String {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        let listener = open_port(Ipv4Addr::LOCALHOST.into(), 0).await.expect("a free port");
        let address = listener.local_addr().expect("bound");
        let catalogue = Catalogue::new(&[], crate::Stand::default()).expect("no models");
        let pictures = pictures.into();
        let shared = Shared { pictures, catalogue: Arc::new(catalogue), hub: Arc::default(), player: None };
        let request = request.to_owned();
        let visit = tokio::task::spawn_blocking(move || {
            let connect = |_| TcpStream::connect(address).expect("the port is open");
            let _silent: Vec<TcpStream> = (0..idle).map(connect).collect();
            let mut client = connect(0);
            client.set_read_timeout(Some(10 * HEADER_TIMEOUT)).expect("a time-out");
            client.write_all(request.as_bytes()).expect("sent");
            let mut answer = Vec::new();
            // A server that refuses may close the connection before all of the request is read.
            let _ = client.read_to_end(&mut answer);
            String::from_utf8_lossy(&answer).into_owned()
        });
        let mut answer = String::new();
        let visited = async { answer = visit.await.expect("no panic") };
        Server { listener, guard: Guard::Loopback, shared }.run(visited).await;
        answer
    })
}

#[test]
fn idle_connections_do_not_block_a_client() {
    let page = "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    let begin = Instant::now();
    let answer = answer(page, 7 * MAX_CONNECTIONS, Vec::new());
    // In turns it would be 14 s; making the connections takes time on a busy machine.
    assert!(begin.elapsed() < 3 * HEADER_TIMEOUT, "{:?}", begin.elapsed());
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("<title>softtwin view"), "{answer:.200}");
}

#[test]
fn too_large_request_is_refused() {
    let page = format!("GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: {}\r\n\r\n", "x".repeat(40_000));
    let answer = answer(&page, 0, Vec::new());
    assert!(answer.starts_with("HTTP/1.1 431"), "{answer:.200}");
}

#[test]
fn pictures_are_on_their_page() {
    let get = |path: &str| {
        let picture = Picture { title: "a < b".into(), kind: "image/svg+xml", content: "<svg/>".into() };
        let page = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        answer(&page, 0, vec![picture])
    };
    let page = get("/pictures");
    assert!(page.contains("a &lt; b") && page.contains("src=\"/pictures/0\""), "{page}");
    let picture = get("/pictures/0");
    assert!(picture.contains("image/svg+xml") && picture.ends_with("<svg/>"), "{picture}");
    assert!(get("/pictures/1").starts_with("HTTP/1.1 404"));
}
