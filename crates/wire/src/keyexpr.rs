//! Key expressions in Zenoh's syntax, so that names mean the same here and on a network.
//!
//! A key expression is a `/`-separated list of non-empty chunks. `*` stands for exactly one chunk, `**` for any number of
//! chunks (none too), `$*` inside a chunk for any number of bytes. Chunks that begin with `@` are verbatim: no wildcard
//! reaches them. `#`, `?` and a bare `$` are not allowed.

use std::fmt;

/// Longest accepted key expression in bytes; the transport's service names end there too.
pub const MAX_LEN: usize = 255;

/// Error in a key expression.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum KeyExprError {
    /// Nothing between the quotes.
    #[error("a key expression is empty; expected for example `softtwin/*/state`")]
    Empty,
    /// Longer than `MAX_LEN`.
    #[error("a key expression has {found} bytes; expected at most {MAX_LEN}")]
    TooLong { found: usize },
    /// A leading, trailing or doubled slash.
    #[error("`{text}` has an empty chunk at byte {at}; remove the leading, trailing or doubled `/`")]
    EmptyChunk { text: String, at: usize },
    /// `#`, `?`, or `$` not followed by `*`.
    #[error(
        "`{text}` has `{found}` at byte {at}; `#`, `?` and a bare `$` are reserved (use `*`, `**` or `$*`)"
    )]
    Reserved { text: String, at: usize, found: char },
    /// A `*` that is neither a whole chunk nor part of `$*`.
    #[error("`{text}` has a `*` inside the chunk `{chunk}`; inside a chunk the wildcard is written `$*`")]
    StarInChunk { text: String, chunk: String },
}

/// A valid key expression.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct KeyExpr(String);

impl KeyExpr {
    /// Parses. Cost: linear in the length.
    ///
    /// # Errors
    /// [`KeyExprError`] says what is wrong and at which byte.
    pub fn new(text: &str) -> Result<Self, KeyExprError> {
        validate(text)?;
        Ok(Self(text.to_owned()))
    }

    /// The expression as given.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether the topic name `key` is matched.
    ///
    /// Cost: at most (chunks of self) x (chunks of key) chunk comparisons, no recursion on the input.
    pub fn matches(&self, key: &str) -> bool {
        let (chunks, names): (Vec<&str>, Vec<&str>) = (self.0.split('/').collect(), key.split('/').collect());
        let (is_any, is_verbatim) = (|chunk: &&str| *chunk == "**", |name: &&str| name.starts_with('@'));
        validate(key).is_ok() && gives(&chunks, &names, is_any, |a, b| chunk_matches(a, b), is_verbatim)
    }
}

impl fmt::Display for KeyExpr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
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

/// Whether a chunk other than `**` matches that of a name. No wildcard reaches a verbatim chunk, which begins with `@`.
fn chunk_matches(chunk: &str, name: &str) -> bool {
    if chunk.starts_with('@') || name.starts_with('@') {
        return chunk == name;
    }
    let bytes = chunk.replace("$*", "*").into_bytes();
    gives(&bytes, name.as_bytes(), |byte| *byte == b'*', |a, b| a == b, |_| false)
}

/// Whether a pattern, whose `is_any` parts stand for any run of elements that are not `is_barred`, gives `text`. The same table
/// serves chunks (`**`) and bytes (`*`).
fn gives<T>(
    pattern: &[T],
    text: &[T],
    is_any: impl Fn(&T) -> bool,
    equal: impl Fn(&T, &T) -> bool,
    is_barred: impl Fn(&T) -> bool,
) -> bool {
    // Whether the parts so far give the first 0, 1, ... elements.
    let mut given: Vec<bool> = (0..=text.len()).map(|count| count == 0).collect();
    for part in pattern {
        let (mut shorter_before, mut shorter) = (false, false);
        for (count, given) in given.iter_mut().enumerate() {
            let before = *given;
            *given = match (count.checked_sub(1).and_then(|last| text.get(last)), is_any(part)) {
                (None, is_any) => before && is_any,
                (Some(element), true) => before || shorter && !is_barred(element),
                (Some(element), false) => shorter_before && equal(part, element),
            };
            (shorter_before, shorter) = (before, *given);
        }
    }
    given.last() == Some(&true)
}
