//! Tests of `src/config/input.rs` that need its private parts.

use super::*;

#[derive(Deserialize)]
struct Table {
    inputs: InputSpecs,
}

fn problems_of(text: &str) -> Vec<String> {
    let table: Table = toml::from_str(&format!("[inputs]\n{text}")).expect("inputs");
    let mut found = Vec::new();
    problems(&table.inputs, |name| name == "mu_mpa", std::iter::empty(), &mut Problems::new(&mut found, "a"));
    found
}

#[test]
fn an_input_is_given_a_number_or_measured() {
    let table: Table =
        toml::from_str("[inputs]\na_n = 3\nb_n = \"measured\"\nc_n = { max = 4, sigma = 0.1 }\n")
            .expect("inputs");
    let of = |name: &str| table.inputs[name];
    assert_eq!((of("a_n").given(), of("a_n").measured()), (Some(3.0), None));
    assert_eq!((of("b_n").given(), of("b_n").measured()), (None, Some(WithinSpec::default())));
    let within = WithinSpec { max: 4.0, sigma: Some(0.1), ..WithinSpec::default() };
    assert_eq!((of("c_n").given(), of("c_n").measured()), (None, Some(within)));
    for wrong in ["a_n = \"guessed\"", "a_n = { least = 1.0 }"] {
        assert!(toml::from_str::<Table>(&format!("[inputs]\n{wrong}")).is_err(), "{wrong}");
    }
}

#[test]
fn impossible_inputs_are_named() {
    for (wrong, name) in [
        ("a_n = nan", "a_n"),
        ("a_n = { min = 2, max = 1 }", "a_n"),
        ("a_n = { sigma = 0 }", "a_n"),
        ("mu_mpa = \"measured\"", "mu_mpa"),
    ] {
        let found = problems_of(wrong);
        assert!(found.len() == 1 && found[0].contains(name), "{wrong}: {found:?}");
    }
    let alike = ["a", "b"].map(|first| format!("{first}{} = \"measured\"\n", "x".repeat(31)));
    assert!(problems_of(&alike.concat())[0].contains(&"x".repeat(31)));
    let many: String = (0..7).map(|at| format!("x{at}_n = \"measured\"\n")).collect();
    assert!(problems_of(&many)[0].contains("found 7"));
    assert_eq!(problems_of("a_n = 1\nb_n = \"measured\"\nmu_mpa = 0.7\n"), Vec::<String>::new());
}
