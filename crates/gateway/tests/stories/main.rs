//! Stories with real processes: twins, gateways, and a far end that knows nothing of us.

mod closed;
mod common;
mod inward;
mod killed;
mod outward;
mod reloaded;
mod watched;
