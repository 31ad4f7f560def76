//! Numbers in payloads that stand for something, each with its name; the values of one model input.

use super::{INPUTS_MAX, slot};

/// A number with its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code {
    /// The number in a payload; of a flag: its bit.
    pub number: u32,
    /// Name of the constant.
    pub constant: &'static str,
    /// Name for people, in JSON, as a metric's label.
    pub name: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

/// All numbers of one kind.
pub type Codes = &'static [Code];

/// The name of a number; `unknown` when it has none.
fn name(codes: Codes, number: u32) -> &'static str {
    codes.iter().find(|code| code.number == number).map_or("unknown", |code| code.name)
}

/// A module of constants with their names: `ALL`, and `as_str` unless the module brings its own after the list.
macro_rules! codes {
    ($(#[doc = $about:literal])+ $module:ident: $type:ty { $($list:tt)+ }) => {
        codes! {
            $(#[doc = $about])+ $module: $type { $($list)+ }
            /// The name of a number; `unknown` when it has none.
            pub fn as_str(number: $type) -> &'static str {
                super::name(ALL, number.into())
            }
        }
    };
    (
        $(#[doc = $about:literal])+ $module:ident: $type:ty {
            $($(#[doc = $doc:literal])+ $constant:ident = $number:expr, $name:literal;)+
        }
        $($function:item)+
    ) => {
        $(#[doc = $about])+
        pub mod $module {
            $($(#[doc = $doc])+ pub const $constant: $type = $number;)+

            /// All of them with their names.
            pub const ALL: $crate::layout::Codes = &[$($crate::layout::Code {
                number: $number,
                constant: stringify!($constant),
                name: $name,
                meaning: concat!($($doc),+),
            }),+];

            $($function)+
        }
    };
}

/// A module of bits with their names, as [`codes`].
macro_rules! bits {
    ($(#[doc = $about:literal])+ $module:ident: u32 { $($list:tt)+ }) => {
        codes! {
            $(#[doc = $about])+ $module: u32 { $($list)+ }
            /// The names of the set bits.
            pub fn names(bits: u32) -> impl Iterator<Item = &'static str> {
                ALL.iter().filter(move |code| bits & code.number != 0).map(|code| code.name)
            }
        }
    };
}

/// An enumeration whose numbers are in payloads.
macro_rules! coded_enum {
    ($(#[doc = $about:literal])+ $enum:ident { $($(#[doc = $doc:literal])+ $variant:ident = $number:literal, $name:literal;)+ }) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[repr(u32)]
        pub enum $enum { $($(#[doc = $doc])+ $variant = $number,)+ }

        impl $enum {
            /// All in the order of their numbers.
            pub const ALL: &'static [$enum] = &[$($enum::$variant,)+];

            /// All codes with their numbers and names.
            pub const CODES: $crate::layout::Codes = &[$($crate::layout::Code {
                number: $number,
                constant: stringify!($variant),
                name: $name,
                meaning: concat!($($doc),+),
            }),+];

            /// The number in payloads.
            pub fn code(self) -> u32 {
                self as u32
            }

            /// The one of that number, if there is one.
            pub fn from_code(number: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|one| one.code() == number)
            }

            /// The text for people.
            pub fn as_str(self) -> &'static str {
                match self { $($enum::$variant => $name,)+ }
            }
        }
    };
}

bits! {
    /// Bits of `flags`.
    flags: u32 {
        /// No usable reading within the deadline: the values are the last good ones, see `age_ns`.
        STALE = 1 << 0, "stale";
        /// The last reading was rejected (see `outcome`): the values are the last good ones.
        HELD = 1 << 1, "held";
        /// Near the edge of the sampled states.
        NEAR_EDGE = 1 << 2, "near-edge";
        /// Outside the sampled states: an extrapolation.
        OUTSIDE_DOMAIN = 1 << 3, "outside-domain";
        /// A measured contact force came with the reading.
        FORCE_MEASURED = 1 << 4, "force-measured";
        /// The measured force has differed from the predicted one by more than its half-width for longer than configured.
        FORCE_MISMATCH = 1 << 5, "force-mismatch";
        /// The reading waited longer than the configured limit before its field was sent.
        LATE = 1 << 6, "late";
        /// No reading has come yet since the twin started.
        NO_DATA = 1 << 7, "no-data";
        /// The model has more coefficients than a state can carry: only the first are in it.
        COEFFICIENTS_CUT = 1 << 8, "coefficients-cut";
        /// The interpolated force was negative and was set to 0.
        FORCE_CLAMPED = 1 << 9, "force-clamped";
        /// The regime is still contact although the pressure is just below the onset (hysteresis).
        REGIME_HELD = 1 << 10, "regime-held";
        /// A marker has differed from its predicted position by more than the displacement's half-width for longer than configured.
        MARKER_MISMATCH = 1 << 11, "marker-mismatch";
        /// The estimate has an alarm: model and estimated quantities do not explain the readings.
        ESTIMATE_ALARM = 1 << 12, "estimate-alarm";
        /// A measured observable has differed from its predicted value by more than its half-width for longer than configured.
        OBSERVABLE_MISMATCH = 1 << 13, "observable-mismatch";
        /// The pressure has passed a limit: the state is on a branch behind it, or, outside the training range, in one that the model
        /// does not have.
        SNAPPED = 1 << 14, "snapped";
        /// The readings so far do not tell on which branch the state is: the first one that has the pressure is taken.
        BRANCH_UNKNOWN = 1 << 15, "branch-unknown";
        /// The values contain offsets that follow the measured outputs (`follow`).
        FOLLOWED = 1 << 16, "followed";
    }
}

bits! {
    /// Bits of `stale_values` and `fault_values` of a reading.
    value_bits: u32 {
        /// Pressure.
        PRESSURE = 1 << 0, "pressure";
        /// Gap.
        GAP = 1 << 1, "gap";
        /// Measured force.
        FORCE = 1 << 2, "force";
        /// First marker.
        MARKER1 = 1 << 3, "marker1";
        /// Second marker.
        MARKER2 = 1 << 4, "marker2";
        /// Third marker.
        MARKER3 = 1 << 5, "marker3";
        /// Fourth marker.
        MARKER4 = 1 << 6, "marker4";
        /// Fifth marker.
        MARKER5 = 1 << 7, "marker5";
        /// Sixth marker.
        MARKER6 = 1 << 8, "marker6";
        /// Seventh marker.
        MARKER7 = 1 << 9, "marker7";
        /// Eighth marker.
        MARKER8 = 1 << 10, "marker8";
        /// First named input.
        INPUT1 = 1 << 11, "input1";
        /// Second named input.
        INPUT2 = 1 << 12, "input2";
        /// Third named input.
        INPUT3 = 1 << 13, "input3";
        /// Fourth named input.
        INPUT4 = 1 << 14, "input4";
        /// Fifth named input.
        INPUT5 = 1 << 15, "input5";
        /// Sixth named input.
        INPUT6 = 1 << 16, "input6";
    }
}

codes! {
    /// Numbers of `regime`.
    regime: u32 {
        /// No reading yet.
        UNKNOWN = 0, "unknown";
        /// The actuator does not touch the plate: the model's input is the pressure.
        FREE = 1, "free";
        /// The actuator touches the plate: the model's inputs are pressure and gap.
        CONTACT = 2, "contact";
    }
}

codes! {
    /// Numbers of `domain_status`: where the inputs lie among the sampled states.
    domain_status: u32 {
        /// Among them.
        INSIDE = 0, "inside";
        /// Outside, by less than the distance that the model's validation covers.
        NEAR = 1, "near";
        /// Outside: an extrapolation.
        OUTSIDE = 2, "outside";
    }
}

codes! {
    /// Numbers of the entries of `input_sources`.
    input_source: u8 {
        /// Not said: no such input, or a recording of an earlier version.
        UNKNOWN = 0, "unknown";
        /// A sensor says it, with every reading.
        MEASURED = 1, "measured";
        /// Given in the scene.
        GIVEN = 2, "given";
        /// The model's nominal value, for inputs neither measured nor given.
        NOMINAL = 3, "nominal";
        /// Estimated by the twin, or a measured value minus an estimated bias; before the first reading its prior.
        ESTIMATED = 4, "estimated";
    }
}

codes! {
    /// Numbers of the entries of `field_ids`.
    field_id: u8 {
        /// No field in this slot.
        NONE = 0, "none";
        /// Deformed x coordinate, mm.
        X = 1, "x";
        /// Deformed y coordinate, mm.
        Y = 2, "y";
        /// Deformed z coordinate, mm.
        Z = 3, "z";
        /// Magnitude of the displacement, mm.
        DISPLACEMENT = 4, "displacement";
        /// Von Mises stress, MPa.
        VON_MISES = 5, "von_mises";
        /// From here on: 128 + position in the model, for fields without a fixed number.
        OTHER = 128, "other";
    }
    /// The name, as in the model and in scene files.
    pub fn as_str(id: u8) -> &'static str {
        super::name(ALL, id.min(OTHER).into())
    }

    /// Fixed number of a field of that name, if it has one.
    pub fn from_name(name: &str) -> Option<u8> {
        (X..=VON_MISES).find(|id| as_str(*id) == name)
    }
}

codes! {
    /// Numbers of `kind`: what a question asks for.
    query_kind: u32 {
        /// Pressure and gap are given, state and force are asked for.
        WHATIF = 1, "whatif";
        /// Gap and force are given, the lowest pressure with this force is asked for.
        PRESSURE = 2, "pressure";
        /// Pressure and a (measured) force are given, the gap that belongs to them is asked for.
        GAP = 3, "gap";
    }
}

codes! {
    /// Numbers of an estimate's `status`: outcome of the reading.
    estimate_status: u32 {
        /// No reading yet.
        NONE = 0, "none";
        /// The estimate takes the reading into account.
        USED = 1, "used";
        /// An input that is to be measured is missing: nothing changed.
        INPUT_MISSING = 2, "input-missing";
        /// The reading is not later than the one before: nothing changed.
        NOT_LATER = 3, "not-later";
        /// The search for the estimate did not end: nothing changed.
        NOT_CONVERGED = 4, "not-converged";
        /// Model and estimate do not explain the reading: nothing changed.
        NOT_EXPLAINED = 5, "not-explained";
        /// The estimate takes the reading into account along the tangent: the search had not ended within its predictions.
        TANGENT = 6, "tangent";
    }
}

codes! {
    /// Numbers of an estimate's `alarm`: what has not fitted for the last second or so.
    estimate_alarm: u32 {
        /// Model, sensors and estimates explain the readings.
        NONE = 0, "none";
        /// The inputs in `suspects` contradict the other sensors: what is read is not what is in the actuator.
        INPUT = 1, "input";
        /// The measurements in `suspects` contradict the others and the model.
        SENSOR = 2, "sensor";
        /// The quantities in `suspects` are identifiable and more than 4 standard deviations from their priors, or have moved.
        QUANTITY = 3, "quantity";
        /// The model does not explain the readings.
        NOT_EXPLAINED = 4, "not-explained";
    }
}

codes! {
    /// Numbers of `target_kind`.
    target_kind: u32 {
        /// At once.
        STEP = 0, "step";
        /// From the target before, with a constant rate.
        RAMP = 1, "ramp";
        /// Values at equal intervals from its sending on, straight lines between them; the last one stays.
        SERIES = 2, "series";
    }
}

codes! {
    /// Numbers of `grasp_status`.
    grasp_status: u32 {
        /// The state of at least one finger is stale.
        UNKNOWN = 0, "unknown";
        /// Friction does not carry the object.
        NOT_HELD = 1, "not held";
        /// Friction carries the object, but would not with the forces minus their half-widths.
        MARGINAL = 2, "held, within the half-width";
        /// Friction carries the object with the forces minus their half-widths, too.
        HELD = 3, "held";
    }
}

codes! {
    /// Numbers of `valve_reason`: why the valve has its value.
    valve_reason: u32 {
        /// No setpoint has come yet: the safe value.
        NO_SETPOINT = 0, "no-setpoint";
        /// The setpoint, within range and rate.
        FOLLOWING = 1, "following";
        /// The setpoint was not renewed within its time: the safe value.
        TIMEOUT = 2, "timeout";
        /// An interlock (see `valve_interlock`): the safe value.
        INTERLOCK = 3, "interlock";
        /// The operator's value, within range and rate, whatever setpoint and interlocks say.
        OVERRIDE = 4, "override";
        /// The device did not confirm the write; what it does is up to its own time-out.
        DEVICE_ERROR = 5, "device-error";
    }
}

bits! {
    /// Bits of `valve_interlock`.
    valve_interlock: u32 {
        /// The twin has sent no state yet.
        NO_STATE = 1 << 0, "no-state";
        /// The reading behind the newest state is older than allowed: twin, bridge or sensor has failed.
        STALE = 1 << 1, "stale";
        /// The state lies outside the sampled states.
        OUTSIDE_DOMAIN = 1 << 2, "outside-domain";
        /// The force, measured or predicted, was beyond its limit; stays until the operator's release.
        FORCE = 1 << 3, "force";
        /// A measured force is needed, and the newest state has none.
        NO_FORCE = 1 << 4, "no-force";
        /// The measured force contradicts the predicted one.
        FORCE_MISMATCH = 1 << 5, "force-mismatch";
        /// A marker contradicts its predicted position.
        MARKER_MISMATCH = 1 << 6, "marker-mismatch";
        /// The estimate has an alarm.
        ESTIMATE_ALARM = 1 << 7, "estimate-alarm";
        /// A measured observable contradicts its predicted value.
        OBSERVABLE_MISMATCH = 1 << 8, "observable-mismatch";
    }
}

bits! {
    /// Bits of `valve_limit`.
    valve_limit: u32 {
        /// The value that is wanted lies outside the range.
        RANGE = 1 << 0, "range";
        /// The value moves towards the wanted one at the greatest rate.
        RATE = 1 << 1, "rate";
    }
}

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
        /// The gap is outside the range in the scene (the regime it needs was not loaded): the last good state
        /// is kept.
        HeldOutsideScene = 6, "held: gap outside the scene's range";
        /// The same sequence number again.
        DroppedDuplicate = 7, "dropped: duplicate";
        /// A sequence number or time stamp before the last one.
        DroppedBackInTime = 8, "dropped: back in time";
        /// A newer reading was already waiting: the newest wins.
        DroppedSuperseded = 9, "dropped: superseded";
        /// An output could not be sent (no memory left, or the port failed).
        DroppedNotSent = 10, "dropped: could not be sent";
        /// The state is farther outside the training range than the samples are wide, the body cannot have its shape, or a value is not finite.
        DroppedModel = 11, "dropped: the model has no answer";
        /// The reading lies outside the model's domain and the settings say to hold: the last good state stands.
        HeldOutsideDomain = 12, "held: outside the model's domain";
        /// The reading lies outside the model's domain and the settings say to reject it.
        DroppedOutsideDomain = 13, "dropped: outside the model's domain";
        /// The model gave no field for an output; the state was sent.
        DroppedReconstruction = 14, "dropped: field could not be reconstructed";
        /// The sequence number is far from the one before; readings that go on from there are used from the third on.
        DroppedSequenceJump = 15, "dropped: sequence number jumps";
        /// A further measured input is outside the range in the scene: the last good state is kept.
        HeldInputOutsideScene = 16, "held: input outside the scene's range";
    }
}

impl Outcome {
    /// True if the last good state replaces the result.
    pub fn is_held(self) -> bool {
        matches!(self, Outcome::HeldOutsideDomain | Outcome::HeldInputOutsideScene)
            || (Outcome::HeldNotFinite.code()..=Outcome::HeldOutsideScene.code()).contains(&self.code())
    }

    /// True if the reading has no result.
    pub fn is_dropped(self) -> bool {
        self != Outcome::Published && !self.is_held()
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

coded_enum! {
    /// How one question ended; see [`super::Answer::status`]. The text is a sentence in which `{limit}` stands for [`super::Answer::limit`].
    QueryStatus {
        /// There is an answer.
        Answered = 0, "answered";
        /// A quantity that the question needs is missing, NaN or infinite.
        NotFinite = 1, "a quantity that this question needs is missing or not finite";
        /// The plate is out of reach at this gap; limit: the largest gap that can be reached, mm.
        OutOfReach = 2, "the plate is out of reach at this gap; the largest gap that can be reached is {limit} mm";
        /// More force than the sampled states give here; limit: the largest force, N.
        ForceTooHigh = 3, "more force than the sampled states give here: at most {limit} N";
        /// Less force than the sampled states give here; limit: the smallest force, N.
        ForceTooLow = 4, "less force than the sampled states give here: at least {limit} N";
        /// No force, so no contact: any gap from the limit on explains it; limit: that gap, mm.
        NoContact = 5, "without a force there is no contact: every gap from {limit} mm on explains it";
        /// No sampled state has this gap (or, when the gap is asked, this pressure); limit: the nearest that has one.
        OutsideDomain = 6, "no sampled state is there; the nearest sampled value is {limit}";
        /// The gap is no input of this model (all samples share one); limit: that gap, mm.
        GapIsFixed = 7, "the gap is no input of this model: all samples have {limit} mm";
        /// The twin offers no field of that name: the scene's `queries` or its outputs say no.
        NoSuchField = 8, "the twin offers no field of these nodes; see `queries` and the outputs of its scene";
        /// No shared memory for the field; limit: bytes needed.
        NoMemory = 9, "not enough shared memory for the field: {limit} bytes are needed in /dev/shm";
        /// The kind of question is unknown to this twin.
        UnknownKind = 10, "this twin does not know that kind of question";
        /// The body cannot have the state's shape, or a value is not finite.
        Model = 11, "the model has no answer there: the body cannot have the shape, or a value is not finite";
        /// The query has a parameter that the model does not have.
        UnknownInput = 12, "a parameter of the question is no input of this model, which has {inputs}";
        /// The state is too far outside the training range; limit: its distance as a fraction of that range.
        TooFar = 13, "the state is {limit} of the trained range outside the training states, where at most 0.25 is answered; ask nearer, or train with states there";
    }
}

/// One input of a model, as a payload carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct InputValue {
    /// Its name; of a name of more than 31 bytes the end.
    pub name: String,
    /// The value, in the unit at the end of the name.
    pub value: f64,
    /// Gradient of the force by it, N per unit; NaN when not known.
    pub force_by: f64,
    /// Where the value comes from: a number of [`super::input_source`].
    pub source: u8,
}

impl InputValue {
    /// True for an input other than pressure and gap.
    pub fn is_parameter(&self) -> bool {
        !["pressure_mpa", "gap_mm"].contains(&self.name.as_str())
    }
}

/// The inputs of a payload, `count` of them.
pub(super) fn inputs_of<'a>(
    count: u32,
    names: &'a [u8; 32 * INPUTS_MAX],
    values: &'a [f64; INPUTS_MAX],
    force_by: &'a [f64; INPUTS_MAX],
    sources: &'a [u8; INPUTS_MAX],
) -> impl Iterator<Item = InputValue> + 'a {
    let all = values.iter().zip(force_by).zip(sources).take(count as usize);
    all.enumerate().map(|(index, ((value, force_by), source))| InputValue {
        name: slot(names, index),
        value: *value,
        force_by: *force_by,
        source: *source,
    })
}
