//! Which column of a test's table holds what: what its description says, and what its headings tell.

use super::Deformation;
use super::fit::Family;
use formats::log::{Column, Log};
use formats::table::TableForm;
use formats::{Diagnostic, FormatError, file, unit};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// An enumeration whose values files and options name by these words.
macro_rules! words {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $variant:ident = $word:literal,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
        pub enum $name { $($(#[$doc])* #[serde(rename = $word)] $variant,)* }

        impl $name {
            /// The words of all values.
            pub const WORDS: &[&str] = &[$($word),*];

            /// The word of this value.
            pub fn word(self) -> &'static str {
                match self { $(Self::$variant => $word,)* }
            }
        }

        impl FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                match text {
                    $($word => Ok(Self::$variant),)*
                    _ => Err(format!("expected one of {}, found {text:?}", Self::WORDS.join(", "))),
                }
            }
        }
    };
}

words! {
    /// What was done to the specimen.
    TestKind {
        /// Bar or strip in tension, free sideways.
        Uniaxial = "uniaxial",
        /// Wide strip (pure shear).
        Planar = "planar",
        /// Equal tension in two directions, or a balloon's pole.
        Biaxial = "biaxial",
        /// Cylinder between lubricated plates; strain and stress may be given as positive numbers.
        Compression = "compression",
    }
}

impl TestKind {
    /// The deformation for which laws are evaluated.
    pub fn deformation(self) -> Deformation {
        match self {
            Self::Uniaxial | Self::Compression => Deformation::Uniaxial,
            Self::Planar => Deformation::Planar,
            Self::Biaxial => Deformation::Biaxial,
        }
    }
}

words! {
    /// What the column of the deformation holds.
    DeformationQuantity {
        /// Engineering strain: elongation over length.
        Strain = "strain",
        /// Logarithmic strain.
        TrueStrain = "true-strain",
        /// Stretch: length over undeformed length.
        Stretch = "stretch",
        /// Elongation (needs the specimen's length).
        Displacement = "displacement",
        /// Length (needs the undeformed one).
        Length = "length",
    }
}

words! {
    /// What the column of the load holds.
    LoadQuantity {
        /// Force over undeformed cross-section.
        NominalStress = "nominal-stress",
        /// Force over deformed cross-section (Cauchy).
        TrueStress = "true-stress",
        /// Force (needs the specimen's cross-section).
        Force = "force",
    }
}

words! {
    /// Which loading of a test is fitted.
    #[derive(Default)]
    LoadingBranch {
        /// First loading: the rows that reach farther than all before.
        #[default]
        First = "first",
        /// Loading of the last cycle, of a preconditioned specimen.
        Last = "last",
    }
}

words! {
    /// Where the curve of a test begins.
    #[derive(Default)]
    CurveOrigin {
        /// At the table's own origin.
        #[default]
        Table = "table",
        /// At the strain at which the stress of the first 30 % extrapolates to 0.
        Slack = "slack",
        /// At the stress to which the first 30 % extrapolate at no strain.
        Load = "load",
    }
}

words! {
    /// A law by the name that a command and a material file give it.
    LawName {
        /// One constant.
        NeoHookean = "neo-hookean",
        /// Two constants; neo-Hookean where the second is not needed.
        MooneyRivlin = "mooney-rivlin",
        /// Two constants; stiffens towards a limit.
        Gent = "gent",
        /// Two or three constants.
        Yeoh = "yeoh",
        /// One to three terms.
        Ogden = "ogden",
    }
}

impl LawName {
    /// The families that are tried for it.
    pub fn families(self) -> &'static [Family] {
        match self {
            Self::NeoHookean => &[Family::NeoHookean],
            Self::MooneyRivlin => &[Family::NeoHookean, Family::MooneyRivlin],
            Self::Gent => &[Family::Gent],
            Self::Yeoh => &[Family::Yeoh2, Family::Yeoh3],
            Self::Ogden => &[Family::Ogden1, Family::Ogden2, Family::Ogden3],
        }
    }
}

