//! CDR, the encoding of ROS 2: little-endian, numbers at multiples of their size counted from behind the head.

/// The head: plain CDR, little-endian.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// A message in the making.
pub struct Cdr(Vec<u8>);

impl Cdr {
    /// An empty message.
    pub fn new() -> Self {
        Self(HEAD.to_vec())
    }

    fn align(&mut self, size: usize) {
        self.0.resize(HEAD.len() + (self.0.len() - HEAD.len()).next_multiple_of(size), 0);
    }

    /// A byte, or a truth value.
    pub fn byte(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    /// A 32-bit number, signed or not.
    pub fn word(mut self, value: u32) -> Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Numbers of double precision.
    pub fn doubles(mut self, values: &[f64]) -> Self {
        self.align(8);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    /// A text.
    pub fn text(self, value: &str) -> Self {
        let mut message = self.word(value.len() as u32 + 1);
        message.0.extend(value.as_bytes());
        message.byte(0)
    }

    /// Bytes with their number before them.
    pub fn bytes(self, value: &[u8]) -> Self {
        let mut message = self.word(value.len() as u32);
        message.0.extend(value);
        message
    }

    /// `std_msgs/Header`: time (ns since 1970) and frame.
    pub fn header(self, time_ns: u64, frame: &str) -> Self {
        let seconds = time_ns / 1_000_000_000;
        self.word(seconds as u32).word((time_ns % 1_000_000_000) as u32).text(frame)
    }

    /// The message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// Time (ns since 1970) and pressure (Pa) of a `sensor_msgs/FluidPressure`; none when the bytes are no such message.
pub fn fluid_pressure(bytes: &[u8]) -> Option<(u64, f64)> {
    let body = bytes.strip_prefix(&HEAD)?;
    let word = |at: usize| Some(u32::from_le_bytes(body.get(at..at + 4)?.try_into().ok()?));
    let (seconds, nanoseconds, length) = (word(0)?, word(4)?, word(8)? as usize);
    let at = 12_usize.checked_add(length)?.checked_next_multiple_of(8)?;
    let value = body.get(at..at.checked_add(8)?)?;
    let time_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
    (nanoseconds < 1_000_000_000).then_some((time_ns, f64::from_le_bytes(value.try_into().ok()?)))
}
