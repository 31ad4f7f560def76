//! Ports, key expressions and what programs leave behind. One program: linked once, and its tests run beside each other.

mod keyexpr;
mod leftovers;
mod ports;
mod threads;
