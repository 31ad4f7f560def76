//! softtwind.
fn main() {}
