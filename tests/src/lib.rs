//! Multi-process stories of softtwin.
