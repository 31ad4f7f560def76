//! Key expressions in Zenoh's syntax, so that names mean the same here and on a network.
//!
//! A key expression is a `/`-separated list of non-empty chunks. `*` stands for exactly one chunk, `**` for any number of
//! chunks (none too), `$*` inside a chunk for any number of bytes. Chunks that begin with `@` are verbatim: no wildcard
//! reaches them. `#`, `?` and a bare `$` are not allowed.

use std::fmt;
use std::str::FromStr;

/// Longest accepted key expression in bytes; the transport's service names end there too.
pub const MAX_LEN: usize = 255;

/// Error in a key expression.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KeyExprError {
    /// Nothing between the quotes.
    #[error("a key expression is empty; expected for example `softtwin/*/state`")]
    Empty,
    /// Longer than `MAX_LEN`.
    #[error("a key expression has {found} bytes; expected at most {MAX_LEN}")]
    TooLong {
        /// Bytes found.
        found: usize,
    },
    /// A leading, trailing or doubled slash.
    #[error("`{text}` has an empty chunk at byte {at}; remove the leading, trailing or doubled `/`")]
    EmptyChunk {
        /// The text as given.
        text: String,
        /// Byte offset of the empty chunk.
        at: usize,
    },
    /// `#`, `?`, or `$` not followed by `*`.
    #[error(
        "`{text}` has `{found}` at byte {at}; `#`, `?` and a bare `$` are reserved (use `*`, `**` or `$*`)"
    )]
    Reserved {
        /// The text as given.
        text: String,
        /// Byte offset of the character.
        at: usize,
        /// The character.
        found: char,
    },
    /// A `*` that is neither a whole chunk nor part of `$*`.
    #[error("`{text}` has a `*` inside the chunk `{chunk}`; inside a chunk the wildcard is written `$*`")]
    StarInChunk {
        /// The text as given.
        text: String,
        /// The chunk.
        chunk: String,
    },
}

/// A key expression in canonical form.
///
/// Canonical means that two expressions that differ only in spelling are equal: `**/**` is `**`, `**/*` is `*/**`,
/// `$*$*` is `$*`, and a chunk that is only `$*` is `*`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct KeyExpr(String);

impl KeyExpr {
    /// Parses and brings to canonical form. Cost: linear in the length.
    ///
    /// # Errors
    /// [`KeyExprError`] says what is wrong and at which byte.
    pub fn new(text: &str) -> Result<Self, KeyExprError> {
        validate(text)?;
        Ok(Self(canonical(text)))
    }

    /// The canonical text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether any wildcard is left in it: a plain key names exactly one topic.
    pub fn is_wild(&self) -> bool {
        self.0.contains('*')
    }

    /// Whether some key is matched by both expressions. Against a plain key this is "does it match".
    ///
    /// Cost: at most (chunks of self) x (chunks of other) chunk comparisons, no recursion on the input.
    pub fn intersects(&self, other: &KeyExpr) -> bool {
        let left: Vec<&str> = self.0.split('/').collect();
        let right: Vec<&str> = other.0.split('/').collect();
        chunks_intersect(&left, &right)
    }

    /// Whether the plain topic name `key` is matched.
    pub fn matches(&self, key: &str) -> bool {
        KeyExpr::new(key).is_ok_and(|key| self.intersects(&key))
    }
}

impl fmt::Display for KeyExpr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for KeyExpr {
    type Err = KeyExprError;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::new(text)
    }
}

fn validate(text: &str) -> Result<(), KeyExprError> {
    if text.is_empty() {
        return Err(KeyExprError::Empty);
    }
    if text.len() > MAX_LEN {
        return Err(KeyExprError::TooLong { found: text.len() });
    }
    let mut at = 0;
    for chunk in text.split('/') {
        if chunk.is_empty() {
            return Err(KeyExprError::EmptyChunk { text: text.into(), at });
        }
        validate_chunk(text, chunk, at)?;
        at += chunk.len() + 1;
    }
    Ok(())
}

