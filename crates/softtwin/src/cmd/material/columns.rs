//! Columns of a test by their headings.

use super::description::{Channel, Extension, Load};
use formats::log::{Column, Log, unit};

/// A column with its quantity and the factor to 1, mm, N or MPa.
pub struct Chosen<Q> {
    /// Index.
    pub index: usize,
    /// Quantity.
    pub quantity: Q,
    /// Factor.
    pub factor: f64,
    /// Column, quantity and unit, for the report.
    pub note: String,
}

/// Largest engineering strain without a unit; larger ones are percent.
const LARGEST_STRAIN: f64 = 20.0;

/// Column of the deformation.
///
/// # Errors
/// Expected and found, and the option that decides.
pub fn deformation(log: &Log, given: &Channel<Extension>) -> Result<Chosen<Extension>, String> {
    let (index, guessed) = column(log, given, "deformation", extension)?;
    let heading = &log.headings[index];
    let quantity = given
        .quantity
        .or(guessed)
        .ok_or_else(|| unnamed(log, index, "--deformation strain|true-strain|stretch|displacement|length"))?;
    let spelling = given.unit.clone().or_else(|| unit_of(heading));
    let largest = log.columns[index].iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(v.abs()));
    let (factor, unit) = match quantity {
        Extension::Displacement | Extension::Length => {
            let spelling = spelling.ok_or_else(|| unit_missing(log, index, "--deformation-unit mm"))?;
            (factor(&spelling, unit::Quantity::Length)?, spelling)
        }
        Extension::Stretch => (1.0, "1".to_owned()),
        Extension::Strain | Extension::TrueStrain => match spelling.as_deref() {
            Some("%") => (0.01, "%".to_owned()),
            Some("1") => (1.0, "1".to_owned()),
            Some(other) => {
                return Err(format!(
                    "unit of a strain: expected 1 or %, found `{other}`; give --deformation-unit"
                ));
            }
            None if largest > LARGEST_STRAIN => (0.01, format!("%, as it reaches {largest:.0}")),
            None => (1.0, format!("1, as it reaches {largest:.2}")),
        },
    };
    Ok(Chosen { index, quantity, factor, note: note(log, index, &name(quantity), &unit) })
}

/// Column of the load.
///
/// # Errors
/// Expected and found, and the option that decides.
pub fn load(log: &Log, given: &Channel<Load>) -> Result<Chosen<Load>, String> {
    let (index, guessed) = column(log, given, "load", load_of)?;
    let quantity = given
        .quantity
        .or(guessed)
        .ok_or_else(|| unnamed(log, index, "--load nominal-stress|true-stress|force"))?;
    let expected = if quantity == Load::Force { unit::Quantity::Force } else { unit::Quantity::Pressure };
    let spelling = given.unit.clone().or_else(|| unit_of(&log.headings[index]));
    let spelling = spelling.ok_or_else(|| {
        unit_missing(log, index, if quantity == Load::Force { "--load-unit N" } else { "--load-unit MPa" })
    })?;
    let factor = factor(&spelling, expected)?;
    let heading = log.headings[index].to_lowercase();
    let said = given.quantity.is_some()
        || ["nominal", "engineering", "true", "cauchy", "force", "load", "kraft"]
            .iter()
            .any(|word| heading.contains(word));
    let mut note = note(log, index, &name(quantity), &spelling);
    if !said {
        note += "; nominal is assumed, the heading does not say";
    }
    Ok(Chosen { index, quantity, factor, note })
}

fn name(quantity: impl clap::ValueEnum) -> String {
    quantity.to_possible_value().map_or_else(String::new, |value| value.get_name().replace('-', " "))
}

fn note(log: &Log, index: usize, quantity: &str, unit: &str) -> String {
    let heading = &log.headings[index];
    let heading = if heading.is_empty() { String::new() } else { format!(" `{heading}`") };
    format!("column {}{heading} as {quantity} in {unit}", index + 1)
}

/// Given column, or the best by heading.
fn column<Q: Copy>(
    log: &Log,
    given: &Channel<Q>,
    what: &str,
    role: fn(&str) -> Option<(u32, Q)>,
) -> Result<(usize, Option<Q>), String> {
    let roles: Vec<Option<(u32, Q)>> = log.headings.iter().map(|heading| role(heading)).collect();
    if let Some(column) = &given.column {
        let index = index(log, column, what)?;
        return Ok((index, roles[index].map(|(_, quantity)| quantity)));
    }
    let found = roles
        .iter()
        .enumerate()
        .filter_map(|(index, role)| role.map(|(rank, quantity)| (rank, index, quantity)));
    let best = found.min_by_key(|(rank, index, _)| (*rank, *index));
    best.map(|(_, index, quantity)| (index, Some(quantity))).ok_or_else(|| {
        format!(
            "no heading names the {what}; found {}; give --{what}-column, --{what} and --{what}-unit",
            columns(log)
        )
    })
}

