//! The report.

use super::compute::{Compute, Kernel};
use super::live::EndToEnd;
use rom::reconstructor::Storage;
use serde::Serialize;
use softtwin::output;

/// The whole result.
#[derive(Debug, Serialize)]
pub struct Report {
    /// The model's file, or that it is synthetic.
    pub model: String,
    /// In this process.
    #[serde(flatten)]
    pub compute: Compute,
    /// Through the daemons.
    pub end_to_end: Vec<EndToEnd>,
    /// Rows that could not be measured, with the reason.
    pub notes: Vec<String>,
}

impl Report {
    /// Tables for people.
    pub fn print(&self) -> anyhow::Result<()> {
        let c = &self.compute;
        output!("model: {}", self.model)?;
        let (nodes, fields, entries, isa) = (c.nodes, c.fields, c.entries, &c.isa);
        output!(
            "{nodes} nodes x {fields} fields = {entries} entries, {} coefficients, {isa}",
            c.coefficients
        )?;
        output!("one core reads the basis at {:.1} GB/s; medians in microseconds", c.read_gbps)?;
        output!("")?;
        output!("kernel     bytes      warm   evicted  GB/s   of reading alone (warm, evicted)")?;
        kernel("f32", &c.kernel.f32)?;
        kernel("i16", &c.kernel.i16)?;
        if let Some(budget) = &c.kernel.budget {
            kernel("budget", budget)?;
        }
        let f32 = &c.kernel.f32;
        for (name, k) in
            std::iter::once(("i16", &c.kernel.i16)).chain(c.kernel.budget.iter().map(|k| ("budget", k)))
        {
            let (warm, evicted) = (f32.warm_us_p50 / k.warm_us_p50, f32.evicted_us_p50 / k.evicted_us_p50);
            output!("{name} is {warm:.2}x as fast warm, {evicted:.2}x evicted")?;
        }
        let as_good = 100.0 * Storage::AS_GOOD_SHARE;
        match c.kernel.budget_widths.map(|shares| shares.map(|share| 100.0 * share)) {
            Some([wide, half, quarter, none]) => output!(
                "budget (error grows by {as_good} % at most): {wide:.0} % of rows in f32, {half:.0} % i16, {quarter:.0} % i8, {none:.0} % left out"
            )?,
            None => output!("budget: even f32 lets this model's error grow by more than {as_good} %")?,
        }
        if c.kernel.budget_parts > 1 {
            output!(
                "budget: {} parts of the domain, {} bytes together; measured is the largest",
                c.kernel.budget_parts,
                c.kernel.budget_parts_bytes
            )?;
        }
        let paced = &c.paced;
        let way = if c.kernel.budget.is_some() { "budget" } else { "f32" };
        output!("{way} once a millisecond: {:.1} asleep between", paced.asleep_us_p50)?;
        output!("")?;
        output!("input to full field     {:8.2}   (f32)", c.predict_us_p50)?;
        if let Some(us) = c.predict_budget_us_p50 {
            output!("with the budget's basis {us:8.2}")?;
        }
        if let Some(us) = c.predict_budget_jumping_us_p50 {
            output!("readings that jump      {us:8.2}   (over the whole training range)")?;
        }
        output!("input to {:4} nodes      {:8.2}", c.tip_nodes, c.tip_us_p50)?;
        output!("state, one position     {:8.2}   (with derivatives)", c.position_us_p50)?;
        output!("state only              {:8.2}", c.state_only_us_p50)?;
        self.print_end_to_end()
    }

    fn print_end_to_end(&self) -> anyhow::Result<()> {
        if !self.end_to_end.is_empty() {
            output!("")?;
            output!(
                "sensor stamp to reader, us        p50      p99    p99.9      max  received  lost  core: twin  reader"
            )?;
        }
        for row in &self.end_to_end {
            let name = format!("{:.0} Hz {:?} {:?}", row.rate_hz, row.payload, row.wake);
            let q = &row.latency_us;
            let (p50, p99, p999, max) = (q.p50, q.p99, q.p999, q.max);
            let (received, lost) = (row.received, row.lost);
            let (twin, reader) = (row.twin_core_percent, row.reader_core_percent);
            output!(
                "{name:28} {p50:8.1} {p99:8.1} {p999:8.1} {max:8.1}  {received:8}  {lost:4}  {twin:8.1} %{reader:6.1} %"
            )?;
        }
        for note in &self.notes {
            output!("not measured: {note}")?;
        }
        Ok(())
    }
}

fn kernel(name: &str, k: &Kernel) -> anyhow::Result<()> {
    let evicted_share = 100.0 * k.evicted_read_us_p50 / k.evicted_us_p50;
    output!(
        "{name:6} {:9} {:9.1} {:9.1} {:5.1}   {:3.0} %, {evicted_share:3.0} %",
        k.bytes,
        k.warm_us_p50,
        k.evicted_us_p50,
        k.gbps,
        100.0 * k.share_of_read
    )?;
    Ok(())
}
