//! Answers to questions, for people and scripts; not recorded, but of the same form.

use serde::Serialize;
use wire::Answer;
use wire::layout::{flags, hex, query_kind, regime, unpack_name};

use super::number;

/// An answer as JSON. Fields as in [`Answer`]; `refusal` says why there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct AnswerMessage {
    pub kind: &'static str,
    pub refusal: Option<String>,
    #[serde(serialize_with = "number::serialize")]
    pub limit: f64,
    #[serde(serialize_with = "number::serialize")]
    pub pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub gap_mm: f64,
    pub regime: &'static str,
    #[serde(serialize_with = "number::serialize")]
    pub contact_force_n: f64,
    #[serde(serialize_with = "number::single::serialize")]
    pub force_halfwidth_n: f32,
    #[serde(serialize_with = "number::serialize")]
    pub force_by_pressure_n_per_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub force_by_gap_n_per_mm: f64,
    #[serde(serialize_with = "number::serialize")]
    pub onset_pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub uncertainty: f64,
    #[serde(serialize_with = "number::serialize")]
    pub low: f64,
    #[serde(serialize_with = "number::serialize")]
    pub high: f64,
    #[serde(serialize_with = "number::single::serialize")]
    pub displacement_halfwidth_mm: f32,
    #[serde(serialize_with = "number::single::serialize")]
    pub von_mises_halfwidth_mpa: f32,
    #[serde(serialize_with = "number::single::serialize")]
    pub domain_distance: f32,
    pub domain_status: u32,
    pub flags: Vec<&'static str>,
    pub coefficients: Vec<f32>,
    pub compute_ns: u64,
    pub actuator: String,
    pub model_hash: String,
}

impl From<&Answer> for AnswerMessage {
    fn from(answer: &Answer) -> Self {
        Self {
            kind: query_kind::as_str(answer.kind),
            refusal: answer.refusal(),
            limit: answer.limit,
            pressure_mpa: answer.pressure_mpa,
            gap_mm: answer.gap_mm,
            regime: regime::as_str(answer.regime),
            contact_force_n: answer.contact_force_n,
            force_halfwidth_n: answer.force_halfwidth_n,
            force_by_pressure_n_per_mpa: answer.force_by_pressure_n_per_mpa,
            force_by_gap_n_per_mm: answer.force_by_gap_n_per_mm,
            onset_pressure_mpa: answer.onset_pressure_mpa,
            uncertainty: answer.uncertainty,
            low: answer.low,
            high: answer.high,
            displacement_halfwidth_mm: answer.displacement_halfwidth_mm,
            von_mises_halfwidth_mpa: answer.von_mises_halfwidth_mpa,
            domain_distance: answer.domain_distance,
            domain_status: answer.domain_status,
            flags: flags::names(answer.flags).collect(),
            coefficients: answer.coefficients().to_vec(),
            compute_ns: answer.compute_ns,
            actuator: unpack_name(&answer.actuator),
            model_hash: hex(&answer.model_hash),
        }
    }
}
