//! Tests of `src/config.rs`.

use super::{TrainConfig, parse};

#[test]
fn omitted_kernels_are_those_of_the_regime() {
    let config = parse("[free]\nmax_modes = 9\n[contact]\nmax_modes = 8\n").unwrap();
    let default = TrainConfig::default();
    assert_ne!(default.free.kernels, default.contact.kernels);
    assert_eq!((config.free.kernels, config.free.max_modes), (default.free.kernels, 9));
    assert_eq!((config.contact.kernels, config.contact.max_modes), (default.contact.kernels, 8));
    let named = parse("[free]\nkernels = [{ kernel = \"cubic\", tail = \"linear\" }]\n").unwrap();
    assert_eq!(named.free.kernels.len(), 1);
}
