//! Names of regimes that a user chose.

/// Most named regimes of a database or a model.
pub const MAX_REGIMES: usize = 16;
/// Longest name in characters, of one byte each.
pub const MAX_LENGTH: usize = 32;
/// Names that mean something already, in any case of letters.
const TAKEN: [&str; 4] = ["free", "contact", "gripper", "unknown"];

/// The number of a named regime as a text: 3 is the first one in states, fields and answers.
pub(crate) fn unnamed(at: u8) -> &'static str {
    const TEXTS: [&str; MAX_REGIMES] = [
        "regime 3",
        "regime 4",
        "regime 5",
        "regime 6",
        "regime 7",
        "regime 8",
        "regime 9",
        "regime 10",
        "regime 11",
        "regime 12",
        "regime 13",
        "regime 14",
        "regime 15",
        "regime 16",
        "regime 17",
        "regime 18",
    ];
    TEXTS.get(usize::from(at)).copied().unwrap_or("unknown")
}

/// What is expected of a name, when this one is not it.
pub fn problem(name: &str) -> Option<String> {
    let sound = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if name.is_empty() || name.len() > MAX_LENGTH || !name.chars().all(sound) {
        return Some(format!("a name of 1 to {MAX_LENGTH} letters, digits, - and _"));
    }
    let taken = TAKEN.iter().find(|taken| taken.eq_ignore_ascii_case(name));
    taken.map(|taken| format!("another name: `{taken}` means something already, in any capitals"))
}

/// Everything that is wrong with the names of a database or a model, in words.
pub(crate) fn problems(names: &[String]) -> Vec<String> {
    let mut problems = Vec::new();
    if names.len() > MAX_REGIMES {
        problems.push(format!("regimes: expected at most {MAX_REGIMES} names, found {}", names.len()));
    }
    for (at, name) in names.iter().enumerate() {
        if let Some(expected) = problem(name) {
            problems.push(format!("regime {name:?}: expected {expected}"));
        }
        if names[..at].contains(name) {
            problems.push(format!("regime {name}: the name stands twice"));
        }
    }
    problems
}
