//! A log as quantities.

/// One quantity over the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name with its unit.
    pub name: String,
    /// Values; NaN if missing.
    pub values: Vec<f64>,
}

/// A log as quantities.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Time of the first row, s; from the clock's zero.
    pub start_s: f64,
    /// Time of the rows from the first one, s.
    pub time_s: Vec<f64>,
    pub inputs: Vec<Series>,
    pub outputs: Vec<Series>,
    /// Remarks on times, missing values, flat tops, negative pressures.
    pub remarks: Vec<String>,
}

impl Recording {
    /// Every `step`-th row, at least each.
    #[must_use]
    pub fn every(&self, step: usize) -> Self {
        let thin = |values: &[f64]| values.iter().copied().step_by(step.max(1)).collect();
        let all = |series: &[Series]| {
            series.iter().map(|s| Series { name: s.name.clone(), values: thin(&s.values) }).collect()
        };
        Self {
            start_s: self.start_s,
            time_s: thin(&self.time_s),
            inputs: all(&self.inputs),
            outputs: all(&self.outputs),
            remarks: self.remarks.clone(),
        }
    }

    /// The recording as a trace: comma-separated, columns by name.
    #[must_use]
    pub fn csv(&self) -> String {
        let all = || self.inputs.iter().chain(&self.outputs);
        let mut text: String = "t_s".into();
        all().for_each(|series| text += &format!(",{}", series.name));
        for (row, t_s) in self.time_s.iter().enumerate() {
            text += &format!("\n{t_s}");
            all().for_each(|series| text += &format!(",{}", series.values[row]));
        }
        text + "\n"
    }
}
