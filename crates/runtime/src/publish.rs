//! From an evaluation to what is published: states, answers, field headers, and the field topics of a twin.

use crate::config::StateSpec;
use crate::load::{LoadedOutput, PayloadContents};
use rom::evaluation::Evaluation;
use rom::evaluator::RegimeLabel;
use rom::hull::DomainStatus;
use rom::reconstructor::{Peaks, Reconstructor};
use wire::layout::{COEFFICIENTS_MAX, INPUTS_MAX, OBSERVABLES_MAX, flags, pack_name};
use wire::{Answer, Bus, FieldHeader, FieldLoan, FieldWriter, State, Topic, WireError};

/// Writes an evaluation into a payload: [`State`] and [`Answer`] have these values in common.
macro_rules! write_evaluation {
    ($payload:ident, $evaluation:expr, $contents:expr) => {{
        let (e, contents): (&Evaluation, &PayloadContents) = ($evaluation, $contents);
        let known = |is_known: bool, value: f64| if is_known { value } else { f64::NAN };
        $payload.flags = flags_of(e);
        rom::numbers!($payload, e);
        $payload.pressure_mpa = e.inputs.pressure_mpa();
        $payload.gap_mm = e.inputs.gap_mm();
        $payload.inputs = contents.of_inputs(e.inputs.values());
        $payload.force_by_input = contents.of_inputs(&e.force_gradient);
        $payload.force_by_pressure_n_per_mpa =
            known(contents.needs.pressure, e.force_by_pressure_n_per_mpa());
        $payload.force_by_gap_n_per_mm = known(contents.needs.gap, e.force_by_gap_n_per_mm());
        $payload.outside_by = contents.of_inputs(&e.outside_by);
        $payload.coefficient_count = e.coefficients.len().min(COEFFICIENTS_MAX) as u32;
        $payload.coefficients = [0.0; COEFFICIENTS_MAX];
        for (to, from) in $payload.coefficients.iter_mut().zip(&e.coefficients) {
            *to = *from as f32;
        }
        let count = contents.outputs.count().min(OBSERVABLES_MAX);
        $payload.observable_count = count as u32;
        $payload.observable_names = contents.observable_names;
        for at in 0..count {
            let found = contents.outputs.value(at, e);
            ($payload.observables[at], $payload.observable_halfwidths[at]) = (found.value, found.halfwidth);
            $payload.observable_offsets[at] = found.offset;
        }
        let sizes = contents.group_sizes.iter().find(|(kind, _)| *kind == e.regime);
        $payload.group_sizes = sizes.map(|(_, sizes)| *sizes).unwrap_or_default();
    }};
}

/// Writes what a field consists of into a payload: [`FieldHeader`] and [`Answer`] have these values in common.
macro_rules! write_shape {
    ($payload:ident, $output:expr) => {{
        let output: &LoadedOutput = $output;
        $payload.node_count = output.reconstructor.rows() as u32;
        $payload.field_count = output.reconstructor.field_count() as u32;
        $payload.field_ids = output.field_ids;
        $payload.node_set = pack_name(output.spec.topic_name().unwrap_or("all"));
    }};
}

/// Writes the largest stress of a field and its node into a payload.
macro_rules! write_peaks {
    ($payload:ident, $peaks:expr) => {{
        let stress = $peaks.stress_mpa;
        $payload.max_von_mises_mpa = stress.map_or(f64::NAN, |peak| peak.value.into());
        $payload.max_von_mises_node = stress.map_or(u32::MAX, |peak| peak.node);
    }};
}

/// Fills a state from an evaluation; without the extras that are not wanted.
pub(crate) fn fill_state(
    state: &mut State,
    evaluation: &Evaluation,
    contents: &PayloadContents,
    wanted: StateSpec,
) {
    write_evaluation!(state, evaluation, contents);
    if !wanted.gradients {
        state.force_by_pressure_n_per_mpa = f64::NAN;
        state.force_by_gap_n_per_mm = f64::NAN;
        state.force_by_input = [f64::NAN; INPUTS_MAX];
    }
    if !wanted.half_widths {
        state.force_halfwidth_n = f32::NAN;
        state.displacement_halfwidth_mm = f32::NAN;
        state.von_mises_halfwidth_mpa = f32::NAN;
        state.observable_halfwidths = [f64::NAN; OBSERVABLES_MAX];
    }
}

