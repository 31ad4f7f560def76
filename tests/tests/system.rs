//! Multi-process tests, each in its own shared-memory domain. All are one program, which is linked once and runs them in parallel.

mod architecture;
mod clients;
mod control;
mod daemons;
mod documents;
mod estimate;
mod faults;
mod given;
mod gripper;
mod hostile;
mod kills;
mod live;
mod memory;
mod parameters;
mod queries;
mod realtime;
mod recording;
mod replace;
mod scenes;
mod sensors;
mod service;
mod setup;
mod sharing;
mod structure;
mod tool;
mod watchdog;
