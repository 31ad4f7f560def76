//! Sources, sensors and the services beside the loop. One program: linked once, and its tests run beside each other.

mod http;
mod mixed;
mod recorded;
mod sensors;
mod sources;
