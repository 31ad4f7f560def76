//! A model as a page in a browser shows it: its surface, a slider for each input, and the frame of any state.
//!
//! `softtwin view` asks a [`Figure`] on the server and sends the answer to its pages. An exported page has the same code in itself,
//! compiled to WebAssembly ([`module`]), so both show the same numbers.

mod figure;
pub mod frame;
#[cfg(target_arch = "wasm32")]
mod module;

pub use figure::{Card, Figure};
pub use frame::Shape;
