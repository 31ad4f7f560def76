//! Tests of the C API: its header, and programs that are compiled against it.

mod header;
mod live;
