//! softtwin: fem.