/// Position of a column by its number, or by its heading in any case, with or without the unit.
fn index(log: &Log, column: &Column, what: &str) -> Result<usize, String> {
    let found: Vec<usize> = match column {
        Column::Number(number) => (0..log.columns.len()).filter(|at| at + 1 == *number).collect(),
        Column::Heading(name) => {
            let same = |heading: &str| heading.trim().eq_ignore_ascii_case(name.trim());
            let named =
                |heading: &String| same(heading) || same(heading.split(['(', '[']).next().unwrap_or(""));
            (0..log.headings.len()).filter(|at| named(&log.headings[*at])).collect()
        }
    };
    match found[..] {
        [at] => Ok(at),
        _ => {
            let wanted = match column {
                Column::Number(number) => format!("column {number}, counted from 1"),
                Column::Heading(name) => format!("one column `{name}`"),
            };
            Err(format!("{what}: expected {wanted}, found {}", columns(log)))
        }
    }
}

fn columns(log: &Log) -> String {
    let of = |(at, (heading, values)): (usize, (&String, &Vec<f64>))| {
        let finite = values.iter().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        format!("{} `{heading}` from {low:.4} to {high:.4}", at + 1)
    };
    log.headings.iter().zip(&log.columns).enumerate().map(of).collect::<Vec<_>>().join(", ")
}

fn unnamed(log: &Log, index: usize, option: &str) -> String {
    format!(
        "column {} `{}`: its heading does not say which quantity it is; give {option}",
        index + 1,
        log.headings[index]
    )
}

fn unit_missing(log: &Log, index: usize, option: &str) -> String {
    format!(
        "column {} `{}`: its heading has no unit; give it, such as {option}",
        index + 1,
        log.headings[index]
    )
}

fn factor(spelling: &str, expected: unit::Quantity) -> Result<f64, String> {
    match unit::unit(spelling) {
        Some((quantity, factor)) if quantity == expected => Ok(factor),
        Some((quantity, _)) => {
            Err(format!("unit `{spelling}`: expected one of {expected:?}, found one of {quantity:?}"))
        }
        None => Err(format!("unit `{spelling}`: expected one of {}", unit::known())),
    }
}

/// Unit in a heading; `1` for dimensionless spellings.
fn unit_of(heading: &str) -> Option<String> {
    let lower = heading.to_lowercase();
    if lower.contains('%') || lower.contains("percent") || lower.ends_with("_pct") {
        return Some("%".into());
    }
    if ["mm/mm", "m/m", "[-]", "(-)", "[1]", "(1)"].iter().any(|part| lower.contains(part)) {
        return Some("1".into());
    }
    unit::in_heading(heading).map(str::to_owned)
}

/// Rank and quantity of a deformation's heading; lower ranks are preferred.
fn extension(heading: &str) -> Option<(u32, Extension)> {
    let lower = heading.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    if has(&["rate", "energy", "speed", "lateral", "transverse", "width", "stress", "time"]) {
        return None;
    }
    let is_length = unit_of(heading)
        .and_then(|spelling| unit::unit(&spelling))
        .is_some_and(|(q, _)| q == unit::Quantity::Length);
    match () {
        () if has(&["stretch", "lambda", "\u{3bb}", "extension ratio"]) => Some((2, Extension::Stretch)),
        () if is_length
            && has(&[
                "displacement",
                "extension",
                "elongation",
                "crosshead",
                "travel",
                "position",
                "deformation",
                "disp",
                "stroke",
                "weg",
            ]) =>
        {
            Some((4, Extension::Displacement))
        }
        () if is_length && has(&["length", "gauge", "distance"]) => Some((5, Extension::Length)),
        () if has(&["strain", "elongation", "epsilon", "\u{3b5}", "deformation", "dehnung"]) => {
            if has(&["true", "log", "hencky"]) {
                return Some((3, Extension::TrueStrain));
            }
            Some((u32::from(!has(&["eng", "nominal"])), Extension::Strain))
        }
        () => None,
    }
}

/// Rank and quantity of a load's heading.
fn load_of(heading: &str) -> Option<(u32, Load)> {
    let lower = heading.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    match () {
        () if has(&["rate", "strength"]) => None,
        () if has(&["stress", "spannung", "sigma", "\u{3c3}"]) => {
            if has(&["true", "cauchy"]) {
                return Some((2, Load::TrueStress));
            }
            Some((u32::from(!has(&["eng", "nominal", "piola"])), Load::NominalStress))
        }
        () if has(&["force", "load", "kraft"]) => Some((3, Load::Force)),
        () => None,
    }
}
