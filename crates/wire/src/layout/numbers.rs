//! What the numbers in payloads stand for.

use super::codes::codes;

codes! {
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
    }
    /// The names of the set bits.
    pub fn names(flags: u32) -> impl Iterator<Item = &'static str> {
        ALL.iter().filter(move |code| flags & code.number != 0).map(|code| code.name)
    }
}

codes! {
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
    /// The names of the set bits.
    pub fn names(bits: u32) -> impl Iterator<Item = &'static str> {
        ALL.iter().filter(move |code| bits & code.number != 0).map(|code| code.name)
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
        NEAR_EDGE = 1, "near-edge";
        /// Outside: an extrapolation.
        OUTSIDE = 2, "outside-domain";
    }
}

codes! {
    /// Numbers of the entries of `input_sources`.
    input_source: u8 {
        /// Not said: no such input, or a recording of an earlier version.
        UNKNOWN = 0, "unknown";
        /// A sensor says it, with every reading.
        MEASURED = 1, "measured";
        /// The scene says it.
        GIVEN = 2, "given";
        /// Nobody says it: the model's nominal value.
        NOMINAL = 3, "nominal";
        /// The twin estimates it, or a measured value less a bias that it estimates; before the first reading its prior.
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
        /// From here on: 128 + position in the model, for fields without a number of their own.
        OTHER = 128, "other";
    }
    /// The name, as in the model and in scene files.
    pub fn as_str(id: u8) -> &'static str {
        super::super::codes::name(ALL, id.min(OTHER).into())
    }

    /// The number of a field of that name, when it has one of its own.
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
    /// Numbers of an estimate's `status`: what became of the reading.
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
        /// The quantities in `suspects` are told by the readings and lie beyond 4 standard deviations of what was known before.
        QUANTITY = 3, "quantity";
        /// The model does not explain the readings.
        NOT_EXPLAINED = 4, "not-explained";
    }
}

codes! {
    /// Numbers of `grasp_status`.
    grasp_status: u32 {
        /// Not every finger has a fresh state.
        UNKNOWN = 0, "unknown";
        /// Friction does not carry the object.
        NOT_HELD = 1, "not held";
        /// Friction carries the object, but would not with the forces less their half-widths.
        MARGINAL = 2, "held, within the error bar";
        /// Friction carries the object with the forces less their half-widths, too.
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

codes! {
    /// Bits of `valve_interlock`.
    valve_interlock: u32 {
        /// The twin has sent no state yet.
        NO_STATE = 1 << 0, "no-state";
        /// The reading behind the newest state is older than allowed: twin, bridge or sensor has failed.
        STALE = 1 << 1, "stale";
        /// The state lies outside the sampled states.
        OUTSIDE_DOMAIN = 1 << 2, "outside-domain";
        /// The force, measured or predicted, was beyond its limit; stays until the owner asks for the safe value or begins a new run.
        FORCE = 1 << 3, "force";
        /// A measured force is needed, and the newest state has none.
        NO_FORCE = 1 << 4, "no-force";
        /// The measured force contradicts the predicted one.
        FORCE_MISMATCH = 1 << 5, "force-mismatch";
    }
    /// The names of the set bits.
    pub fn names(bits: u32) -> impl Iterator<Item = &'static str> {
        ALL.iter().filter(move |code| bits & code.number != 0).map(|code| code.name)
    }
}

codes! {
    /// Bits of `valve_limit`.
    valve_limit: u32 {
        /// The value that is wanted lies outside the range.
        RANGE = 1 << 0, "range";
        /// The value moves towards the wanted one at the greatest rate.
        RATE = 1 << 1, "rate";
    }
    /// The names of the set bits.
    pub fn names(bits: u32) -> impl Iterator<Item = &'static str> {
        ALL.iter().filter(move |code| bits & code.number != 0).map(|code| code.name)
    }
}
