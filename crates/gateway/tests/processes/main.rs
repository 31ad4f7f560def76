//! Multi-process tests: twins, gateways and a plain Zenoh client.

mod closed;
mod common;
mod inward;
mod killed;
mod outward;
mod reloaded;
mod watched;
