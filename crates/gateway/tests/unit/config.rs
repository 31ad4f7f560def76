//! Tests of `src/config.rs` that need its private parts.

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
fn other_readings_are_refused_with_the_expected_form() {
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
        assert!(refused.contains(&format!("{text:?}")), "{refused}");
    }
}
