//! softtwin: runtime.
