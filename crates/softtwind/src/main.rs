//! The program `softtwind`; see the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    softtwind::main()
}
