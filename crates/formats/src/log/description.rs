//! What the columns of a bench's table are, and a proposed mapping. Columns whose unit could not be read from the heading
//! are comments of the mapping, to be filled in by hand.

use super::Log;
use crate::unit;
use rom::statistics::{ends, median};
use serde::Serialize;

/// Properties of a column.
struct Known {
    number: usize,
    heading: String,
    unit: Option<String>,
    quantity: Option<unit::Dimension>,
    low: f64,
    high: f64,
    missing: usize,
    /// Median step, if all values are integers.
    integer_step: Option<f64>,
    /// Days of a spreadsheet, if it is the time.
    is_in_days: bool,
    doubt: Option<String>,
    time: TimeSign,
}

/// Why a column may be the time, weakest first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum TimeSign {
    None,
    /// The first column, which rises.
    Rises,
    /// It rises and has a unit of time, but another name.
    Unit,
    Named,
    NamedWithUnit,
}

/// Words of headings without a unit: input or output, and unit of the name.
const WORDS: [(&[&str], &str, &str); 5] = [
    (&["press", "druck", "presi"], "input", "mpa"),
    (&["angle", "winkel", "bend", "theta"], "output", "deg"),
    (&["force", "kraft"], "output", "n"),
    (&["curvature"], "output", "per_mm"),
    (&["position", "tip", "marker"], "output", "mm"),
];
/// Words of wanted values: the measured ones are inputs.
const WANTED: [&str; 7] = ["command", "cmd", "desired", "target", "wanted", "setpoint", "soll"];
/// Words of the confidence of a tracked position.
const CONFIDENCE: [&str; 2] = ["likelihood", "confidence"];
/// Ends of headings of absolute pressures.
const ABSOLUTE: [&str; 3] = ["(a)", "abs", "psia"];
/// Beginnings of headings of times.
const TIME_NAMES: [&str; 8] = ["time", "t_", "zeit", "temps", "tiempo", "elapsed", "stamp", "date"];
/// Units of times since 1970 by their size: ns from 1973 on, us, ms, s.
const EPOCHS: [(f64, &str); 4] = [(1e17, "ns"), (1e14, "us"), (1e11, "ms"), (1e8, "s")];
/// Days since 1900 of the years 1968 to 2064, as spreadsheets write times; the steps of a log are fractions of a day.
const SPREADSHEET_DAYS: [f64; 2] = [25_000.0, 60_000.0];
const LONGEST_STEP_DAYS: f64 = 0.01;
/// Median step of integers from which they are ms instead of s.
const MS_STEP: f64 = 2.0;

/// Describes a table and proposes a mapping of its columns; `name` stands in the mapping's first line.
#[must_use]
pub fn describe(log: &Log, name: &str) -> TableDescription {
    let known: Vec<Known> = (0..log.columns.len()).map(|at| Known::of(log, at)).collect();
    // The name of a time with a unit of time says most; numbers that rise, as those of frames do, least.
    let time = (0..known.len())
        .filter(|at| known[*at].time > TimeSign::None)
        .max_by_key(|at| (known[*at].time, known.len() - at));
    TableDescription {
        rows: log.rows(),
        first_line: log.lines.first().copied(),
        separator: log.separator.to_string(),
        time_column: time.map(|at| at + 1),
        damaged_lines: log.damaged.iter().map(ToString::to_string).collect(),
        remarks: remarks(log, &known, time),
        mapping: proposal(name, &known, time),
        columns: known.into_iter().map(TableColumn::from).collect(),
    }
}

/// What a table contains.
#[derive(Serialize)]
pub struct TableDescription {
    pub rows: usize,
    pub first_line: Option<usize>,
    pub separator: String,
    /// Number of the time's column, counted from 1; `None` if no column rises throughout.
    pub time_column: Option<usize>,
    pub damaged_lines: Vec<String>,
    pub columns: Vec<TableColumn>,
    /// How regular the time is, and what could not be guessed.
    pub remarks: Vec<String>,
    /// The proposed mapping, as TOML.
    #[serde(skip)]
    pub mapping: String,
}

/// A column of a table.
#[derive(Serialize)]
pub struct TableColumn {
    /// Number, counted from 1.
    pub column: usize,
    pub heading: String,
    /// Unit in the heading.
    pub unit: Option<String>,
    pub min: Option<f64>,
    pub max: Option<f64>,
    /// Rows without a value.
    pub missing: usize,
    pub constant: bool,
    /// Why it was not read.
    pub doubt: Option<String>,
}

impl From<Known> for TableColumn {
    fn from(column: Known) -> Self {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        Self {
            constant: column.is_constant(),
            column: column.number,
            heading: column.heading,
            unit: column.unit,
            min: finite(column.low),
            max: finite(column.high),
            missing: column.missing,
            doubt: column.doubt,
        }
    }
}

