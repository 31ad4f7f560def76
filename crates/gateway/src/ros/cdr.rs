//! CDR, the encoding of ROS 2: little-endian, numbers aligned to their size after the head.

/// The head: plain CDR, little-endian.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// A message under construction.
pub struct Cdr(Vec<u8>);

impl Cdr {
    /// An empty message.
    pub fn new() -> Self {
        Self(HEAD.to_vec())
    }

    fn align(&mut self, size: usize) {
        self.0.resize(HEAD.len() + (self.0.len() - HEAD.len()).next_multiple_of(size), 0);
    }

    /// Adds a byte or a boolean.
    pub fn byte(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    /// Adds a 32-bit integer.
    pub fn word(mut self, value: u32) -> Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Adds a sequence of strings.
    pub fn strings(self, values: &[impl AsRef<str>]) -> Self {
        let message = self.word(values.len() as u32);
        values.iter().fold(message, |message, value| message.string(value.as_ref()))
    }

    /// Adds single-precision numbers.
    pub fn floats(mut self, values: &[f32]) -> Self {
        self.align(4);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    /// Adds double-precision numbers; no padding for an empty list.
    pub fn doubles(mut self, values: &[f64]) -> Self {
        if values.is_empty() {
            return self;
        }
        self.align(8);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    /// Adds a string.
    pub fn string(self, value: &str) -> Self {
        let mut message = self.word(value.len() as u32 + 1);
        message.0.extend(value.as_bytes());
        message.byte(0)
    }

    /// Adds a sequence of bytes.
    pub fn bytes(self, value: &[u8]) -> Self {
        let mut message = self.word(value.len() as u32);
        message.0.extend(value);
        message
    }

    /// Adds a `std_msgs/Header`: time (ns since 1970) and frame.
    pub fn header(self, time_ns: u64, frame: &str) -> Self {
        let seconds = time_ns / 1_000_000_000;
        self.word(seconds as u32).word((time_ns % 1_000_000_000) as u32).string(frame)
    }

    /// The message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// Reads a message value by value; `None` at its end, or if a string is not UTF-8.
pub struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// The beginning of a message; `None` for another head.
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        Some(Self { body: bytes.strip_prefix(&HEAD)?, at: 0 })
    }

    /// The next `length` bytes at a multiple of `alignment`.
    fn take(&mut self, length: usize, alignment: usize) -> Option<&'a [u8]> {
        let begin = self.at.checked_next_multiple_of(alignment)?;
        let end = begin.checked_add(length)?;
        let found = self.body.get(begin..end)?;
        self.at = end;
        Some(found)
    }

    /// A 32-bit integer.
    pub fn word(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4, 4)?.try_into().ok()?))
    }

    /// A sequence of at most `most` strings.
    pub fn strings(&mut self, most: usize) -> Option<Vec<&'a str>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.string()).collect()
    }

    /// A sequence of at most `most` double-precision numbers.
    pub fn doubles(&mut self, most: usize) -> Option<Vec<f64>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.double()).collect()
    }

    /// A double-precision number.
    pub fn double(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.take(8, 8)?.try_into().ok()?))
    }

    /// A string, without its terminating zero.
    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.word()? as usize;
        let bytes = self.take(length, 1)?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

/// Time (ns since 1970) and pressure (Pa) of a `sensor_msgs/FluidPressure`; `None` for other messages.
pub fn fluid_pressure(bytes: &[u8]) -> Option<(u64, f64)> {
    let mut reader = Reader::new(bytes)?;
    let (seconds, nanoseconds) = (reader.word()?, reader.word()?);
    reader.string()?;
    let time_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
    (nanoseconds < 1_000_000_000).then_some((time_ns, reader.double()?))
}
