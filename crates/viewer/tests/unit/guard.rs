//! Tests of `src/guard.rs`.

use super::*;

fn asked(guard: &Guard, uri: &str, headers: &[(&'static str, &'static str)]) -> bool {
    let mut map = HeaderMap::new();
    for (name, value) in headers {
        map.insert(*name, value.parse().expect("header"));
    }
    guard.check(&uri.parse().expect("uri"), &map).is_ok()
}

#[test]
fn loopback_refuses_other_hosts_and_origins() {
    let guard = Guard::new("127.0.0.1".parse().expect("address"), None).expect("no token needed");
    for host in ["localhost:7411", "127.0.0.1:7411", "[::1]:7411", "localhost"] {
        assert!(asked(&guard, "/", &[("host", host)]), "{host}");
    }
    assert!(asked(&guard, "/ws", &[("host", "localhost:1"), ("origin", "http://localhost:1")]));
    for headers in [
        vec![("host", "evil.example")],
        vec![("host", "127.0.0.1.evil.example:7411")],
        vec![("host", "localhost:1"), ("origin", "http://evil.example")],
        vec![("host", "localhost:1"), ("origin", "http://localhost:2")],
        vec![],
    ] {
        assert!(!asked(&guard, "/ws", &headers), "{headers:?}");
    }
}

#[test]
fn other_addresses_require_the_token_in_url_or_cookie() {
    let guard = Guard::new("0.0.0.0".parse().expect("address"), None).expect("random bytes");
    let token = guard.token().expect("not loopback").to_owned();
    assert_eq!(token.len(), 32);
    assert_ne!(
        Guard::new("0.0.0.0".parse().expect("address"), None).expect("random bytes").token(),
        Some(token.as_str())
    );
    let guard = Guard::Token("abc".into());
    assert!(asked(&guard, "/?x=1&token=abc", &[("host", "10.0.0.7:7411")]));
    assert!(asked(&guard, "/ws", &[("host", "10.0.0.7"), ("cookie", "a=b; softtwin_token=abc")]));
    for (uri, cookie) in
        [("/", "a=b"), ("/?token=", "a=b"), ("/?token=abcd", "a=b"), ("/", "softtwin_token=abd")]
    {
        assert!(!asked(&guard, uri, &[("host", "10.0.0.7"), ("cookie", cookie)]), "{uri} {cookie}");
    }
}
