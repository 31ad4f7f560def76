//! What became of a question: answered, or the reason why not, with the number that tells how far off it was.

use crate::layout::{Answer, query_kind};

macro_rules! verdicts {
    ($($(#[doc = $doc:literal])+ $name:ident = $code:literal, $text:literal;)+) => {
        /// The end of one question. The number is what travels in [`Answer::verdict`].
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[repr(u32)]
        pub enum QueryStatus { $($(#[doc = $doc])+ $name = $code,)+ }

        impl QueryStatus {
            /// All verdicts in the order of their numbers.
            pub const ALL: &'static [QueryStatus] = &[$(QueryStatus::$name,)+];

            /// The sentence for people; `{limit}` stands for [`Answer::limit`].
            fn template(self) -> &'static str {
                match self { $(QueryStatus::$name => $text,)+ }
            }

            /// The verdict of that number, if there is one.
            pub fn from_code(code: u32) -> Option<Self> {
                match code { $($code => Some(QueryStatus::$name),)+ _ => None }
            }
        }
    };
}

verdicts! {
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
}

impl QueryStatus {
    /// The number on the wire.
    pub fn code(self) -> u32 {
        self as u32
    }

    /// Why an answer is none, for people; `None`: it is one.
    pub(crate) fn refusal(answer: &Answer) -> Option<String> {
        match Self::from_code(answer.verdict) {
            Some(Self::Answered) => None,
            Some(verdict) => {
                let unit = match (verdict, answer.kind) {
                    (Self::OutsideDomain, query_kind::GAP) => " MPa",
                    (Self::OutsideDomain, _) => " mm",
                    _ => "",
                };
                Some(verdict.template().replace("{limit}", &format!("{:.6}{unit}", answer.limit)))
            }
            None => Some(format!("the twin refused for a reason of another version ({})", answer.verdict)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_refusal_has_its_sentence_with_its_number() {
        for verdict in QueryStatus::ALL {
            assert_eq!(QueryStatus::from_code(verdict.code()), Some(*verdict));
            let answer = Answer { verdict: verdict.code(), limit: 12.5, ..Answer::default() };
            let text = answer.refusal();
            assert_eq!(text.is_none(), *verdict == QueryStatus::Answered);
            let named = text.as_ref().is_some_and(|text| text.contains("12.5"));
            assert_eq!(named, verdict.template().contains("{limit}"), "{text:?}");
        }
        let foreign = Answer { verdict: 999, ..Answer::default() };
        assert!(foreign.refusal().is_some_and(|text| text.contains("999")));
    }
}
