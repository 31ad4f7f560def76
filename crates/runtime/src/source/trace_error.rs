//! What is wrong with a trace.

/// Largest accepted file: a day at 200 Hz is 430 MB, and that belongs into a recording.
pub const MAX_BYTES: u64 = 1 << 29;

/// What is wrong with a trace.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// The file could not be read.
    #[error("cannot read the trace: {cause}")]
    Unreadable {
        /// The system's message.
        cause: String,
    },
    /// No header or no rows.
    #[error(
        "the trace has no {what}; expected the header `t_s,pressure_mpa,gap_mm` and at least one row, or a recording with readings"
    )]
    Empty {
        /// `header`, `rows` or `readings`.
        what: &'static str,
    },
    /// A required column is missing.
    #[error("line {line}: the column `{column}` is missing; expected `{expected}`, found `{found}`")]
    MissingColumn {
        /// Line of the header.
        line: usize,
        /// The column.
        column: String,
        /// A header that would do.
        expected: String,
        /// The header as found.
        found: String,
    },
    /// A cell that is no number.
    #[error("line {line}, column `{column}`: expected a number, found `{found}`")]
    NotANumber {
        /// Line.
        line: usize,
        /// Column.
        column: String,
        /// The text.
        found: String,
    },
    /// A message of a recording that is no reading.
    #[error("reading {number} of the recording cannot be read: {cause}")]
    NotAReading {
        /// Which reading, from 1.
        number: usize,
        /// What is wrong with it.
        cause: String,
    },
    /// A recording of several actuators.
    #[error("the recording has several sensors ({found}); choose one with `topic`")]
    SeveralTopics {
        /// Their topics.
        found: String,
    },
    /// The topic that was asked for is not there.
    #[error("the recording has no readings on `{topic}`; found: {found}")]
    NoSuchTopic {
        /// Asked for.
        topic: String,
        /// What there is.
        found: String,
    },
    /// More than fits into memory.
    #[error(
        "the recording has more than {limit} readings; record with --rotate-minutes and replay the part you need"
    )]
    TooManyRows {
        /// The limit.
        limit: usize,
    },
    /// Time is not finite or runs backwards.
    #[error("line {line}: time goes from {before} s to {found} s; expected rows in order of time")]
    TimeOrder {
        /// Line.
        line: usize,
        /// Time of the row above.
        before: f64,
        /// Time found.
        found: f64,
    },
}
