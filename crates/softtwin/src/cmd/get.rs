//! `softtwin get`.

use crate::failure::usage;
use crate::live::{self, DomainArgs};
use crate::output;
use anyhow::Context;
use formats::npy;
use recording::message;
use rom::inputs::nearest_name;
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;
use wire::layout::{field_id, unpack_name};
use wire::{Answer, AnswerSample, Bus, KeyExpr, Query, QueryClient, QueryStatus, Selector, TopicKind};

const EXAMPLES: &str = "\
Examples:
  A twin must be running for all that follows
    softtwind twin --scene config/scenes/finger.toml
  What if: state and force at a pressure and a gap that the sensors do not show
    softtwin get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30'
  With the whole field, as an array of fields x nodes (x, y, z, displacement, von Mises), float32
    softtwin get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30;field=all' \\
      --out state.npy
  With other values of the model's parameters than the scene's (by their names in `softtwin inspect MODEL`)
    softtwin get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30;elastomer.law.mu_mpa=0.7'
  Of a model of other inputs: those by name; a pressure is asked for only where the model depends on one
    softtwin get 'softtwin/part/whatif?load_n=2.6;thickness_mm=7.3'
  The inverse: which pressure gives 0.3 N at a gap of 30 mm
    softtwin get 'softtwin/finger/pressure?force_n=0.3;gap_mm=30'
  The gap that explains 0.3 N (known to 5 mN) at 0.05 MPa, with its uncertainty
    softtwin get 'softtwin/finger/gap?pressure_mpa=0.05;force_n=0.3;force_halfwidth_n=0.005'
  Every twin in shared memory
    softtwin get 'softtwin/*/whatif?pressure_mpa=0.05;gap_mm=30' --json

The twin answers in a thread apart from its real-time loop. When there is no answer (the force is out of reach, for example) \
the reason is printed and the exit code is 1.";

/// Ask a running twin: what if, which pressure, which gap.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Selector: softtwin/<actuator>/whatif|pressure|gap?name=value;... with pressure_mpa, gap_mm, force_n, force_halfwidth_n, field, parameters.
    #[arg(value_name = "SELECTOR")]
    selector: String,
    /// File for the field (.npy), with `field=...` in the selector.
    #[arg(long, value_name = "FILE.npy")]
    out: Option<PathBuf>,
    /// Longest wait for an answer, in ms (1 to 3600000).
    #[arg(long, value_name = "MS", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=3_600_000))]
    timeout_ms: u64,
    /// One JSON object per line and answer.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Sends the questions and prints every answer.
    pub fn run(self) -> anyhow::Result<()> {
        let selector = Selector::parse(&self.selector).map_err(usage)?;
        let bus = self.domain.join()?;
        let actuators = actuators(&bus, &selector)?;
        let questions: Vec<(String, Query)> = actuators
            .iter()
            .flat_map(|actuator| {
                selector.questions(actuator).into_iter().map(|query| (actuator.clone(), query))
            })
            .collect();
        if self.out.is_some()
            && (questions.len() != 1 || questions.iter().any(|(_, query)| query.want_field == 0))
        {
            return Err(usage("--out: expected one question with field=<node set>"));
        }
        let mut refused = 0;
        for (actuator, query) in &questions {
            let mut client = QueryClient::open(&bus, actuator)?;
            let sample = client.ask(query, Duration::from_millis(self.timeout_ms))?;
            let answer = sample.answer();
            refused += usize::from(answer.refusal().is_some());
            if answer.refusal().is_none() && answer.domain_distance > 0.0 {
                let which = answer.outside().unwrap_or_else(|| "no trained state is near".into());
                tracing::warn!(
                    "outside the training range, so the answer has no half-widths: {which} ({:.1} % of the trained range away)",
                    100.0 * answer.domain_distance
                );
            }
            self.show(query, &sample)?;
        }
        anyhow::ensure!(refused == 0, "{refused} of {} questions have no answer, see above", questions.len());
        Ok(())
    }

    fn show(&self, query: &Query, sample: &AnswerSample) -> anyhow::Result<()> {
        let answer = sample.answer();
        if let (Some(out), None) = (&self.out, answer.refusal()) {
            let shape = [answer.field_count as usize, answer.node_count as usize];
            npy::write_f32(out, &shape, sample.values()).context("the field was not written")?;
        }
        if !self.json {
            return Ok(output!("{}{}", live::text::answer(answer), did_you_mean(query, answer))?);
        }
        let fields: Vec<&str> = answer.fields().map(field_id::as_str).collect();
        let mut value = message::answer(answer);
        if let Some(reason) = answer.refusal() {
            value["refusal"] = (reason + &did_you_mean(query, answer)).into();
        }
        if answer.entries() > 0 {
            value["field"] = json!({
                "node_set": unpack_name(&answer.node_set),
                "nodes": answer.node_count,
                "fields": fields,
                "max_von_mises_mpa": answer.max_von_mises_mpa,
                "max_von_mises_node": answer.max_von_mises_node,
            });
        }
        output::json(&value)
    }
}

/// For every parameter of a question that the model does not have, the name that it most likely stands for.
fn did_you_mean(query: &Query, answer: &Answer) -> String {
    if answer.status != QueryStatus::UnknownInput.code() {
        return String::new();
    }
    let inputs: Vec<String> = answer.inputs().map(|input| input.name).collect();
    let own = ["force_n", "force_halfwidth_n", "field"].map(str::to_owned);
    let known = [&inputs[..], &own].concat();
    let asked = query.parameters().map(|(name, _)| unpack_name(name));
    let hint = |name: String| {
        let nearest = nearest_name(&name, &known)?;
        Some(format!("; `{name}`: did you mean {nearest}?"))
    };
    asked.filter(|name| !inputs.contains(name)).filter_map(hint).collect()
}

/// The actuator named, or all that publish a state and match.
fn actuators(bus: &Bus, selector: &Selector) -> anyhow::Result<Vec<String>> {
    if let Some(actuator) = selector.actuator() {
        return Ok(vec![actuator.to_owned()]);
    }
    let found = bus.topics(&KeyExpr::new("softtwin/*/state")?)?;
    let names: Vec<String> = found
        .into_iter()
        .filter(|info| info.topic.kind() == TopicKind::State && !info.writers.is_empty())
        .map(|info| info.topic.actuator().to_owned())
        .filter(|name| !selector.questions(name).is_empty())
        .collect();
    anyhow::ensure!(
        !names.is_empty(),
        "no running twin matches `{}`; `softtwin list` shows what there is",
        selector.key()
    );
    Ok(names)
}
