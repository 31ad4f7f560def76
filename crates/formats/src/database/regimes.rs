//! The column `regime`: words that mean something already, or names of the user's own.

use super::words::{ObstacleKind, REGIMES};
use crate::error::Diagnostic;
use crate::table::Row;
use rom::names::{MAX_REGIMES, problem};
use rom::snapshots::RegimeKind;

/// The regimes of a table as its rows name them: either words that mean something already, or names.
#[derive(Clone, Debug, Default)]
pub struct Regimes {
    /// Names of the user's own, in the order in which they were found.
    pub names: Vec<String>,
    /// The first of the other words, and where it stands.
    word: Option<(String, String)>,
}

impl Regimes {
    /// The regime of a row.
    pub(super) fn of(
        &mut self,
        row: &Row<'_>,
        column: usize,
    ) -> Result<(ObstacleKind, RegimeKind), Diagnostic> {
        self.find(row.text(column), &format!("{}, column regime", row.place()))
    }

    /// The regime of this name, found at this place.
    ///
    /// # Errors
    /// What cannot be a name, a name beside words that mean something already, one name too many.
    pub fn find(&mut self, text: &str, place: &str) -> Result<(ObstacleKind, RegimeKind), Diagnostic> {
        let known = REGIMES.iter().find(|(word, _)| *word == text).map(|(_, kind)| *kind);
        if let Some(kind) = known {
            let word = self.word.get_or_insert_with(|| (text.to_owned(), place.to_owned()));
            return match self.names.first() {
                None => Ok(kind),
                Some(name) => Err(mixed(place, &word.0, name)),
            };
        }
        if let Some((word, at)) = &self.word {
            let expected = format!(
                "one of free, contact, gripper beside `{word}` ({at}), or names of your own for all states"
            );
            return Err(Diagnostic::new(place, expected, format!("`{text}`")));
        }
        if let Some(expected) = problem(text) {
            let expected = format!("free, contact, gripper, or {expected}");
            return Err(Diagnostic::new(place, expected, format!("`{text}`")));
        }
        let found = self.names.iter().position(|name| name == text);
        if found.is_none() && self.names.len() == MAX_REGIMES {
            let expected = format!("at most {MAX_REGIMES} names of regimes");
            return Err(Diagnostic::new(place, expected, format!("`{text}`, one more")));
        }
        let at = found.unwrap_or_else(|| {
            self.names.push(text.to_owned());
            self.names.len() - 1
        });
        Ok((ObstacleKind::Plate, RegimeKind::Named(at as u8)))
    }
}

fn mixed(place: &str, word: &str, name: &str) -> Diagnostic {
    let expected = format!(
        "a name of your own, as `{name}` before (free, contact and gripper go by the onset pressure, names of your own by a boundary \
         learned from the states)"
    );
    Diagnostic::new(place, expected, format!("`{word}`"))
}