/// What is known of a column before its heading is read.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestColumn<Q> {
    /// Number from 1, or heading.
    pub column: Option<Column>,
    /// What it holds.
    pub quantity: Option<Q>,
    /// Its unit.
    pub unit: Option<String>,
}

impl<Q> TestColumn<Q> {
    fn unknown() -> Self {
        Self { column: None, quantity: None, unit: None }
    }
}

/// Where a test is, and what is known about it; the rest follows from headings and names.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestDescription {
    /// The table.
    pub file: PathBuf,
    /// What the table leaves open.
    #[serde(default)]
    pub table: TableForm,
    /// What was done to the specimen; by default told by the file's name.
    pub test: Option<TestKind>,
    /// Weight of the test's error.
    #[serde(default = "one")]
    pub weight: f64,
    /// True if the specimen has another modulus than the part: the test tells the shape of the law only.
    #[serde(default)]
    pub shape_only: bool,
    /// Column of the deformation.
    #[serde(default = "TestColumn::unknown")]
    pub deformation: TestColumn<DeformationQuantity>,
    /// Column of the load.
    #[serde(default = "TestColumn::unknown")]
    pub load: TestColumn<LoadQuantity>,
    /// Undeformed length between the marks or clamps, mm.
    pub length_mm: Option<f64>,
    /// Undeformed cross-section, mm2.
    pub area_mm2: Option<f64>,
    /// Which loading is fitted.
    #[serde(default)]
    pub branch: LoadingBranch,
    /// Where the curve begins.
    #[serde(default)]
    pub origin: CurveOrigin,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    test: Vec<TestDescription>,
}

/// Reads the descriptions of several tests; files are relative to the list's folder.
///
/// # Errors
/// I/O errors, unknown keys, sizes that are not above 0, tests of the shape only.
pub fn read_list(path: &Path) -> Result<Vec<TestDescription>, FormatError> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
    let mut tests = toml::from_str::<List>(&text)
        .map_err(|error| {
            let expected = "expected [[test]] with file, test, deformation, load, length_mm, area_mm2";
            FormatError::refused(path, format!("{expected}; {error}"))
        })?
        .test;
    if tests.iter().all(|test| test.shape_only) && !tests.is_empty() {
        let reason = "shape_only: expected a test without it, which tells the modulus, found none";
        return Err(FormatError::refused(path, reason));
    }
    for test in &mut tests {
        test.file = file::named_in(path, &test.file);
        let sizes =
            [("weight", Some(test.weight)), ("length_mm", test.length_mm), ("area_mm2", test.area_mm2)];
        for (name, size) in sizes {
            if let Some(found) = size.filter(|size| !(size.is_finite() && *size > 0.0)) {
                let place = format!("{name} of {}", test.file.display());
                return Err(FormatError::one(path, Diagnostic::new(place, "a finite number above 0", found)));
            }
        }
    }
    Ok(tests)
}

/// A column with its quantity and the factor to 1, mm, N or MPa.
pub(super) struct ChosenColumn<Q> {
    /// Its index in the table.
    pub(super) index: usize,
    /// What it holds.
    pub(super) quantity: Q,
    /// Factor from its unit.
    pub(super) factor: f64,
    /// Column, quantity and unit, for the report.
    pub(super) note: String,
}

/// Largest engineering strain that a column without a unit may reach to be a number: few elastomers reach more.
const LARGEST_STRAIN: f64 = 3.0;
/// Engineering strain that no elastomer reaches: a column without a unit is in percent. Between the two, the unit has to be given.
const LEAST_PERCENT: f64 = 20.0;

