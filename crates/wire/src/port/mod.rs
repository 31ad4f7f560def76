//! Typed ports: one writer and one reader type per kind of topic.

mod any;
mod exhausted;
mod query;
pub(crate) mod retry;
pub(crate) mod segment;
pub(crate) mod service;
mod topic;
mod writer_lock;

pub use any::{AnyReader, AnySample, Stamp};
pub use query::{AnswerSample, QueryClient, QueryServer, Question};
pub use topic::{
    Carried, CommandReader, CommandWriter, EstimateReader, EstimateWriter, FieldLoan, FieldReader,
    FieldSample, FieldWriter, GraspReader, GraspWriter, HealthReader, HealthWriter, Reader, SensorReader,
    SensorWriter, SetpointReader, SetpointWriter, StateReader, StateWriter, TargetReader, TargetWriter,
    ValveReader, ValveWriter, Writer,
};
