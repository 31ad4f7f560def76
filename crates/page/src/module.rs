//! The functions of the WebAssembly module: the page puts bytes into memory that it got from [`take`], calls, and reads the answer at
//! [`answer_at`].

use crate::figure::{Card, Figure};
use rom::model::Model;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::BTreeMap;

/// What the module keeps between two calls.
#[derive(Default)]
struct Kept {
    /// Bytes from the page.
    given: Vec<u8>,
    /// Answer to the last call: a message for the page, or why there is none.
    answer: Vec<u8>,
    figure: Option<Figure>,
}

thread_local! {
    static KEPT: RefCell<Kept> = RefCell::default();
}

/// A question of the page.
#[derive(Deserialize)]
struct Question {
    /// Time of a model with a past, ms; none: a settled state.
    t_ms: Option<f64>,
    /// Values of the inputs by key.
    inputs: BTreeMap<String, f64>,
}

/// First message to the page, as the live view's.
#[derive(Serialize)]
struct Hello<'a> {
    r#type: &'static str,
    models: [&'a Card; 1],
}

/// Makes the answer of a call. Returns 1 for a message, 0 for the reason why there is none.
fn answer(make: impl FnOnce(&mut Kept) -> Result<Vec<u8>, String>) -> u32 {
    KEPT.with_borrow_mut(|kept| {
        let made = make(kept);
        let is_made = made.is_ok();
        kept.answer = made.unwrap_or_else(String::into_bytes);
        is_made.into()
    })
}

fn opened(kept: &mut Kept) -> Result<&mut Figure, String> {
    kept.figure.as_mut().ok_or_else(|| "no model was opened".into())
}

/// Memory for this many bytes from the page.
#[unsafe(no_mangle)]
pub extern "C" fn take(bytes: usize) -> *mut u8 {
    KEPT.with_borrow_mut(|kept| {
        kept.given = vec![0; bytes];
        kept.given.as_mut_ptr()
    })
}

/// Where the answer is.
#[unsafe(no_mangle)]
pub extern "C" fn answer_at() -> *const u8 {
    KEPT.with_borrow(|kept| kept.answer.as_ptr())
}

/// How many bytes it has.
#[unsafe(no_mangle)]
pub extern "C" fn answer_length() -> usize {
    KEPT.with_borrow(|kept| kept.answer.len())
}

/// Opens the given model: its name's length and number of nodes (both u32), the name, the numbers of its nodes in the whole model, the file.
/// The answer is the first message.
#[unsafe(no_mangle)]
pub extern "C" fn open() -> u32 {
    answer(|kept| {
        let given = std::mem::take(&mut kept.given);
        let (name, numbers, file) = parts(&given).ok_or("the model of this page is cut")?;
        let model = Model::from_bytes(file).map_err(|error| error.to_string())?;
        let figure = Figure::of_part(&model, name, numbers).map_err(|error| error.to_string())?;
        let hello = Hello { r#type: "hello", models: [figure.card()] };
        let message = serde_json::to_vec(&hello).map_err(|error| error.to_string())?;
        kept.figure = Some(figure);
        Ok(message)
    })
}

fn parts(given: &[u8]) -> Option<(String, Vec<u32>, &[u8])> {
    let word = |bytes: &[u8]| bytes.first_chunk().map(|word| u32::from_le_bytes(*word));
    let (length, count) = (word(given)? as usize, word(given.get(4..)?)? as usize);
    let (name, rest) = given.get(8..)?.split_at_checked(length)?;
    let (numbers, file) = rest.split_at_checked(count.checked_mul(4)?)?;
    let numbers = numbers.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word));
    Some((String::from_utf8_lossy(name).into_owned(), numbers.collect(), file))
}

/// The answer is the message with the surface.
#[unsafe(no_mangle)]
pub extern "C" fn mesh() -> u32 {
    answer(|kept| opened(kept)?.mesh().map(<[u8]>::to_vec).ok_or_else(|| "no surface".into()))
}

/// Answers the given question (JSON) with a frame.
#[unsafe(no_mangle)]
pub extern "C" fn predict() -> u32 {
    answer(|kept| {
        let question: Question = serde_json::from_slice(&kept.given).map_err(|error| error.to_string())?;
        let figure = opened(kept)?;
        match question.t_ms {
            Some(t_ms) => figure.step((1e6 * t_ms) as u64, &question.inputs),
            None => figure.predict(&question.inputs),
        }
    })
}
