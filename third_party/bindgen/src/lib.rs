//! Substitute for the crate `bindgen` in this workspace. Two crates of iceoryx2 0.10 name bindgen as a build dependency and
//! call it on QNX only; compiling it with its parsers costs more than a minute and asks for libclang.
