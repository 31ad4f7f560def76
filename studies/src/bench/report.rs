//! The report.

use super::compute::{Compute, Kernel};
use super::live::EndToEnd;
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
        output!("medians in microseconds")?;
        output!("")?;
        output!("kernel      modes     bytes      warm   evicted  GB/s")?;
        kernel("default", &c.kernel.default)?;
        kernel("f32", &c.kernel.f32)?;
        output!("")?;
        output!("input to full field     {:8.2}", c.predict_us_p50)?;
        output!("readings that jump      {:8.2}   (over the whole training range)", c.jumping_us_p50)?;
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
    let Kernel { modes, bytes, warm_us_p50, evicted_us_p50, gbps } = k;
    output!("{name:10} {modes:6} {bytes:9} {warm_us_p50:9.1} {evicted_us_p50:9.1} {gbps:5.1}")?;
    Ok(())
}
