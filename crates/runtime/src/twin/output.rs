//! One field topic: reconstructs straight into the memory that the readers map.

use super::load::LoadedOutput;
use rom::evaluation::Evaluation;
use rom::predict::Predictor;
use wire::layout::{FIELD_SLOTS, pack_name};
use wire::{Bus, FieldHeader, FieldLoan, FieldWriter, State, Topic, WireError};

/// A field topic of a running twin.
#[derive(Debug)]
pub(super) struct Output {
    writer: FieldWriter,
    predictor: Predictor,
    /// What is the same in every header.
    template: FieldHeader,
    next: Option<FieldLoan>,
    period_ns: u64,
    next_due_ns: u64,
}

/// Why a field was not sent.
#[derive(Debug)]
pub(super) struct NotSent;

impl Output {
    pub(super) fn start(
        bus: &Bus,
        actuator: &str,
        model_hash: [u8; 16],
        boot_id: u64,
        loaded: LoadedOutput,
    ) -> Result<Self, WireError> {
        let set = loaded.spec.topic_name();
        let writer = FieldWriter::create(bus, &Topic::field(actuator, set)?, loaded.predictor.entries())?;
        let template = template(model_hash, boot_id, &loaded, 0);
        let period_ns = period_ns(&loaded);
        let mut output =
            Self { writer, predictor: loaded.predictor, template, next: None, period_ns, next_due_ns: 0 };
        output.loan_ahead();
        Ok(output)
    }

    /// Name of the node set as in the topic; `None`: all.
    pub(super) fn topic(&self) -> &Topic {
        self.writer.topic()
    }

    /// Values of a sample.
    pub(super) fn entries(&self) -> usize {
        self.writer.entries()
    }

    /// Continues with another model on the same topic; returns the old one, so that it is freed elsewhere. The caller has
    /// checked that a sample has as many values as before.
    pub(super) fn swap(&mut self, model_hash: [u8; 16], loaded: LoadedOutput) -> Predictor {
        self.template = template(model_hash, self.template.boot_id, &loaded, self.template.seq);
        self.period_ns = period_ns(&loaded);
        self.next_due_ns = 0;
        std::mem::replace(&mut self.predictor, loaded.predictor)
    }

    /// Whether a reading of this time is to be published here.
    pub(super) fn is_due(&self, t_sensor_ns: u64) -> bool {
        t_sensor_ns >= self.next_due_ns
    }

    pub(super) fn publish(&mut self, evaluation: &Evaluation, state: &State) -> Result<(), NotSent> {
        let mut loan = match self.next.take() {
            Some(loan) => loan,
            None => self.writer.loan().map_err(|_| NotSent)?,
        };
        let peaks = self.predictor.reconstruct_into(evaluation, loan.values_mut()).map_err(|_| NotSent)?;
        self.template.seq += 1;
        let stress = peaks.stress_mpa;
        let header = FieldHeader {
            flags: state.flags,
            sensor_boot_id: state.sensor_boot_id,
            sensor_seq: state.sensor_seq,
            t_sensor_ns: state.t_sensor_ns,
            pressure_mpa: state.pressure_mpa,
            gap_mm: state.gap_mm,
            contact_force_n: state.contact_force_n,
            max_von_mises_mpa: stress.map_or(f64::NAN, |peak| peak.value.into()),
            max_von_mises_node: stress.map_or(u32::MAX, |peak| peak.node),
            regime: state.regime,
            ..self.template
        };
        self.writer.send(loan, header).map_err(|_| NotSent)?;
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

/// What is the same in every header.
fn template(model_hash: [u8; 16], boot_id: u64, loaded: &LoadedOutput, seq: u64) -> FieldHeader {
    let mut field_ids = [0; FIELD_SLOTS];
    for (to, from) in field_ids.iter_mut().zip(&loaded.field_ids) {
        *to = *from;
    }
    FieldHeader {
        model_hash,
        boot_id,
        seq,
        node_count: loaded.predictor.rows() as u32,
        field_count: loaded.predictor.field_count() as u32,
        field_ids,
        node_set: pack_name(loaded.spec.topic_name().unwrap_or("all")),
        ..FieldHeader::default()
    }
}

/// Time between two fields; 0: every reading.
fn period_ns(loaded: &LoadedOutput) -> u64 {
    if loaded.spec.rate_hz > 0.0 { (1e9 / loaded.spec.rate_hz) as u64 } else { 0 }
}