/// Column of the deformation.
///
/// # Errors
/// Expected and found, and the option that decides.
pub(super) fn deformation(
    log: &Log,
    given: &TestColumn<DeformationQuantity>,
) -> Result<ChosenColumn<DeformationQuantity>, String> {
    let (index, guessed) = column(log, given, "deformation", extension)?;
    let heading = &log.headings[index];
    let quantity = given
        .quantity
        .or(guessed)
        .ok_or_else(|| unnamed(log, index, "--deformation strain|true-strain|stretch|displacement|length"))?;
    let spelling = given.unit.clone().or_else(|| unit_of(heading));
    let largest = log.columns[index].iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(v.abs()));
    let (factor, unit) = match quantity {
        DeformationQuantity::Displacement | DeformationQuantity::Length => {
            let spelling = spelling.ok_or_else(|| unit_missing(log, index, "--deformation-unit mm"))?;
            (factor(&spelling, unit::Dimension::Length)?, spelling)
        }
        DeformationQuantity::Stretch => (1.0, "1".to_owned()),
        DeformationQuantity::Strain | DeformationQuantity::TrueStrain => match spelling.as_deref() {
            Some("%") => (0.01, "%".to_owned()),
            Some("1") => (1.0, "1".to_owned()),
            Some(other) => {
                return Err(format!(
                    "unit of a strain: expected 1 or %, found `{other}`; give --deformation-unit"
                ));
            }
            None if largest > LARGEST_STRAIN && largest <= LEAST_PERCENT => {
                return Err(format!(
                    "column {} `{heading}` reaches {largest:.2} and has no unit; say --deformation-unit 1 or --deformation-unit %",
                    index + 1
                ));
            }
            None if largest > LEAST_PERCENT => (0.01, format!("%, as it reaches {largest:.0}")),
            None => (1.0, format!("1, as it reaches {largest:.2}")),
        },
    };
    Ok(ChosenColumn { index, quantity, factor, note: note(log, index, quantity.word(), &unit) })
}

/// Column of the load.
///
/// # Errors
/// Expected and found, and the option that decides.
pub(super) fn load(
    log: &Log,
    given: &TestColumn<LoadQuantity>,
) -> Result<ChosenColumn<LoadQuantity>, String> {
    let (index, guessed) = column(log, given, "load", load_of)?;
    let quantity = given
        .quantity
        .or(guessed)
        .ok_or_else(|| unnamed(log, index, "--load nominal-stress|true-stress|force"))?;
    let expected =
        if quantity == LoadQuantity::Force { unit::Dimension::Force } else { unit::Dimension::Pressure };
    let spelling = given.unit.clone().or_else(|| unit_of(&log.headings[index]));
    let spelling = spelling.ok_or_else(|| {
        unit_missing(
            log,
            index,
            if quantity == LoadQuantity::Force { "--load-unit N" } else { "--load-unit MPa" },
        )
    })?;
    let factor = factor(&spelling, expected)?;
    let heading = log.headings[index].to_lowercase();
    let said = given.quantity.is_some()
        || ["nominal", "engineering", "true", "cauchy", "force", "load", "kraft"]
            .iter()
            .any(|word| heading.contains(word));
    let mut note = note(log, index, quantity.word(), &spelling);
    if !said {
        note += "; nominal is assumed, the heading does not say";
    }
    Ok(ChosenColumn { index, quantity, factor, note })
}

fn note(log: &Log, index: usize, word: &str, unit: &str) -> String {
    let quantity = word.replace('-', " ");
    let heading = &log.headings[index];
    let heading = if heading.is_empty() { String::new() } else { format!(" `{heading}`") };
    format!("column {}{heading} as {quantity} in {unit}", index + 1)
}

