//! One field topic: reconstructs into the memory that the readers map, and sends it.

use crate::load::LoadedOutput;
use crate::payload;
use rom::evaluation::Evaluation;
use rom::kernel::Peaks;
use rom::reconstructor::Reconstructor;
use wire::{Bus, FieldHeader, FieldLoan, FieldWriter, State, Topic, WireError};

/// A field topic of a running twin.
#[derive(Debug)]
pub(super) struct FieldOutput {
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
pub(super) enum FieldError {
    /// The model has no field for this evaluation.
    Reconstruction,
    /// No sample is free, or the port failed.
    Transport,
}

impl FieldOutput {
    pub(super) fn start(
        bus: &Bus,
        actuator: &str,
        model_hash: [u8; 16],
        boot_id: u64,
        loaded: LoadedOutput,
    ) -> Result<Self, WireError> {
        let topic = Topic::field(actuator, loaded.spec.topic_name())?;
        let mut output = Self {
            writer: FieldWriter::create(bus, &topic, loaded.reconstructor.entries())?,
            header: FieldHeader { model_hash, boot_id, ..payload::field_header(&loaded) },
            period_ns: period_ns(&loaded),
            reconstructor: loaded.reconstructor,
            next: None,
            next_due_ns: 0,
        };
        output.loan_ahead();
        Ok(output)
    }

    /// Last chunk of the topic and values of a sample, for messages.
    pub(super) fn shape(&self) -> String {
        shape(self.writer.topic().node_set(), self.writer.entries())
    }

    /// Continues with another model on the same topic; returns the old one, so that it is freed elsewhere. The caller has
    /// checked that a sample has as many values as before.
    pub(super) fn swap(&mut self, model_hash: [u8; 16], loaded: LoadedOutput) -> Reconstructor {
        let (boot_id, seq) = (self.header.boot_id, self.header.seq);
        self.header = FieldHeader { model_hash, boot_id, seq, ..payload::field_header(&loaded) };
        self.period_ns = period_ns(&loaded);
        self.next_due_ns = 0;
        std::mem::replace(&mut self.reconstructor, loaded.reconstructor)
    }

    /// Whether a reading of this time is to be published here.
    pub(super) fn is_due(&self, t_sensor_ns: u64) -> bool {
        t_sensor_ns >= self.next_due_ns
    }

    /// Step 4: writes the field into a sample on loan.
    pub(super) fn reconstruct(&mut self, evaluation: &Evaluation) -> Result<(FieldLoan, Peaks), FieldError> {
        if !payload::is_finite(evaluation) {
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
    pub(super) fn publish(
        &mut self,
        (loan, peaks): (FieldLoan, Peaks),
        state: &State,
    ) -> Result<(), FieldError> {
        self.header.seq += 1;
        payload::fill_field_header(&mut self.header, state, &peaks);
        loan.send(self.header).map_err(|_| FieldError::Transport)?;
        if self.period_ns > 0 {
            // Keeps the rate on average; after a pause it begins anew instead of catching up.
            let next = self.next_due_ns + self.period_ns;
            self.next_due_ns =
                if next > state.t_sensor_ns { next } else { state.t_sensor_ns + self.period_ns };
        }
        Ok(())
    }

    /// Takes the next sample on loan. Without one (all in use) the next reading tries again.
    pub(super) fn loan_ahead(&mut self) {
        if self.next.is_none() {
            self.next = self.writer.loan().ok();
        }
    }

    /// Maps all pages ahead of use.
    pub(super) fn prefault(&self) -> std::io::Result<u64> {
        self.writer.prefault()
    }
}

/// Last chunk of a field topic and values of a sample, for messages.
pub(super) fn shape(node_set: Option<&str>, entries: usize) -> String {
    format!("{} ({entries})", node_set.unwrap_or("all"))
}

/// Time between two fields; 0: every reading.
fn period_ns(loaded: &LoadedOutput) -> u64 {
    if loaded.spec.rate_hz > 0.0 { (1e9 / loaded.spec.rate_hz) as u64 } else { 0 }
}