/// A state with the values of an evaluation and nothing else: no reading, no run, no times.
pub fn state_of(evaluation: &Evaluation, contents: &PayloadContents) -> State {
    let mut state = contents.state();
    let all = StateSpec { gradients: true, half_widths: true, coefficients: true };
    fill_state(&mut state, evaluation, contents, all);
    state
}

/// Puts the label with hysteresis in place of the evaluation's own regime.
pub(crate) fn fill_label(state: &mut State, label: RegimeLabel) {
    state.regime = label.regime.number();
    state.flags |= if label.held { flags::REGIME_HELD } else { 0 };
}

/// Fills an answer from an evaluation.
pub(crate) fn fill_answer(answer: &mut Answer, evaluation: &Evaluation, contents: &PayloadContents) {
    write_evaluation!(answer, evaluation, contents);
}

/// Adds the field of an answer.
pub(crate) fn fill_answer_field(answer: &mut Answer, output: &LoadedOutput, peaks: &Peaks) {
    write_shape!(answer, output);
    write_peaks!(answer, peaks);
}

/// The part of a field's header that is the same for every sample.
pub(crate) fn field_header(output: &LoadedOutput) -> FieldHeader {
    let mut header = FieldHeader::default();
    write_shape!(header, output);
    header
}

/// Fills the header of a field sample from the state that it belongs to.
pub(crate) fn fill_field_header(header: &mut FieldHeader, state: &State, peaks: &Peaks) {
    header.flags = state.flags;
    header.sensor_boot_id = state.sensor_boot_id;
    header.sensor_seq = state.sensor_seq;
    header.t_sensor_ns = state.t_sensor_ns;
    header.pressure_mpa = state.pressure_mpa;
    header.gap_mm = state.gap_mm;
    header.contact_force_n = state.contact_force_n;
    header.regime = state.regime;
    header.inputs = state.inputs;
    header.input_names = state.input_names;
    (header.input_count, header.input_sources) = (state.input_count, state.input_sources);
    write_peaks!(header, peaks);
}

/// Whether an evaluation is an answer: the model does not refuse the state, and all numbers are finite.
pub(crate) fn is_answer(evaluation: &Evaluation) -> bool {
    evaluation.flags.refusal.is_none()
        && (evaluation.flags.no_force || evaluation.contact_force_n.is_finite())
        && evaluation.coefficients.iter().all(|a| a.is_finite())
}

fn flags_of(evaluation: &Evaluation) -> u32 {
    let bits = [
        (flags::NEAR_EDGE, evaluation.domain == DomainStatus::Near),
        (flags::OUTSIDE_DOMAIN, evaluation.domain == DomainStatus::Outside),
        (flags::COEFFICIENTS_CUT, evaluation.coefficients.len() > COEFFICIENTS_MAX),
        (flags::FORCE_CLAMPED, evaluation.flags.force_clamped),
        (flags::SNAPPED, evaluation.flags.snapped),
        (flags::BRANCH_UNKNOWN, evaluation.flags.branch_unknown),
    ];
    bits.iter().filter(|(_, set)| *set).map(|(bit, _)| bit).sum()
}

/// A field topic of a running twin.
#[derive(Debug)]
pub(crate) struct FieldOutput {
    writer: FieldWriter,
    reconstructor: Reconstructor,
    /// The values that are the same in every header, and the number of the last sample.
    header: FieldHeader,
    /// The sample that the next field is written into.
    next: Option<FieldLoan>,
    period_ns: u64,
    next_due_ns: u64,
}

