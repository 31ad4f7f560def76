//! Typed ports: one writer and one reader type per kind of topic.

mod any;
mod exhausted;
mod field;
mod query;
pub(crate) mod retry;
pub(crate) mod segment;
pub(crate) mod service;
mod sized;
mod writer_lock;

pub use any::{AnyReader, AnySample, Stamp};
pub use field::{FieldLoan, FieldReader, FieldSample, FieldWriter};
pub use query::{AnswerSample, QueryClient, QueryServer, Question};
pub use sized::{
    CommandReader, CommandWriter, EstimateReader, EstimateWriter, GraspReader, GraspWriter, HealthReader,
    HealthWriter, Reader, SensorReader, SensorWriter, SetpointReader, SetpointWriter, StateReader,
    StateWriter, ValveReader, ValveWriter, Writer,
};
