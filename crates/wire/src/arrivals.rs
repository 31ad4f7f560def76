//! Which sequence numbers of one sender came, so that readers count each sample once: received or lost.

/// A number counts as late or repeated if it is less than this below the newest; an older one begins the count again.
const WINDOW: u64 = 1024;
const WORDS: usize = (WINDOW / 64) as usize;

/// Relation of a number to those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// Newer than all before it.
    New {
        /// Numbers between it and the newest before it.
        missing: u64,
    },
    /// Was missing until now.
    Late,
    /// Came before.
    Repeated,
    /// Less than the window older than the first.
    Before,
    /// As old as the window or older: the sender's numbers begin again.
    Again,
}

impl Arrival {
    /// Change of the number of lost samples.
    pub fn lost(self) -> i64 {
        match self {
            Self::New { missing } => i64::try_from(missing).unwrap_or(i64::MAX),
            Self::Late => -1,
            Self::Repeated | Self::Before | Self::Again => 0,
        }
    }
}

/// The numbers of one run of a sender that came.
#[derive(Debug, Clone, Copy)]
pub struct Arrivals {
    first: u64,
    newest: u64,
    /// Bit `seq % WINDOW` of each number of the window that came.
    came: [u64; WORDS],
}

impl Arrivals {
    /// Begins with a number that came.
    pub fn new(seq: u64) -> Self {
        let mut arrivals = Self { first: seq, newest: seq, came: [0; WORDS] };
        arrivals.set(seq, true);
        arrivals
    }

    /// The newest number.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Classifies a number without noting it.
    pub fn classify(&self, seq: u64) -> Arrival {
        match seq.checked_sub(self.newest) {
            Some(0) => Arrival::Repeated,
            Some(step) => Arrival::New { missing: step - 1 },
            None if self.newest - seq >= WINDOW => Arrival::Again,
            None if seq < self.first => Arrival::Before,
            None if self.has(seq) => Arrival::Repeated,
            None => Arrival::Late,
        }
    }

    /// Notes that a number came.
    pub fn take(&mut self, seq: u64) -> Arrival {
        let arrival = self.classify(seq);
        match arrival {
            Arrival::New { missing } => {
                let between = missing.min(WINDOW);
                (seq - between..seq).for_each(|absent| self.set(absent, false));
                self.newest = seq;
                self.set(seq, true);
            }
            Arrival::Late => self.set(seq, true),
            Arrival::Again => *self = Self::new(seq),
            Arrival::Repeated | Arrival::Before => {}
        }
        arrival
    }

    fn has(&self, seq: u64) -> bool {
        self.came.get(word(seq)).is_some_and(|word| word >> (seq % 64) & 1 == 1)
    }

    fn set(&mut self, seq: u64, came: bool) {
        if let Some(word) = self.came.get_mut(word(seq)) {
            *word = *word & !(1 << (seq % 64)) | u64::from(came) << (seq % 64);
        }
    }
}

fn word(seq: u64) -> usize {
    (seq % WINDOW / 64) as usize
}
