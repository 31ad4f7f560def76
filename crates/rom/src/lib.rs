//! softtwin: rom.
