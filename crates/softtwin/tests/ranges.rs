//! Every numeric argument of every command has a range, and says so when a value is outside.

use clap::error::ErrorKind;
use clap::{Arg, Command, Subcommand};
use std::any::TypeId;

fn tool() -> Command {
    softtwin::Command::augment_subcommands(Command::new("softtwin"))
}

/// Values outside every range, for the type that an argument is parsed into; empty if the argument is not a number.
fn impossible(arg: &Arg) -> &'static [&'static str] {
    let parsed = arg.get_value_parser().type_id();
    let whole = [TypeId::of::<u16>(), TypeId::of::<u32>(), TypeId::of::<u64>(), TypeId::of::<usize>()];
    if parsed == TypeId::of::<f64>() {
        &["1e300", "nan", "inf", "five", ""]
    } else if whole.iter().any(|kind| parsed == *kind) {
        &["18446744073709551615", "1e18", "-1", "1.5", ""]
    } else {
        &[]
    }
}

/// The commands with those below them, as their path on the command line.
fn paths(command: &Command, path: &[String], found: &mut Vec<(Vec<String>, Command)>) {
    for sub in command.get_subcommands() {
        let path = [path, &[sub.get_name().to_owned()]].concat();
        found.push((path.clone(), sub.clone()));
        paths(sub, &path, found);
    }
}

#[test]
fn argument_outside_its_range_is_refused_with_the_range() {
    let mut commands = Vec::new();
    paths(&tool(), &["softtwin".to_owned()], &mut commands);
    let mut tried = 0;
    for (path, command) in &commands {
        // Every seed is good.
        for arg in command.get_arguments().filter(|arg| arg.get_long().is_some_and(|long| long != "seed")) {
            let long = arg.get_long().expect("filtered");
            let times = arg.get_num_args().map_or(1, |range| range.min_values().max(1));
            for value in impossible(arg) {
                let given = std::iter::once(format!("--{long}")).chain(vec![(*value).to_owned(); times]);
                let error = tool().try_get_matches_from(path.iter().cloned().chain(given)).expect_err(long);
                let text = error.to_string();
                let place = format!("{} --{long} {value}: {text}", path.join(" "));
                let kinds = [ErrorKind::ValueValidation, ErrorKind::InvalidValue, ErrorKind::UnknownArgument];
                assert!(kinds.contains(&error.kind()), "{place}");
                let stated = ["from", "is not in", "invalid digit", "invalid value", "unexpected"];
                assert!(stated.iter().any(|words| text.contains(words)), "{place}");
                tried += 1;
            }
        }
    }
    assert!(tried > 100, "only {tried} values were tried: the arguments were not found");
}
