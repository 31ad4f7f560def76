//! The outcome of a reading: published, held (with a reason) or dropped (with a reason).

use super::codes::coded_enum;

coded_enum! {
    /// The outcome of one reading. Its number is in [`super::State`] and is the index of [`super::Health::outcomes`].
    Outcome {
        /// Evaluated and sent.
        Published = 0, "published";
        /// Pressure, gap or another measured input is absent, NaN or infinite: the last good state stands.
        HeldNotFinite = 1, "held: not finite";
        /// Pressure or gap is beyond what any such actuator can have: the last good state stands.
        HeldAbsurd = 2, "held: absurd value";
        /// The sensor itself reports a fault: the last good state stands.
        HeldSensorFault = 3, "held: sensor fault";
        /// Older than the configured limit when it arrived: the last good state stands.
        HeldStale = 4, "held: stale";
        /// Stamped later than now by more than the configured limit: the last good state stands.
        HeldFuture = 5, "held: stamped in the future";
        /// The gap is outside the range that the scene said can occur (what it needs was not loaded): the last good state
        /// stands.
        HeldOutsideScene = 6, "held: gap outside the scene's range";
        /// The same sequence number again.
        DroppedDuplicate = 7, "dropped: duplicate";
        /// A sequence number or time stamp before the last one.
        DroppedBackInTime = 8, "dropped: back in time";
        /// A newer reading was already waiting: the newest wins.
        DroppedSuperseded = 9, "dropped: superseded";
        /// An output could not be sent (no memory left, or the port failed).
        DroppedNotSent = 10, "dropped: could not be sent";
        /// The model gave a value that is not finite.
        DroppedModel = 11, "dropped: model gave no finite value";
        /// The reading lies outside the model's domain and the settings say to hold: the last good state stands.
        HeldOutsideDomain = 12, "held: outside the model's domain";
        /// The reading lies outside the model's domain and the settings say to reject it.
        DroppedOutsideDomain = 13, "dropped: outside the model's domain";
        /// The model gave no field for an output; the state was sent.
        DroppedReconstruction = 14, "dropped: field could not be reconstructed";
        /// The sequence number is far from the one before; readings that go on from there are used from the third on.
        DroppedSequenceJump = 15, "dropped: sequence number jumps";
        /// A measured input beside pressure and gap is outside the range that the scene said can occur: the last good state stands.
        HeldInputOutsideScene = 16, "held: input outside the scene's range";
    }
}

impl Outcome {
    /// Whether the last good state stands in its place.
    pub fn is_held(self) -> bool {
        matches!(self, Outcome::HeldOutsideDomain | Outcome::HeldInputOutsideScene)
            || (Outcome::HeldNotFinite.code()..=Outcome::HeldOutsideScene.code()).contains(&self.code())
    }

    /// Whether nothing came of it.
    pub fn is_dropped(self) -> bool {
        self != Outcome::Published && !self.is_held()
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}
