//! Tests of `src/cmd/echo.rs` that need its private parts.

use super::fold;

#[test]
fn long_line_is_broken_between_its_parts() {
    let line = "softtwin/finger/state  #12   P  0.05000 MPa  gap  40.00 mm  contact  F  0.2500 +- 0.0010 N  dF/dP 6.5000 N/MPa  age 0.12 ms";
    let folded = fold(line, 80);
    assert!(folded.lines().all(|line| line.chars().count() <= 80), "{folded}");
    assert!(folded.lines().skip(1).all(|line| line.starts_with("    ")), "{folded}");
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(words(&folded), words(line));
    assert_eq!(fold("short  line", 80), "short  line");
}
