//! Columns of a block, as its second line gives them; numbers touch each other.

/// Widest column, and most columns of a line.
const MAX: usize = 64;

/// Whole numbers, then others, as `(3i9,6e21.13e3)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    integers: usize,
    integer_width: usize,
    real_width: usize,
}

impl Columns {
    pub(super) fn parse(line: &str) -> Option<Self> {
        let mut parts = line.trim().strip_prefix('(')?.strip_suffix(')')?.split(',');
        let (integers, 'i', integer_width) = part(parts.next()?)? else { return None };
        let real_width = match parts.next() {
            Some(text) => part(text).filter(|(_, letter, _)| *letter != 'i')?.2,
            None => MAX,
        };
        Some(Self { integers, integer_width, real_width })
    }

    /// Whole numbers of a line, up to the first blank; `None` for one that is none.
    pub(super) fn integers(self, line: &str) -> impl Iterator<Item = Option<u64>> {
        let columns = line.as_bytes().chunks(self.integer_width).take(self.integers);
        let words = columns.map(|column| std::str::from_utf8(column).unwrap_or_default().trim());
        words.take_while(|word| !word.is_empty()).map(|word| word.parse().ok())
    }

    /// The three numbers behind the whole ones; those left out are zero.
    pub(super) fn point(self, line: &str) -> Option<[f64; 3]> {
        let mut point = [0.0; 3];
        for (k, value) in point.iter_mut().enumerate() {
            let from = self.integers * self.integer_width + k * self.real_width;
            let to = (from + self.real_width).min(line.len());
            let word = line.get(from..to).unwrap_or_default().trim();
            if !word.is_empty() {
                *value = word.parse().ok()?;
            }
        }
        Some(point)
    }
}

/// `6e21.13e3`: count, letter, width.
fn part(text: &str) -> Option<(usize, char, usize)> {
    let text = text.trim();
    let at = text.find(|c: char| c.is_ascii_alphabetic())?;
    let letter = char::from(text.as_bytes()[at]).to_ascii_lowercase();
    let width = text[at + 1..].split('.').next()?.parse().ok()?;
    let count = text[..at].parse().ok()?;
    ((1..=MAX).contains(&width) && (1..=MAX).contains(&count)).then_some((count, letter, width))
}

/// Whether a line ends a block: `-1`, `N,R5.3,LOC,       -1,` or `EN,R5.5,ATTR,       -1,`.
pub(super) fn is_end(line: &str) -> bool {
    let mut words = line.split(',').map(str::trim).filter(|word| !word.is_empty());
    match words.next() {
        Some("-1") => words.next().is_none(),
        Some(word) => {
            matches!(word.to_ascii_uppercase().as_str(), "N" | "EN") && words.next_back() == Some("-1")
        }
        None => false,
    }
}
