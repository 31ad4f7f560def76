//! Sources, sensors and the services next to the loop. One program, which is linked once and runs its tests in parallel.

mod http;
mod mixed;
mod plants;
mod recorded;
mod sensors;
mod sources;
