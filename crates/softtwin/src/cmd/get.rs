//! `softtwin get`.

use crate::failure::usage;
use crate::live::DomainArgs;
use crate::output;
use anyhow::Context;
use formats::npy;
use recording::message::AnswerMessage;
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;
use wire::layout::{field_id, flags, query_kind, regime, unpack_name};
use wire::{Answer, AnswerSample, Bus, KeyExpr, Query, QueryClient, Selector, TopicKind};

const EXAMPLES: &str = "\
Examples:
  A twin must be running for all that follows
    softtwind twin --scene config/scenes/finger.toml
  What if: state and force at a pressure and a gap that the sensors do not show
    softtwin get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30'
  With the whole field, as an array of fields x nodes (x, y, z, displacement, von Mises), float32
    softtwin get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30;field=all' --out state.npy
  The inverse: which pressure gives 0.3 N at a gap of 30 mm
    softtwin get 'softtwin/finger/pressure?force_n=0.3;gap_mm=30'
  The gap that explains 0.3 N (known to 5 mN) at 0.05 MPa, with its uncertainty
    softtwin get 'softtwin/finger/gap?pressure_mpa=0.05;force_n=0.3;force_halfwidth_n=0.005'
  Every twin of the domain
    softtwin get 'softtwin/*/whatif?pressure_mpa=0.05;gap_mm=30' --json

A question is answered by the twin in a thread beside its real-time loop. When there is no answer (the force is out of
reach, say) the reason is printed and the exit code is 1.";

/// Ask a running twin: what if, which pressure, which gap.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Selector: softtwin/<actuator>/whatif|pressure|gap?name=value;... with pressure_mpa, gap_mm, force_n, force_halfwidth_n, field.
    #[arg(value_name = "SELECTOR")]
    selector: String,
    /// File for the field (.npy), with `field=...` in the selector.
    #[arg(long, value_name = "FILE.npy")]
    out: Option<PathBuf>,
    /// Longest wait for an answer, in ms.
    #[arg(long, value_name = "MS", default_value_t = 1000)]
    timeout_ms: u64,
    /// One JSON object a line for each answer.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Asks, prints every answer.
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
            refused += usize::from(sample.answer().refusal().is_some());
            self.show(&sample)?;
        }
        anyhow::ensure!(refused == 0, "{refused} of {} questions have no answer, see above", questions.len());
        Ok(())
    }

    fn show(&self, sample: &AnswerSample) -> anyhow::Result<()> {
        let answer = sample.answer();
        if let (Some(out), None) = (&self.out, answer.refusal()) {
            let shape = [answer.field_count as usize, answer.node_count as usize];
            npy::write_f32(out, &shape, sample.values()).context("the field was not written")?;
        }
        if !self.json {
            return Ok(output!("{}", line(answer))?);
        }
        let fields: Vec<&str> = answer.fields().map(field_id::as_str).collect();
        let mut value = serde_json::to_value(AnswerMessage::from(answer))?;
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

/// One answer for people.
fn line(answer: &Answer) -> String {
    let head = format!("softtwin/{}/{}", unpack_name(&answer.actuator), query_kind::as_str(answer.kind));
    if let Some(reason) = answer.refusal() {
        return format!("{head}  no answer: {reason}");
    }
    let found = match answer.kind {
        query_kind::PRESSURE => between("P", answer.pressure_mpa, answer, "MPa"),
        query_kind::GAP => between("gap", answer.gap_mm, answer, "mm"),
        _ => String::new(),
    };
    let gap = if answer.gap_mm.is_finite() { format!("{:.3} mm", answer.gap_mm) } else { "none".into() };
    let flags: Vec<&str> = flags::names(answer.flags).collect();
    format!(
        "{head}  {found}P {:.5} MPa  gap {gap}  {}  F {:.4} +- {:.4} N  dF/dP {:.4} N/MPa  dF/dgap {:.4} N/mm  onset {:.5} MPa{}{}  ({:.0} us)",
        answer.pressure_mpa,
        regime::as_str(answer.regime),
        answer.contact_force_n,
        answer.force_halfwidth_n,
        answer.force_by_pressure_n_per_mpa,
        answer.force_by_gap_n_per_mm,
        answer.onset_pressure_mpa,
        if answer.entries() > 0 {
            format!("  field {} x {}", answer.field_count, answer.node_count)
        } else {
            String::new()
        },
        if flags.is_empty() { String::new() } else { format!("  [{}]", flags.join(" ")) },
        answer.compute_ns as f64 / 1e3,
    )
}

fn between(name: &str, value: f64, answer: &Answer, unit: &str) -> String {
    let (bar, low, high) = (answer.uncertainty, answer.low, answer.high);
    format!("{name} = {value:.5} +- {bar:.5} {unit} ({low:.5} .. {high:.5})  at ")
}
