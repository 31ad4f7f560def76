//! Services, called by hiroz' client.

use crate::ros::softtwin_interfaces::srv::{FindGap, FindPressure, WhatIf};
use crate::ros::softtwin_interfaces::{Answer, FindGapRequest, FindPressureRequest, WhatIfRequest};
use crate::stage::{Error, Seen, Stage, ensure, until};
use hiroz::Builder;
use hiroz_msgs::ros::std_srvs::TriggerRequest;
use hiroz_msgs::ros::std_srvs::srv::Trigger;
use serde_json::Value;

/// Inputs of the finger's model.
const INPUTS: [&str; 2] = ["pressure_mpa", "gap_mm"];
const PRESSURE_MPA: f64 = 0.05;
const GAP_MM: f64 = 30.0;
/// Tolerance of inverse queries.
const ROUNDED: f64 = 1e-6;

/// The description is JSON with model, inputs and a state.
pub fn describe(stage: &Stage) -> Seen {
    let client = stage.node.create_client::<Trigger>("/softtwin/finger/describe").build()?;
    let response = stage.call(&client, &TriggerRequest::default())?;
    ensure(response.success, || response.message.clone())?;
    let said: Value = serde_json::from_str(&response.message)?;
    let names: Vec<_> = said["model"]["inputs"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|input| input["name"].as_str())
        .collect();
    ensure(said["actuator"] == "finger" && said["model"]["name"] == "pneunet" && names == INPUTS, || {
        said.to_string()
    })?;
    // The state is one of those that echo writes.
    until(|| {
        let states = stage.samples("states.jsonl")?;
        ensure(states.iter().any(|state| state["seq"] == said["state"]["seq"]), || {
            "echo has no such state".into()
        })
    })?;
    Ok(format!("model {}, inputs {names:?}, state {}", said["model"]["name"], said["state"]["seq"]))
}

/// What-if answers are bit-identical to `softtwin get`; inverse queries lead back; refusals have a reason.
pub fn questions(stage: &Stage) -> Seen {
    let what_if = stage.node.create_client::<WhatIf>("/softtwin/finger/what_if").build()?;
    let asked = WhatIfRequest {
        pressure_mpa: PRESSURE_MPA,
        gap_mm: GAP_MM,
        node_set: "surface".into(),
        ..Default::default()
    };
    let response = stage.call(&what_if, &asked)?;
    ensure(response.success, || response.message.clone())?;
    let answer = response.answer;
    let said: Value = serde_json::from_str(&stage.text("whatif.json")?)?;
    same(&answer, &said)?;
    let values = answer.field_names.len() * answer.node_count as usize;
    let has_field = answer.node_count > 1000 && answer.field.len() == values;
    ensure(has_field && answer.field_names.last().is_some_and(|name| name == "von_mises"), || {
        format!("{:?}: {} values of {} nodes", answer.field_names, answer.field.len(), answer.node_count)
    })?;
    let stresses = answer.field.iter().rev().take(answer.node_count as usize);
    let largest_mpa = f64::from(stresses.copied().fold(0.0, f32::max));
    ensure(largest_mpa == answer.max_von_mises_mpa, || {
        format!("the field's largest stress is {largest_mpa} MPa, the answer's {}", answer.max_von_mises_mpa)
    })?;

    let force_n = answer.contact_force_n;
    let find_pressure = stage.node.create_client::<FindPressure>("/softtwin/finger/find_pressure").build()?;
    let asked = FindPressureRequest { force_n, gap_mm: GAP_MM, ..Default::default() };
    let found = stage.call(&find_pressure, &asked)?;
    let off = (found.answer.pressure_mpa - PRESSURE_MPA).abs();
    ensure(found.success && off < ROUNDED, || {
        format!("{} {} MPa", found.message, found.answer.pressure_mpa)
    })?;

    let find_gap = stage.node.create_client::<FindGap>("/softtwin/finger/find_gap").build()?;
    let asked = FindGapRequest { pressure_mpa: PRESSURE_MPA, force_n, ..Default::default() };
    let found = stage.call(&find_gap, &asked)?;
    let off = (found.answer.gap_mm - GAP_MM).abs();
    ensure(found.success && off < ROUNDED * GAP_MM, || {
        format!("{} {} mm", found.message, found.answer.gap_mm)
    })?;

    let asked = FindPressureRequest { force_n: 1000.0, gap_mm: GAP_MM, ..Default::default() };
    let refused = stage.call(&find_pressure, &asked)?;
    ensure(!refused.success && refused.message.contains("more force than"), || refused.message.clone())?;
    Ok(format!(
        "{force_n} N at {PRESSURE_MPA} MPa as `softtwin get`, {values} field values, 1000 N refused: {}",
        refused.message
    ))
}

/// The numbers of an answer are those of the JSON.
fn same(answer: &Answer, said: &Value) -> Result<(), Error> {
    let numbers = [
        ("pressure_mpa", answer.pressure_mpa),
        ("gap_mm", answer.gap_mm),
        ("contact_force_n", answer.contact_force_n),
        ("force_halfwidth_n", answer.force_halfwidth_n),
        ("onset_pressure_mpa", answer.onset_pressure_mpa),
        ("displacement_halfwidth_mm", answer.displacement_halfwidth_mm),
        ("von_mises_halfwidth_mpa", answer.von_mises_halfwidth_mpa),
        ("domain_distance", answer.domain_distance),
    ];
    for (name, number) in numbers {
        ensure(said[name].as_f64() == Some(number), || {
            format!("{name}: expected {}, found {number}", said[name])
        })?;
    }
    let is_same =
        said["model_hash"] == answer.model_hash.as_str() && said["regime"] == answer.regime.as_str();
    ensure(is_same && answer.input_names == INPUTS, || {
        format!("found {} {}", answer.regime, answer.model_hash)
    })
}
