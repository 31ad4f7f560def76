//! softtwin: formats.
