//! Typed ports: one writer and one reader type per kind of topic.

pub(crate) mod memory;
mod query;
pub(crate) mod retry;
pub(crate) mod service;
mod topic;

pub use query::{AnswerSample, Asked, QueryClient, QueryServer, Question};
pub use topic::{
    AnyReader, AnySample, CommandReader, CommandWriter, EstimateReader, EstimateWriter, FieldLoan,
    FieldReader, FieldSample, FieldWriter, GraspReader, GraspWriter, HealthReader, HealthWriter, Reader,
    SensorReader, SensorWriter, SetpointReader, SetpointWriter, Stamp, StateReader, StateWriter,
    TargetReader, TargetWriter, TopicContent, ValveReader, ValveWriter, Writer,
};
