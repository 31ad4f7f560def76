//! Ports, key expressions and leftovers of programs. One program, which is linked once and runs its tests in parallel.

mod arrivals;
mod keyexpr;
mod leftovers;
mod ports;
mod threads;
