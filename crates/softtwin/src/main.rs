//! softtwin.
fn main() {}
