#![doc = include_str!("../README.md")]
//!
//! # Parts
//!
//! A program that wants to talk to a twin needs four things:
//!
//! 1. a [`Bus`] in a [`Domain`] (programs in different domains do not see one another),
//! 2. a [`Topic`], such as `softtwin/<actuator>/sensor`; [`TopicKind`] lists the kinds,
//! 3. a typed port of this kind, such as [`SensorWriter`] and [`SensorReader`],
//! 4. a [`WakeSet`] to sleep until one of several readers has something.
//!
//! Questions that no topic answers go through a [`QueryClient`]; [`Selector`] is their text form.
//!
//! All payloads are plain `#[repr(C)]` data whose size and offsets are checked at compile time; the layout version is
//! part of the type name, so that programs of different layouts refuse each other instead of misreading bytes.

#![warn(missing_docs)] // the API that programs of others use: every public item says what it is, its units and its errors
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

mod arrivals;
mod bus;
mod domain;
mod error;
mod keyexpr;
pub mod layout;
mod leftover;
mod port;
pub mod qos;
mod selector;
mod sys;
pub mod thread_group;
mod topic;
mod wake;

pub use arrivals::{Arrival, Arrivals};
pub use bus::{Bus, TopicInfo};
pub use domain::{Domain, OwnFiles};
pub use error::WireError;
pub use keyexpr::{KeyExpr, KeyExprError};
pub use layout::{
    Answer, Command, Estimate, FieldHeader, Grasp, Health, Outcome, Payload, Query, QueryStatus,
    SensorSample, Setpoint, State, Target, Valve,
};
pub use leftover::{Removed, own_folder};
pub use port::{
    AnswerSample, AnyReader, AnySample, Asked, CommandReader, CommandWriter, EstimateReader, EstimateWriter,
    FieldLoan, FieldReader, FieldSample, FieldWriter, GraspReader, GraspWriter, HealthReader, HealthWriter,
    QueryClient, QueryServer, Question, Reader, SensorReader, SensorWriter, SetpointReader, SetpointWriter,
    Stamp, StateReader, StateWriter, TargetReader, TargetWriter, TopicContent, ValveReader, ValveWriter,
    Writer,
};
pub use selector::{Selector, SelectorError};
pub use sys::{background_thread, boot_id, now_ns};
pub use topic::{Topic, TopicKind};
pub use wake::{Wake, WakeSet, Wakeable, Waker, Waking};