/// How regular the time is, and what could not be guessed.
fn remarks(log: &Log, columns: &[Known], time: Option<usize>) -> Vec<String> {
    let pace = time
        .map_or("no column rises throughout: name the time's column or a rate".into(), |at| pace(log, at));
    let is_unknown = |column: &&Known| {
        column.quantity.is_none() && Some(column.number) != time.map(|at| at + 1) && !column.is_constant()
    };
    let unknown: Vec<String> =
        columns.iter().filter(is_unknown).map(|column| column.number.to_string()).collect();
    let unknown = (!unknown.is_empty()).then(|| {
        format!(
            "not guessed: unit and meaning of column(s) {}; they are comments of the mapping",
            unknown.join(", ")
        )
    });
    [Some(pace), unknown].into_iter().flatten().collect()
}

/// Steps of a time column, in its unit: median, smallest and largest, repeated stamps and steps back.
fn pace(log: &Log, column: usize) -> String {
    let mut steps: Vec<f64> = log.columns[column].windows(2).map(|pair| pair[1] - pair[0]).collect();
    let count = |is_so: &dyn Fn(f64) -> bool| steps.iter().filter(|step| is_so(**step)).count();
    let (repeated, back) = (count(&|step| step == 0.0), count(&|step| step < 0.0));
    steps.retain(|step| step.is_finite());
    steps.sort_by(f64::total_cmp);
    let [least, median, most] = [0, steps.len() / 2, steps.len().saturating_sub(1)]
        .map(|rank| steps.get(rank).copied().unwrap_or(f64::NAN));
    let mut text =
        format!("column {}: steps of {median:.5} (median), {least:.5} to {most:.5}, in its unit", column + 1);
    if repeated + back > 0 {
        text += &format!("; {repeated} repeated stamps, {back} steps back");
    }
    text
}

impl Known {
    fn of(log: &Log, column: usize) -> Self {
        let values = &log.columns[column];
        let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let [low, high] = ends(values);
        let heading = log.headings[column].clone();
        let unit = unit::in_heading(&heading).map(str::to_owned);
        let quantity = unit.as_deref().and_then(unit::unit).map(|(quantity, _)| quantity);
        let rises =
            finite.len() == values.len() && finite.windows(2).all(|pair| pair[1] >= pair[0]) && high > low;
        let is_integer = finite.iter().all(|v| v.fract() == 0.0);
        let steps = finite.windows(2).map(|pair| pair[1] - pair[0]);
        let step = median(steps);
        let integer_step = step.filter(|_| is_integer);
        let is_in_days = low >= SPREADSHEET_DAYS[0]
            && high <= SPREADSHEET_DAYS[1]
            && step.is_some_and(|step| step > 0.0 && step <= LONGEST_STEP_DAYS);
        let lower = heading.to_lowercase();
        let is_named = lower == "t" || TIME_NAMES.iter().any(|name| lower.starts_with(name));
        let time = match quantity {
            Some(unit::Dimension::Time) if is_named => TimeSign::NamedWithUnit,
            Some(unit::Dimension::Time) if rises || heading.len() == unit.as_deref().map_or(0, str::len) => {
                TimeSign::Unit
            }
            None if is_named && !finite.is_empty() => TimeSign::Named,
            None if column == 0 && rises => TimeSign::Rises,
            _ => TimeSign::None,
        };
        Self {
            number: column + 1,
            heading,
            unit,
            quantity,
            low,
            high,
            missing: values.len() - finite.len(),
            integer_step,
            is_in_days,
            doubt: log.doubts[column].clone(),
            time,
        }
    }

    fn is_in_pixels(&self) -> bool {
        self.unit.as_ref().is_some_and(|unit| unit.trim().eq_ignore_ascii_case(unit::PIXELS))
    }

    /// True for a time that rises by 1 and has neither name nor unit: rows or frames.
    fn counts(&self) -> bool {
        self.time == TimeSign::Rises && self.integer_step == Some(1.0)
    }

    /// True if the heading has one of these words.
    fn has(&self, words: &[&str]) -> bool {
        let heading = self.heading.to_lowercase();
        words.iter().any(|word| heading.contains(word))
    }

    /// Input or output, and the unit of its name, by the unit or the words of the heading.
    fn kind(&self) -> Option<(&'static str, &'static str)> {
        let by_unit = self.quantity.and_then(|quantity| {
            Some(match quantity {
                unit::Dimension::Pressure => ("input", "mpa"),
                unit::Dimension::Length => ("output", "mm"),
                unit::Dimension::Force => ("output", "n"),
                unit::Dimension::Angle => ("output", "deg"),
                unit::Dimension::Voltage => ("output", "v"),
                unit::Dimension::Current => ("output", "a"),
                unit::Dimension::Volume => ("output", "ml"),
                unit::Dimension::Curvature => ("output", "per_mm"),
                unit::Dimension::Time | unit::Dimension::Number => return None,
            })
        });
        let words =
            || WORDS.iter().find(|(words, ..)| self.has(words)).map(|(_, kind, suffix)| (*kind, *suffix));
        by_unit.or_else(|| self.is_in_pixels().then_some(("output", "mm"))).or_else(words)
    }

