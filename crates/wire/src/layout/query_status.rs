//! How a question ended: answered, or the reason why not, with the limit that was passed.

use super::codes::coded_enum;

coded_enum! {
    /// How one question ended; see [`super::Answer::status`]. The text is a sentence in which `{limit}` stands for [`super::Answer::limit`].
    QueryStatus {
        /// There is an answer.
        Answered = 0, "answered";
        /// A quantity that the question needs is missing, NaN or infinite.
        NotFinite = 1, "a quantity that this question needs is missing or not finite";
        /// The plate is out of reach at this gap; limit: the largest gap that can be reached, mm.
        OutOfReach = 2, "the plate is out of reach at this gap; the largest gap that can be reached is {limit} mm";
        /// More force than the sampled states give here; limit: the largest force, N.
        ForceTooHigh = 3, "more force than the sampled states give here: at most {limit} N";
        /// Less force than the sampled states give here; limit: the smallest force, N.
        ForceTooLow = 4, "less force than the sampled states give here: at least {limit} N";
        /// No force, so no contact: any gap from the limit on explains it; limit: that gap, mm.
        NoContact = 5, "without a force there is no contact: every gap from {limit} mm on explains it";
        /// No sampled state has this gap (or, when the gap is asked, this pressure); limit: the nearest that has one.
        OutsideDomain = 6, "no sampled state is there; the nearest sampled value is {limit}";
        /// The gap is no input of this model (all samples share one); limit: that gap, mm.
        GapIsFixed = 7, "the gap is no input of this model: all samples have {limit} mm";
        /// The twin offers no field of that name: the scene's `queries` or its outputs say no.
        NoSuchField = 8, "the twin offers no field of these nodes; see `queries` and the outputs of its scene";
        /// No shared memory for the field; limit: bytes needed.
        NoMemory = 9, "not enough shared memory for the field: {limit} bytes are needed in /dev/shm";
        /// The kind of question is unknown to this twin.
        UnknownKind = 10, "this twin does not know that kind of question";
        /// The model gave a value that is not finite.
        Model = 11, "the model gave no finite value";
        /// A parameter of the question is none of the model's.
        UnknownInput = 12, "a parameter of the question is no input of this model, which has {inputs}";
    }
}
