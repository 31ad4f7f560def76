//! Sequential reader of the numbers of a .msh file, ASCII or binary.

use crate::error::Diagnostic;
use std::str::FromStr;

/// Longest word: a number, a version or a section's name.
const LONGEST_WORD: usize = 64;

/// Position in the file.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    binary: bool,
    big_endian: bool,
    section: String,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, binary: false, big_endian: false, section: String::new() }
    }

    /// Position for messages.
    pub(crate) fn place(&self) -> String {
        format!("{}, byte {}", self.section, self.at)
    }

    fn diagnostic(&self, expected: &str, found: impl std::fmt::Display) -> Diagnostic {
        Diagnostic::new(self.place(), expected, found)
    }

    /// Name of the next section; `None` at the end of the file.
    pub(crate) fn section(&mut self) -> Result<Option<String>, Diagnostic> {
        self.skip_blanks();
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let word = self.word()?;
        let name = word
            .strip_prefix('$')
            .ok_or_else(|| self.diagnostic("a section ($Name)", format!("`{word}`")))?;
        self.section = name.to_owned();
        self.skip_line_end();
        Ok(Some(name.to_owned()))
    }

    /// Skips the rest of the section and `$EndName`.
    pub(crate) fn end_of(&mut self, name: &str) -> Result<(), Diagnostic> {
        let end = format!("$End{name}");
        let rest = &self.bytes[self.at..];
        // `$` is rare in binary data, so looking only there keeps the scan linear.
        let found =
            rest.iter().enumerate().find(|(i, b)| **b == b'$' && rest[*i..].starts_with(end.as_bytes()));
        let (offset, _) = found.ok_or_else(|| self.diagnostic(&end, "the end of the file"))?;
        self.at += offset + end.len();
        Ok(())
    }

    /// Switches to binary numbers; the integer 1 that follows gives the byte order.
    pub(crate) fn binary(&mut self) -> Result<(), Diagnostic> {
        self.skip_line_end();
        let one: [u8; 4] = self.take("the integer 1")?;
        self.big_endian = one == 1_i32.to_be_bytes();
        if !self.big_endian && one != 1_i32.to_le_bytes() {
            return Err(self.diagnostic("the integer 1 in either byte order", format!("{one:?}")));
        }
        self.binary = true;
        Ok(())
    }

    /// Reads a signed tag, dimension or type.
    pub(crate) fn int(&mut self) -> Result<i64, Diagnostic> {
        self.number("an integer", |bytes| i32::from_le_bytes(bytes).into())
    }

    /// Reads a count or a node's tag.
    pub(crate) fn size(&mut self) -> Result<u64, Diagnostic> {
        self.number("a size", u64::from_le_bytes)
    }

    /// Reads a coordinate.
    pub(crate) fn double(&mut self) -> Result<f64, Diagnostic> {
        self.number("a number", f64::from_le_bytes)
    }

    /// Reads a number in ASCII, or in binary from little-endian bytes.
    fn number<T: FromStr, const N: usize>(
        &mut self,
        expected: &str,
        value: impl Fn([u8; N]) -> T,
    ) -> Result<T, Diagnostic> {
        if !self.binary {
            return self.text_number();
        }
        let mut bytes = self.take(expected)?;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(value(bytes))
    }

    /// Reads a number in ASCII, in binary files too.
    pub(crate) fn text_number<T: FromStr>(&mut self) -> Result<T, Diagnostic> {
        let word = self.word()?;
        word.parse().map_err(|_| self.diagnostic("a number", format!("`{word}`")))
    }

    /// Reads the next word.
    pub(crate) fn word(&mut self) -> Result<String, Diagnostic> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().take(LONGEST_WORD).take_while(|b| b.is_ascii_graphic()).count();
        if length == 0 {
            let found = if rest.is_empty() { "the end of the file" } else { "bytes that are no text" };
            return Err(self.diagnostic("a word", found));
        }
        self.at += length;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    /// Reads a name in double quotes.
    pub(crate) fn quoted(&mut self) -> Result<String, Diagnostic> {
        self.skip_blanks();
        let rest = &self.bytes[self.at..];
        let inner =
            rest.strip_prefix(b"\"").ok_or_else(|| self.diagnostic("a name in double quotes", "none"))?;
        let length = inner.iter().position(|b| *b == b'"' || *b == b'\n').filter(|end| inner[*end] == b'"');
        let length = length.ok_or_else(|| self.diagnostic("a closing quote", "the end of the line"))?;
        self.at += length + 2;
        Ok(String::from_utf8_lossy(&inner[..length]).into_owned())
    }

    fn take<const N: usize>(&mut self, expected: &str) -> Result<[u8; N], Diagnostic> {
        let bytes = self.bytes[self.at..]
            .first_chunk()
            .ok_or_else(|| self.diagnostic(expected, "the end of the file"))?;
        self.at += N;
        Ok(*bytes)
    }

    fn skip_blanks(&mut self) {
        self.at += self.bytes[self.at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
    }

    fn skip_line_end(&mut self) {
        let line = self.bytes[self.at..].iter().position(|b| *b == b'\n');
        self.at += line.map_or(0, |end| end + 1);
    }
}
