//! Comparisons: each printed as it comes, all of them summed up at the end.

use serde::Serialize;
use serde_json::json;
use softtwin::output;

/// One comparison.
#[derive(Debug, Serialize)]
struct Row {
    part: &'static str,
    quantity: String,
    computed: f64,
    reference: f64,
    /// Error in the bound's unit.
    error: f64,
    bound: f64,
    unit: &'static str,
    holds: bool,
}

/// All comparisons, printed as they come.
pub struct Book {
    rows: Vec<Row>,
    skipped: Vec<String>,
    /// Differences without a bound.
    differences: Vec<serde_json::Value>,
    quiet: bool,
}

impl Book {
    /// An empty book that prints nothing but one JSON object when `quiet`.
    pub fn new(quiet: bool) -> Self {
        Self { rows: Vec::new(), skipped: Vec::new(), differences: Vec::new(), quiet }
    }

    pub fn heading(&self, text: &str) -> anyhow::Result<()> {
        if !self.quiet {
            output!("\n{text}")?;
            output!(
                "{:<50} {:>11} {:>11} {:>10} {:>9}",
                "quantity",
                "computed",
                "reference",
                "error",
                "at most"
            )?;
        }
        Ok(())
    }

    pub fn remark(&self, text: &str) -> anyhow::Result<()> {
        if !self.quiet {
            output!("{text}")?;
        }
        Ok(())
    }

    pub fn skip(&mut self, text: String) -> anyhow::Result<()> {
        self.remark(&format!("\nskipped: {text}"))?;
        self.skipped.push(text);
        Ok(())
    }

    /// A figure whose relative error, in per cent, has a bound.
    pub fn relative(
        &mut self,
        part: &'static str,
        quantity: String,
        (computed, reference): (f64, f64),
        bound: f64,
    ) -> anyhow::Result<()> {
        let error = 100.0 * (computed / reference - 1.0);
        self.add(Row { part, quantity, computed, reference, error, bound, unit: "%", holds: false })
    }

    /// An error that stands for itself.
    pub fn absolute(
        &mut self,
        part: &'static str,
        quantity: String,
        error: f64,
        (bound, unit): (f64, &'static str),
    ) -> anyhow::Result<()> {
        self.add(Row { part, quantity, computed: error, reference: 0.0, error, bound, unit, holds: false })
    }

    /// Keeps a difference without a bound for the JSON object.
    pub fn keep(&mut self, difference: &impl Serialize) -> anyhow::Result<()> {
        self.differences.push(serde_json::to_value(difference)?);
        Ok(())
    }

    fn add(&mut self, mut row: Row) -> anyhow::Result<()> {
        row.holds = row.error.abs() <= row.bound;
        if !self.quiet {
            output!(
                "{:<50} {:>11.5} {:>11.5} {:>+8.4} {:<2} {:>6} {}{}",
                row.quantity,
                row.computed,
                row.reference,
                row.error,
                row.unit,
                (row.bound * 1.0e4).round() / 1.0e4, // a bound in N as a fraction of a force has no short form
                row.unit,
                if row.holds { "" } else { "  MISSED" }
            )?;
        }
        self.rows.push(row);
        Ok(())
    }

    pub fn close(self) -> anyhow::Result<()> {
        let missed: Vec<&str> = self.rows.iter().filter(|r| !r.holds).map(|r| r.quantity.as_str()).collect();
        if self.quiet {
            output::json(
                &json!({"rows": self.rows, "missed": missed.len(), "skipped": self.skipped, "differences": self.differences}),
            )?;
        } else if !self.rows.is_empty() {
            output!("\n{} figures compared, {} missed", self.rows.len(), missed.len())?;
        }
        if missed.is_empty() {
            return Ok(());
        }
        anyhow::bail!(
            "{} of {} figures miss their bound: {}",
            missed.len(),
            self.rows.len(),
            missed.join(", ")
        )
    }
}