/// Why a field was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FieldError {
    /// The model has no field for this evaluation.
    Reconstruction,
    /// No sample is free, or the port failed.
    Transport,
}

impl FieldOutput {
    pub(crate) fn start(
        bus: &Bus,
        actuator: &str,
        model_hash: [u8; 16],
        boot_id: u64,
        loaded: LoadedOutput,
    ) -> Result<Self, WireError> {
        let topic = Topic::field(actuator, loaded.spec.topic_name())?;
        let mut output = Self {
            writer: FieldWriter::create(bus, &topic, loaded.reconstructor.entries())?,
            header: FieldHeader { model_hash, boot_id, ..field_header(&loaded) },
            period_ns: period_ns(&loaded),
            reconstructor: loaded.reconstructor,
            next: None,
            next_due_ns: 0,
        };
        output.loan_ahead();
        Ok(output)
    }

    /// Last chunk of the topic and values of a sample, for messages.
    pub(crate) fn shape(&self) -> String {
        shape(self.writer.topic().node_set(), self.writer.entries())
    }

    /// Continues with another model on the same topic; returns the old one, so that it is freed elsewhere. The caller has
    /// checked that a sample has as many values as before.
    pub(crate) fn swap(&mut self, model_hash: [u8; 16], loaded: LoadedOutput) -> Reconstructor {
        let (boot_id, seq) = (self.header.boot_id, self.header.seq);
        self.header = FieldHeader { model_hash, boot_id, seq, ..field_header(&loaded) };
        self.period_ns = period_ns(&loaded);
        self.next_due_ns = 0;
        std::mem::replace(&mut self.reconstructor, loaded.reconstructor)
    }

    /// Whether a reading of this time is to be published here.
    pub(crate) fn is_due(&self, t_sensor_ns: u64) -> bool {
        t_sensor_ns >= self.next_due_ns
    }

    /// Step 4: writes the field into a sample on loan.
    pub(crate) fn reconstruct(&mut self, evaluation: &Evaluation) -> Result<(FieldLoan, Peaks), FieldError> {
        if !is_answer(evaluation) {
            return Err(FieldError::Reconstruction);
        }
        let mut loan = match self.next.take() {
            Some(loan) => loan,
            None => self.writer.loan().map_err(|_| FieldError::Transport)?,
        };
        let peaks = self.reconstructor.reconstruct_into(evaluation, loan.values_mut());
        Ok((loan, peaks.map_err(|_| FieldError::Reconstruction)?))
    }

    /// Step 5: sends the field with the header that belongs to `state`.
    pub(crate) fn publish(
        &mut self,
        (loan, peaks): (FieldLoan, Peaks),
        state: &State,
    ) -> Result<(), FieldError> {
        self.header.seq += 1;
        fill_field_header(&mut self.header, state, &peaks);
        loan.send(self.header).map_err(|_| FieldError::Transport)?;
        if self.period_ns > 0 {
            // Keeps the rate on average; after a pause it restarts instead of catching up.
            let next = self.next_due_ns + self.period_ns;
            self.next_due_ns =
                if next > state.t_sensor_ns { next } else { state.t_sensor_ns + self.period_ns };
        }
        Ok(())
    }

    /// Takes the next sample on loan. Without one (all in use) the next reading tries again.
    pub(crate) fn loan_ahead(&mut self) {
        if self.next.is_none() {
            self.next = self.writer.loan().ok();
        }
    }

    /// Maps all pages ahead of use.
    pub(crate) fn prefault(&self) -> std::io::Result<u64> {
        self.writer.prefault()
    }
}

/// Last chunk of a field topic and values of a sample, for messages.
pub(crate) fn shape(node_set: Option<&str>, entries: usize) -> String {
    format!("{} ({entries})", node_set.unwrap_or("all"))
}

/// Time between two fields; 0: every reading.
fn period_ns(loaded: &LoadedOutput) -> u64 {
    if loaded.spec.rate_hz > 0.0 { (1e9 / loaded.spec.rate_hz) as u64 } else { 0 }
}
