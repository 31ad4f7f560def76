//! Stories of several processes, each in a shared-memory domain of its own. One program: linked once, and its tests run beside each other.

mod clients;
mod control;
mod daemons;
mod estimate;
mod expecting;
mod faults;
mod given;
mod gripper;
mod hostile;
mod house;
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