fn validate_chunk(text: &str, chunk: &str, at: usize) -> Result<(), KeyExprError> {
    if chunk == "*" || chunk == "**" {
        return Ok(());
    }
    let mut chars = chunk.char_indices().peekable();
    while let Some((offset, found)) = chars.next() {
        match found {
            '#' | '?' => return Err(KeyExprError::Reserved { text: text.into(), at: at + offset, found }),
            '$' if chars.next_if(|(_, next)| *next == '*').is_none() => {
                return Err(KeyExprError::Reserved { text: text.into(), at: at + offset, found });
            }
            '*' => return Err(KeyExprError::StarInChunk { text: text.into(), chunk: chunk.into() }),
            _ => {}
        }
    }
    Ok(())
}

/// Assumes a valid text.
fn canonical(text: &str) -> String {
    let mut out: Vec<String> = Vec::new();
    // A `**` is written after all `*` that follow it, which gives `*/**`.
    let mut pending_double = false;
    for chunk in text.split('/') {
        let mut chunk = chunk.to_owned();
        while chunk.contains("$*$*") {
            chunk = chunk.replace("$*$*", "$*");
        }
        match chunk.as_str() {
            "**" => pending_double = true,
            "*" | "$*" => out.push("*".into()),
            _ => {
                if std::mem::take(&mut pending_double) {
                    out.push("**".into());
                }
                out.push(chunk);
            }
        }
    }
    if pending_double {
        out.push("**".into());
    }
    out.join("/")
}

/// Row-by-row table over prefixes: `row[j]` = the first i chunks of `left` and the first j of `right` can match.
fn chunks_intersect(left: &[&str], right: &[&str]) -> bool {
    match_table(left, right, |l| *l == "**", |l, r| chunk_intersects(l, r), |c| c.starts_with('@'))
}

/// Whether two single chunks (neither `**`) share a string.
fn chunk_intersects(left: &str, right: &str) -> bool {
    if left == right {
        return true;
    }
    // Verbatim chunks are reached by no wildcard.
    if left.starts_with('@') || right.starts_with('@') {
        return false;
    }
    if left == "*" || right == "*" {
        return true;
    }
    let tokens = |chunk: &str| -> Vec<u8> { chunk.replace("$*", "*").into_bytes() };
    match_table(&tokens(left), &tokens(right), |b| *b == b'*', |l, r| l == r, |_| false)
}

/// The language intersection of two sequences in which `is_any` elements stand for any run of elements that are not
/// `barred`. The same table serves chunks (`**`) and bytes (`$*`).
fn match_table<T>(
    left: &[T],
    right: &[T],
    is_any: impl Fn(&T) -> bool,
    equal: impl Fn(&T, &T) -> bool,
    barred: impl Fn(&T) -> bool,
) -> bool {
    // `previous` is the row before the current element of `left`; the first row is the empty prefix of `left`.
    let mut previous = vec![true];
    for r in right {
        let reach = previous.last().copied().unwrap_or(false) && is_any(r);
        previous.push(reach);
    }
    for l in left {
        let mut row = vec![previous.first().copied().unwrap_or(false) && is_any(l)];
        for (j, r) in right.iter().enumerate() {
            let above = previous.get(j + 1).copied().unwrap_or(false); // l matched against nothing of right[..=j]
            let beside = row.get(j).copied().unwrap_or(false); // r matched against nothing
            let diagonal = previous.get(j).copied().unwrap_or(false);
            let hit = match (is_any(l), is_any(r)) {
                (true, true) => above || beside,
                (true, false) => above || (beside && !barred(r)),
                (false, true) => beside || (above && !barred(l)),
                (false, false) => diagonal && equal(l, r),
            };
            row.push(hit);
        }
        previous = row;
    }
    previous.last().copied().unwrap_or(false)
}