    /// Heading as a name without unit.
    fn stem(&self) -> String {
        let heading = match (&self.unit, self.heading.split_once(['(', '['])) {
            (Some(_), Some((heading, _))) => heading.trim(),
            _ => self.heading.as_str(),
        };
        let own = self.unit.as_deref().and_then(|unit| heading.strip_suffix(unit)).unwrap_or(heading);
        let letters = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
        let name: String = own.chars().map(letters).collect();
        match name.trim_matches('_') {
            "" => format!("column{}", self.number),
            stem => stem.to_owned(),
        }
    }

    fn is_constant(&self) -> bool {
        self.low >= self.high
    }
}

fn proposal(file: &str, columns: &[Known], time: Option<usize>) -> String {
    let mut text = format!(
        "# Proposed by softtwin inspect for {file}: check every unit against the picture.\n\n[time]\n"
    );
    text += &time_proposal(time.map(|at| &columns[at]));
    let others = || {
        let is_other =
            |column: &&Known| Some(column.number) != time.map(|at| at + 1) && column.low <= column.high;
        columns.iter().filter(is_other)
    };
    let is_measured = |column: &Known| column.kind() == Some(("input", "mpa")) && !column.has(&WANTED);
    let has_measured = others().any(is_measured);
    let mut names: Vec<String> = Vec::new();
    for column in others() {
        let (kind, suffix) = column.kind().unwrap_or(("output", "UNIT"));
        let stem = column.stem();
        let mut name = format!("{stem}_{suffix}");
        if names.contains(&name) {
            name = format!("{stem}_{}_{suffix}", column.number);
        }
        text += "\n";
        text += &channel_proposal(column, columns, (kind, &name), has_measured);
        names.push(name);
    }
    text
}

fn time_proposal(column: Option<&Known>) -> String {
    match column {
        Some(column) if column.counts() => {
            format!("column = {} # counts rows or frames:\nrate_hz = 0 # of them per second\n", column.number)
        }
        Some(column) => {
            let has_unit = matches!(column.time, TimeSign::Unit | TimeSign::NamedWithUnit);
            let spelling = column.unit.as_deref().filter(|_| has_unit);
            let of_days = Some("d").filter(|_| column.is_in_days);
            let of_size = EPOCHS.iter().find(|(from, _)| column.low >= *from).map(|(_, unit)| *unit);
            let of_step = column.integer_step.filter(|step| *step >= MS_STEP).map(|_| "ms");
            let known = spelling.or(of_days).or(of_size).or(of_step).unwrap_or("s");
            let note =
                if spelling.is_some() { "" } else { " # not in the heading: ns, us, ms, s, min, h or d" };
            format!("column = {}\nunit = \"{known}\"{note}\n", column.number)
        }
        None => {
            "# no column rises throughout: column = N with unit, or\nrate_hz = 0 # rows per second; 1 for settled states without time\n".into()
        }
    }
}

/// An entry of the mapping; as comments with the reason, where somebody has to decide.
fn channel_proposal(
    column: &Known,
    columns: &[Known],
    (kind, name): (&str, &str),
    has_measured: bool,
) -> String {
    let mut entry = format!(
        "[[{kind}]] # {:.5} .. {:.5}\nname = \"{name}\"\ncolumn = {}\nunit = \"{}\"\n",
        column.low,
        column.high,
        column.number,
        column.unit.as_deref().unwrap_or("?")
    );
    if column.is_in_pixels() {
        entry += "mm_per_px = 0 # to be measured\n";
    }
    // `tip x, tip y, tip likelihood`
    let group = |known: &Known| known.heading.rsplit_once(' ').map(|(group, _)| group.to_owned());
    let confidence = columns[column.number..].iter().take(3).find(|other| other.has(&CONFIDENCE));
    if let Some(other) = confidence.filter(|other| group(other).is_some() && group(other) == group(column)) {
        entry += &format!("confidence = {}\n", other.number);
    }
    let why = match column.kind() {
        _ if column.is_constant() => "constant",
        _ if column.has(&CONFIDENCE) => "confidence of a position",
        Some(("input", _)) if has_measured && column.has(&WANTED) => "wanted; the measured one is the input",
        None if column.counts() => "counts rows",
        None => "input or output and unit not known",
        _ if column.is_in_pixels() => "size of a pixel not known",
        _ if column.quantity.is_none() && column.has(&ABSOLUTE) => {
            "an absolute pressure: offset = -0.1013 MPa in its unit makes it one above the atmosphere's"
        }
        _ if column.quantity.is_none() => "unit not known",
        _ => "",
    };
    if why.is_empty() {
        return entry;
    }
    entry.lines().fold(format!("# {why}:\n"), |text, line| text + "# " + line + "\n")
}
