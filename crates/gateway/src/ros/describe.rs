//! `softtwin/<actuator>/describe` (`std_srvs/Trigger`): model, input ranges and newest state of a twin, as JSON.

use super::cdr::{Cdr, Reader};
use super::config::Ros2;
use recording::message::Json;
use runtime::known_model::{KnownInput, KnownModel};
use serde_json::{Value, json};
use wire::{Payload, State};

/// The answer to a request: model, its inputs with their ranges, and the newest state as on the key `softtwin/<actuator>/state`;
/// without a state the reason. `None` if the request is malformed.
pub fn answer(request: &[u8], ros: &Ros2, actuator: &str, state: Option<&State>) -> Option<Vec<u8>> {
    Reader::new(request)?;
    Some(match state {
        Some(state) => response(true, &described(ros, actuator, state).to_string()),
        None => response(
            false,
            &format!("no state of {actuator}; is its twin running, and does it get readings?"),
        ),
    })
}

/// A `Trigger_Response`.
fn response(is_success: bool, message: &str) -> Vec<u8> {
    Cdr::new().byte(u8::from(is_success)).string(message).finish()
}

fn described(ros: &Ros2, actuator: &str, state: &State) -> Value {
    let model = ros.models.iter().find(|model| model.hash == state.model_hash).map(of_model);
    // Numbers and strings only: serialisation cannot fail.
    let state = serde_json::to_value(Json::new(state.view())).unwrap_or_default();
    json!({ "actuator": actuator, "model": model, "state": state })
}

fn of_model(model: &KnownModel) -> Value {
    let input = |input: &KnownInput| json!({ "name": input.key, "unit": input.unit, "range": input.range });
    json!({ "name": model.name, "inputs": model.inputs.iter().map(input).collect::<Vec<Value>>() })
}

#[cfg(test)]
#[path = "../../tests/unit/describe.rs"]
mod tests;
