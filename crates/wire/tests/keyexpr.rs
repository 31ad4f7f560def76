//! Key expressions against Zenoh's published rules, its implementation, and a brute-force oracle.

use proptest::prelude::*;
use wire::{KeyExpr, KeyExprError};
use zenoh_keyexpr::OwnedKeyExpr;

fn key(text: &str) -> KeyExpr {
    KeyExpr::new(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

#[test]
fn matches_by_zenohs_rules() {
    for (expression, name, expected) in [
        ("softtwin/finger/field", "softtwin/finger/field", true),
        ("softtwin/*/state", "softtwin/finger/state", true),
        ("softtwin/*/state", "softtwin/a/b/state", false),
        ("softtwin/*", "softtwin", false),
        ("softtwin/**", "softtwin", true),
        ("softtwin/**", "softtwin/finger/field/tip", true),
        ("**", "softtwin/finger/field", true),
        ("**/tip", "softtwin/finger/field/tip", true),
        ("softtwin/**/tip", "softtwin/tip", true),
        ("softtwin/f$*/state", "softtwin/finger/state", true),
        ("softtwin/f$*r/state", "softtwin/fr/state", true),
        ("softtwin/f$*x/state", "softtwin/finger/state", false),
        ("softtwin/$*2/state", "softtwin/finger2/state", true),
        ("softtwin/*/state", "softtwin/@admin/state", false),
        ("softtwin/**", "softtwin/@admin/state", false),
        ("softtwin/@admin/*", "softtwin/@admin/state", true),
        ("softtwin/$*/state", "softtwin/@admin/state", false),
    ] {
        assert_eq!(key(expression).matches(name), expected, "{expression} against {name}");
    }
}

#[test]
fn spelling_does_not_matter() {
    for (given, canonical) in [
        ("a/**/**/b", "a/**/b"),
        ("a/**/*", "a/*/**"),
        ("a/**/*/**/*", "a/*/*/**"),
        ("a/$*", "a/*"),
        ("a/b$*$*c", "a/b$*c"),
        ("a/$*$*", "a/*"),
        ("**/$*/a", "*/**/a"),
    ] {
        for name in ["a", "a/b", "a/bc", "a/bac", "b/a", "b/c/a", "a/b/c", "a/b/c/b", "a/@b", "a/@b/b"] {
            assert_eq!(key(given).matches(name), key(canonical).matches(name), "{given} against {name}");
        }
    }
}

#[test]
fn refuses_with_the_place() {
    assert_eq!(KeyExpr::new(""), Err(KeyExprError::Empty));
    assert_eq!(KeyExpr::new("a//b"), Err(KeyExprError::EmptyChunk { text: "a//b".into(), at: 2 }));
    assert_eq!(KeyExpr::new("/a"), Err(KeyExprError::EmptyChunk { text: "/a".into(), at: 0 }));
    assert_eq!(KeyExpr::new("a/"), Err(KeyExprError::EmptyChunk { text: "a/".into(), at: 2 }));
    assert_eq!(KeyExpr::new("a/b?"), Err(KeyExprError::Reserved { text: "a/b?".into(), at: 3, found: '?' }));
    assert_eq!(KeyExpr::new("a/$b"), Err(KeyExprError::Reserved { text: "a/$b".into(), at: 2, found: '$' }));
    assert_eq!(
        KeyExpr::new("a/b*"),
        Err(KeyExprError::StarInChunk { text: "a/b*".into(), chunk: "b*".into() })
    );
    assert_eq!(
        KeyExpr::new("***"),
        Err(KeyExprError::StarInChunk { text: "***".into(), chunk: "***".into() })
    );
    assert!(matches!(KeyExpr::new(&"a".repeat(256)), Err(KeyExprError::TooLong { found: 256 })));
}

/// Does the expression match the key? Written straight from the definition, exponential, obviously right.
fn oracle(expression: &[&str], name: &[&str]) -> bool {
    match (expression, name) {
        ([], []) => true,
        (["**", rest @ ..], _) => {
            oracle(rest, name)
                || matches!(name, [first, tail @ ..] if !first.starts_with('@') && oracle(expression, tail))
        }
        ([chunk, rest @ ..], [first, tail @ ..]) => chunk_oracle(chunk, first) && oracle(rest, tail),
        _ => false,
    }
}

fn chunk_oracle(chunk: &str, text: &str) -> bool {
    if chunk.starts_with('@') || text.starts_with('@') {
        return chunk == text;
    }
    fn bytes(pattern: &str, text: &str) -> bool {
        if let Some(rest) = pattern.strip_prefix("$*") {
            return (0..=text.len()).any(|at| bytes(rest, &text[at..]));
        }
        match (pattern.chars().next(), text.chars().next()) {
            (None, None) => true,
            (Some(p), Some(t)) => p == t && bytes(&pattern[1..], &text[1..]),
            _ => false,
        }
    }
    chunk == "*" || bytes(chunk, text)
}

const CHUNKS: [&str; 7] = ["a", "b", "aa", "ab", "ba", "bb", "@a"];

fn expression() -> impl Strategy<Value = String> {
    let chunk =
        prop::sample::select(vec!["a", "b", "ab", "@a", "*", "**", "$*a", "a$*", "b$*", "$*b", "$*", "a$*b"]);
    prop::collection::vec(chunk, 1..=3).prop_map(|chunks| chunks.join("/"))
}

/// Expressions, and strings that are almost expressions.
fn near_expression() -> impl Strategy<Value = String> {
    let chunk = prop::sample::select(vec![
        "a", "ab", "b", "@a", "@", "@$*", "@*", "*", "**", "$*a", "a$*", "$*", "$*$*", "a$*b", "a$*$*b",
        "a*", "*a", "***", "a#", "a?", "$", "$a", "a$", "$$*", "ä", "ä$*", "", " ",
    ]);
    let likely = prop_oneof![9 => expression(), 2 => prop::collection::vec(chunk, 0..=4).prop_map(|chunks| chunks.join("/"))];
    prop_oneof![9 => likely, 1 => "[ab@*$/#?]{0,12}"]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn matches_what_the_brute_force_oracle_matches(text in expression(), choice in prop::collection::vec(0..7usize, 1..=4)) {
        let name: Vec<&str> = choice.iter().map(|index| CHUNKS[*index]).collect();
        let chunks: Vec<&str> = text.split('/').collect();
        prop_assert_eq!(key(&text).matches(&name.join("/")), oracle(&chunks, &name));
    }

    /// Zenoh's implementation accepts the same strings and matches the same names.
    #[test]
    fn zenoh_agrees(text in near_expression(), choice in prop::collection::vec(0..7usize, 1..=4)) {
        // Zenoh 1.10.2 panics when it brings `a$*$*b` to canonical form.
        prop_assume!(!text.contains("$*$*"));
        let name = choice.iter().map(|index| CHUNKS[*index]).collect::<Vec<_>>().join("/");
        let (ours, zenohs) = (KeyExpr::new(&text), OwnedKeyExpr::autocanonize(text.clone()));
        prop_assert_eq!(ours.is_ok(), zenohs.is_ok(), "{}: {:?} and {:?}", text, ours, zenohs);
        if let (Ok(ours), Ok(zenohs)) = (ours, zenohs) {
            let plain = OwnedKeyExpr::new(name.as_str()).expect("plain");
            prop_assert_eq!(ours.matches(&name), zenohs.includes(&plain), "{} over {}", text, name);
        }
    }

    #[test]
    fn any_text_is_answered_without_panic(text in ".{0,300}") {
        if let Ok(expression) = KeyExpr::new(&text) {
            prop_assert!(expression.matches(&text) || text.contains('*'), "{}", text);
        }
    }
}