/// Given column, or the best by heading.
fn column<Q: Copy>(
    log: &Log,
    given: &TestColumn<Q>,
    what: &str,
    role: fn(&str) -> Option<(u32, Q)>,
) -> Result<(usize, Option<Q>), String> {
    let roles: Vec<Option<(u32, Q)>> = log.headings.iter().map(|heading| role(heading)).collect();
    if let Some(column) = &given.column {
        let index = index(log, column, what)?;
        return match &log.doubts[index] {
            Some(doubt) => Err(format!("column {}: {doubt}", index + 1)),
            None => Ok((index, roles[index].map(|(_, quantity)| quantity))),
        };
    }
    // A channel that was not connected is exported as zeros or empty cells: it is no candidate.
    let moves = |index: &usize| {
        let mut values = log.columns[*index].iter().filter(|v| v.is_finite());
        let first = values.next();
        log.doubts[*index].is_some() || values.any(|v| Some(v) != first)
    };
    let candidates: Vec<(usize, u32, Q)> = (0..roles.len())
        .filter(moves)
        .filter_map(|index| roles[index].map(|(rank, quantity)| (index, rank, quantity)))
        .collect();
    let least = candidates.iter().map(|(_, rank, _)| *rank).min();
    let best: Vec<_> = candidates.iter().filter(|(_, rank, _)| Some(*rank) == least).collect();
    match best[..] {
        [(index, _, quantity)] => match &log.doubts[*index] {
            Some(doubt) => Err(format!("column {}: {doubt}", index + 1)),
            None => Ok((*index, Some(*quantity))),
        },
        [] => Err(format!(
            "no heading of a column whose values change names the {what}; found {}; give --{what}-column, --{what} and --{what}-unit",
            columns(log)
        )),
        ref several => {
            let numbers: Vec<String> = several.iter().map(|(index, ..)| (index + 1).to_string()).collect();
            Err(format!(
                "columns {} may be the {what}; found {}; give --{what}-column",
                numbers.join(", "),
                columns(log)
            ))
        }
    }
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
    let range = |(index, (heading, values)): (usize, (&String, &Vec<f64>))| {
        let finite = values.iter().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        format!("{} `{heading}` from {low:.4} to {high:.4}", index + 1)
    };
    log.headings.iter().zip(&log.columns).enumerate().map(range).collect::<Vec<_>>().join(", ")
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

fn factor(spelling: &str, expected: unit::Dimension) -> Result<f64, String> {
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
fn extension(heading: &str) -> Option<(u32, DeformationQuantity)> {
    let lower = heading.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    if has(&["rate", "energy", "speed", "lateral", "transverse", "quer", "width", "stress", "time"]) {
        return None;
    }
    let is_length = unit_of(heading)
        .and_then(|spelling| unit::unit(&spelling))
        .is_some_and(|(q, _)| q == unit::Dimension::Length);
    match () {
        () if has(&["stretch", "lambda", "\u{3bb}", "extension ratio"]) => {
            Some((2, DeformationQuantity::Stretch))
        }
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
            Some((4, DeformationQuantity::Displacement))
        }
        () if is_length && has(&["length", "gauge", "distance"]) => Some((5, DeformationQuantity::Length)),
        () if has(&["strain", "elongation", "epsilon", "\u{3b5}", "deformation", "dehnung"]) => {
            if has(&["true", "log", "hencky"]) {
                return Some((3, DeformationQuantity::TrueStrain));
            }
            Some((u32::from(!has(&["eng", "nominal"])), DeformationQuantity::Strain))
        }
        () => None,
    }
}

/// Rank and quantity of a load's heading.
fn load_of(heading: &str) -> Option<(u32, LoadQuantity)> {
    let lower = heading.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    match () {
        () if has(&["rate", "strength"]) => None,
        () if has(&["stress", "spannung", "sigma", "\u{3c3}"]) => {
            if has(&["true", "cauchy"]) {
                return Some((2, LoadQuantity::TrueStress));
            }
            Some((u32::from(!has(&["eng", "nominal", "piola"])), LoadQuantity::NominalStress))
        }
        () if has(&["force", "load", "kraft"]) => Some((3, LoadQuantity::Force)),
        () => None,
    }
}
