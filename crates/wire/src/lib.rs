//! softtwin: wire.
