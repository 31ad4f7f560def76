//! The C face: its header, and programs that are compiled against it. One program: linked once, and its tests run beside each other.

mod header;
mod live;
