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

    /// Texts with their number before them.
    pub fn texts(self, values: &[impl AsRef<str>]) -> Self {
        let message = self.word(values.len() as u32);
        values.iter().fold(message, |message, value| message.text(value.as_ref()))
    }

    /// Numbers of single precision.
    pub fn floats(mut self, values: &[f32]) -> Self {
        self.align(4);
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    /// Numbers of double precision; without any there is nothing to align.
    pub fn doubles(mut self, values: &[f64]) -> Self {
        if values.is_empty() {
            return self;
        }
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

/// Reads a message, value by value; none where it ends before, or where a text is no UTF-8.
pub struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// At the beginning of a message; none when its head is another one.
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        Some(Self { body: bytes.strip_prefix(&HEAD)?, at: 0 })
    }

    /// So many bytes, from the next multiple of their alignment on.
    fn take(&mut self, length: usize, alignment: usize) -> Option<&'a [u8]> {
        let begin = self.at.checked_next_multiple_of(alignment)?;
        let end = begin.checked_add(length)?;
        let found = self.body.get(begin..end)?;
        self.at = end;
        Some(found)
    }

    /// A 32-bit number.
    pub fn word(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4, 4)?.try_into().ok()?))
    }

    /// At most so many texts.
    pub fn texts(&mut self, most: usize) -> Option<Vec<&'a str>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.text()).collect()
    }

    /// At most so many numbers of double precision.
    pub fn doubles(&mut self, most: usize) -> Option<Vec<f64>> {
        let count = self.word()? as usize;
        if count > most {
            return None;
        }
        (0..count).map(|_| self.double()).collect()
    }

    /// A number of double precision.
    pub fn double(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.take(8, 8)?.try_into().ok()?))
    }

    /// A text, without the zero at its end.
    pub fn text(&mut self) -> Option<&'a str> {
        let length = self.word()? as usize;
        let bytes = self.take(length, 1)?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

/// Time (ns since 1970) and pressure (Pa) of a `sensor_msgs/FluidPressure`; none when the bytes are no such message.
pub fn fluid_pressure(bytes: &[u8]) -> Option<(u64, f64)> {
    let mut reader = Reader::new(bytes)?;
    let (seconds, nanoseconds) = (reader.word()?, reader.word()?);
    reader.text()?;
    let time_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
    (nanoseconds < 1_000_000_000).then_some((time_ns, reader.double()?))
}
