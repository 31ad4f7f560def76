//! Waiting that sleeps until shortly before the next sample is expected, and spins from then on, within a share of a core.
//!
//! | what | file |
//! | --- | --- |
//! | when the next sample of a source comes, from the last ones | `arrivals.rs` |
//! | from when until when to spin, and what is left of the share | `plan.rs` |
//! | the wait itself | `wait.rs` |

mod arrivals;
mod plan;
mod wait;

pub use plan::SpinCounts;
pub use wait::{SpinSources, SpinWait};
