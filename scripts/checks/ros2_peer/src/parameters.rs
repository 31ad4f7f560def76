//! Parameters, by hiroz' own parameter client.

use crate::graph::NODE;
use crate::stage::{Seen, Stage, ensure, until};
use hiroz::parameter::{Parameter, ParameterClient, ParameterTarget, ParameterType, ParameterValue};

const NAMES: [&str; 6] =
    ["actuators", "field_rate_hz", "finger.model", "finger.inputs", "finger.range.pressure_mpa", "nothing"];

/// Listed, read, described and not set.
pub fn all(stage: &Stage) -> Seen {
    let client = ParameterClient::new(stage.node.clone(), ParameterTarget::new("/", NODE))?;
    let none: [&str; 0] = [];
    let listed = until(|| {
        let listed = stage.block_on(client.list(&none, None))?;
        let is_there = |name: &&str| listed.names.iter().any(|one| one == name);
        let missing: Vec<_> = NAMES[..5].iter().filter(|name| !is_there(name)).collect();
        ensure(missing.is_empty(), || format!("expected {missing:?} among {:?}", listed.names))?;
        Ok(listed)
    })?;
    let below = until(|| stage.block_on(client.list(&["finger.range"], Some(1))))?;
    ensure(below.names.len() == 2, || format!("expected two ranges, found {:?}", below.names))?;
    let values = until(|| stage.block_on(client.get(&NAMES)))?;
    let [
        ParameterValue::StringArray(actuators),
        ParameterValue::Double(rate_hz),
        model,
        inputs,
        range,
        ParameterValue::NotSet,
    ] = &values[..]
    else {
        return Err(format!("found {values:?}").into());
    };
    let mut actuators = actuators.clone();
    actuators.sort();
    ensure(actuators == ["fed", "finger"] && *rate_hz == 30.0, || format!("found {actuators:?} {rate_hz}"))?;
    ensure(*model == ParameterValue::String("pneunet".into()), || format!("found {model:?}"))?;
    let expected = ["pressure_mpa", "gap_mm"].map(String::from).to_vec();
    ensure(*inputs == ParameterValue::StringArray(expected), || format!("found {inputs:?}"))?;
    ensure(*range == ParameterValue::DoubleArray(vec![0.0, 0.09]), || format!("found {range:?}"))?;
    let types = until(|| stage.block_on(client.get_types(&NAMES)))?;
    let said: Vec<ParameterType> = values.iter().map(ParameterValue::parameter_type).collect();
    ensure(types == said, || format!("expected {said:?}, found {types:?}"))?;
    let described = until(|| stage.block_on(client.describe(&["finger.input.pressure_mpa"])))?;
    let is_described =
        described.len() == 1 && described[0].read_only && described[0].type_ == ParameterType::Double;
    ensure(is_described, || format!("found {described:?}"))?;
    let wanted = [Parameter::new("field_rate_hz", ParameterValue::Double(5.0))];
    let result = until(|| stage.block_on(client.set(&wanted)))?;
    ensure(result.len() == 1 && !result[0].successful && result[0].reason == "read only", || {
        format!("found {result:?}")
    })?;
    let result = until(|| stage.block_on(client.set_atomically(&wanted)))?;
    ensure(!result.successful && result.reason == "read only", || format!("found {result:?}"))?;
    Ok(format!("{} listed, read and described, none is set: {}", listed.names.len(), result.reason))
}
