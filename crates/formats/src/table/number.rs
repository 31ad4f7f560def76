//! Numbers and clocks of tables that somebody else wrote, decided by column.
//!
//! `2.100` is 2.1 or 2100, `03/04/2024` is in March or in April, `12:30` is half past twelve or 750 s. One cell does not tell; the other cells of its
//! column, or the decimal separator of the other columns, often do. Where they do not, the column has no values but a doubt, which is
//! the error of whoever asks for it. A remark names what was read by the convention of the table.

use super::{DateOrder, Table, TableForm};

/// Words of a missing value.
const MISSING: [&str; 8] = ["nan", "na", "n/a", "#n/a", "null", "none", "-", "--"];
/// What separates groups of thousands and nothing else.
const GROUPERS: [char; 5] = ['\'', '\u{2019}', '\u{a0}', '\u{202f}', '\u{2009}'];
const DAY_S: f64 = 86_400.0;

/// True if the line is neither empty nor a comment.
pub(super) fn is_content(line: &str) -> bool {
    !line.is_empty() && !line.starts_with(['#', '%', '!']) && !line.starts_with("//")
}

/// How a number is written, as far as the cell alone tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Spelling {
    /// Nothing, or a word for it.
    Missing,
    /// No decimal separator and no group that a decimal separator could be.
    Whole,
    /// Decimal point: `0.5`, `1,234.5`, `1,234,567`.
    Point,
    /// Decimal comma: `0,5`, `1.234,5`, `1.234.567`.
    Comma,
    /// `2.100`: 2.1, or 2100.
    PointOrGroup,
    /// `2,100`.
    CommaOrGroup,
    /// No number.
    Words,
}

/// Spelling of a cell; with `blanks`, a blank may separate groups of thousands.
pub(super) fn spelling(cell: &str, blanks: bool) -> Spelling {
    if cell.is_empty() || MISSING.contains(&cell.to_ascii_lowercase().as_str()) {
        return Spelling::Missing;
    }
    let size = cell.strip_prefix(['-', '+', '\u{2212}']).unwrap_or(cell);
    let (mantissa, exponent) = size.split_once(['e', 'E']).unwrap_or((size, "0"));
    let is_grouper = |c: char| GROUPERS.contains(&c) || blanks && c == ' ';
    let is_written = |c: char| c.is_ascii_digit() || c == '.' || c == ',' || is_grouper(c);
    if !mantissa.contains(|c: char| c.is_ascii_digit())
        || !mantissa.chars().all(is_written)
        || exponent.parse::<i32>().is_err()
    {
        return if cell.parse::<f64>().is_ok() { Spelling::Whole } else { Spelling::Words };
    }
    let (points, commas) = (mantissa.matches('.').count(), mantissa.matches(',').count());
    let is_decimal = |separator: char, group: &dyn Fn(char) -> bool| {
        let Some((whole, part)) = mantissa.rsplit_once(separator) else { return false };
        part.chars().all(|c| c.is_ascii_digit())
            && (whole.chars().all(|c| c.is_ascii_digit()) || is_grouped(whole, group))
    };
    let or_group = |separator: char, plain: Spelling, doubtful: Spelling| {
        let doubt = is_grouped(mantissa, &|c| c == separator) && exponent == "0";
        if doubt { doubtful } else { plain }
    };
    match (points, commas) {
        (0, 0) if mantissa.chars().all(|c| c.is_ascii_digit()) || is_grouped(mantissa, &is_grouper) => {
            Spelling::Whole
        }
        (1, 0) if is_decimal('.', &is_grouper) => or_group('.', Spelling::Point, Spelling::PointOrGroup),
        (0, 1) if is_decimal(',', &is_grouper) => or_group(',', Spelling::Comma, Spelling::CommaOrGroup),
        (1, 1..) if is_decimal('.', &|c| c == ',') => Spelling::Point,
        (1.., 1) if is_decimal(',', &|c| c == '.') => Spelling::Comma,
        (0, 2..) if is_grouped(mantissa, &|c| c == ',') => Spelling::Point,
        (2.., 0) if is_grouped(mantissa, &|c| c == '.') => Spelling::Comma,
        _ => Spelling::Words,
    }
}

/// True for `1 234 567` with any of these separators: a first group of one to three digits that is no 0, then groups of three.
fn is_grouped(text: &str, is_separator: &dyn Fn(char) -> bool) -> bool {
    let mut groups = text.split(is_separator);
    let is_digits = |group: &str| group.bytes().all(|byte| byte.is_ascii_digit());
    let leads = groups.next().is_some_and(|first| (1..=3).contains(&first.len()) && is_digits(first));
    leads
        && !text.starts_with('0')
        && text.contains(is_separator)
        && groups.all(|g| g.len() == 3 && is_digits(g))
}

/// Number of a cell in a column with this decimal separator; NaN for a missing value or for words.
fn number(cell: &str, spelling: Spelling, decimal: char) -> f64 {
    let contradicts = match decimal {
        '.' => spelling == Spelling::Comma,
        _ => spelling == Spelling::Point,
    };
    if contradicts || matches!(spelling, Spelling::Missing | Spelling::Words) {
        return f64::NAN;
    }
    if spelling == Spelling::Whole
        && let Ok(value) = cell.parse()
    {
        return value;
    }
    let plain = |c: char| match c {
        '\u{2212}' => Some('-'),
        c if c == decimal => Some('.'),
        c if c.is_ascii_digit() || "+-eE".contains(c) => Some(c),
        _ => None,
    };
    cell.chars().filter_map(plain).collect::<String>().parse().unwrap_or(f64::NAN)
}

/// A number in a table's head, where no column tells more: `None` for words, missing values and what may be two numbers.
pub(super) fn number_of_head(cell: &str, decimal_comma: bool) -> Option<f64> {
    let spelling = spelling(cell, false);
    let decimal = match spelling {
        Spelling::Comma | Spelling::CommaOrGroup if decimal_comma => ',',
        Spelling::CommaOrGroup => return None,
        _ => '.',
    };
    Some(number(cell, spelling, decimal)).filter(|value| value.is_finite())
}

/// True for a number or a clock.
pub(super) fn is_number(cell: &str, blanks: bool) -> bool {
    !matches!(spelling(cell, blanks), Spelling::Missing | Spelling::Words) || clock(cell).is_some()
}

/// Values of a table's columns.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    /// By column; NaN if missing or no number.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Why a column has no values, although it has numbers or clocks: they can be read in two ways.
    pub(crate) doubts: Vec<Option<String>>,
    /// What was read by a convention that the cell alone does not show.
    pub(crate) remarks: Vec<String>,
}

/// A cell, for messages: its line and text.
type Seen = Option<(usize, String)>;

/// What the cells of a column show about decimal separators; the first cell of each kind.
#[derive(Debug, Default)]
struct Evidence {
    point: Seen,
    comma: Seen,
    point_or_group: Seen,
    comma_or_group: Seen,
    /// A whole number of three digits: above it groups begin.
    three_digits: Seen,
    /// Some whole number has more than three digits and no separators: thousands are not grouped.
    is_ungrouped: bool,
    clocks: Vec<(usize, Clock)>,
}

impl Evidence {
    fn add(&mut self, line: usize, cell: &str, spelling: Spelling) {
        let first = |seen: &mut Seen| _ = seen.get_or_insert_with(|| (line, cell.to_owned()));
        match spelling {
            Spelling::Point => first(&mut self.point),
            Spelling::Comma => first(&mut self.comma),
            Spelling::PointOrGroup => first(&mut self.point_or_group),
            Spelling::CommaOrGroup => first(&mut self.comma_or_group),
            Spelling::Whole => match cell.trim_start_matches(['-', '+']).len() {
                3 => first(&mut self.three_digits),
                length => self.is_ungrouped |= length > 3,
            },
            Spelling::Missing | Spelling::Words => {}
        }
    }

    /// The column's decimal separator, with a remark if it is that of the table; or the doubt.
    fn decimal(&self, table: [&Seen; 2]) -> Result<(char, Option<String>), String> {
        let told = |(line, cell): &(usize, String)| format!("`{cell}` in line {line}");
        let doubtful = self.point_or_group.as_ref().or(self.comma_or_group.as_ref());
        let with_groups = |decimal: char| {
            let grouped = if decimal == '.' { &self.comma_or_group } else { &self.point_or_group };
            let grouped = grouped.as_ref().map(told);
            (
                decimal,
                grouped.map(|cell| {
                    format!("{cell} has groups of thousands, as the decimal separator is `{decimal}`")
                }),
            )
        };
        match (&self.point, &self.comma, doubtful, table) {
            (Some(point), Some(comma), ..) => {
                Err(format!("{} has a decimal point, {} a decimal comma", told(point), told(comma)))
            }
            (Some(_), None, ..) => Ok(with_groups('.')),
            (None, Some(_), ..) => Ok(with_groups(',')),
            (None, None, None, _) => Ok(('.', None)),
            (None, None, Some(_), [Some(_), None]) => Ok(with_groups('.')),
            (None, None, Some(_), [None, Some(_)]) => Ok(with_groups(',')),
            // Numbers with three decimals throughout (`1.250`), as programs print them. Whole numbers below 1000 beside them are groups.
            (None, None, Some(_), [None, None])
                if self.comma_or_group.is_none() && (self.three_digits.is_none() || self.is_ungrouped) =>
            {
                Ok(('.', None))
            }
            (None, None, Some(doubtful), _) => Err(format!(
                "{} is a number with three decimals, or one with groups of thousands",
                told(doubtful)
            )),
        }
    }
}

/// The numbers of a table's rows, all of which have a cell for each column.
pub(crate) fn numbers(table: &Table, form: &TableForm, blanks: bool) -> Numbers {
    let width = table.header().len();
    let mut evidence: Vec<Evidence> = (0..width).map(|_| Evidence::default()).collect();
    for (index, row) in table.rows().enumerate() {
        for (column, evidence) in evidence.iter_mut().enumerate() {
            let cell = row.text(column);
            let spelling = spelling(cell, blanks);
            match clock(cell).filter(|_| spelling == Spelling::Words) {
                Some(clock) => evidence.clocks.push((index, clock)),
                None => evidence.add(row.line, cell, spelling),
            }
        }
    }
    let (mut found, mut decimals) = (Numbers::default(), Vec::new());
    let first_of = |seen: fn(&Evidence) -> &Seen| evidence.iter().find_map(|e| seen(e).clone());
    let of_table = [first_of(|e| &e.point), first_of(|e| &e.comma)];
    for (column, evidence) in evidence.iter().enumerate() {
        let decimal = match form.decimal {
            Some(decimal) => Ok((decimal, None)),
            None => evidence.decimal([&of_table[0], &of_table[1]]),
        };
        let (decimal, doubt) = match decimal {
            Ok((decimal, remark)) => {
                found.remarks.extend(remark.map(|remark| format!("column {}: {remark}", column + 1)));
                (decimal, None)
            }
            Err(doubt) => {
                ('.', Some(format!("{doubt}; say `decimal = \".\"` or `decimal = \",\"` in [table]")))
            }
        };
        decimals.push(decimal);
        found.doubts.push(doubt);
        found.columns.push(Vec::with_capacity(table.rows.len()));
    }
    for row in table.rows() {
        for (column, values) in found.columns.iter_mut().enumerate() {
            let cell = row.text(column);
            let spelling = spelling(cell, blanks);
            let is_doubtful = found.doubts[column].is_some();
            values.push(if is_doubtful { f64::NAN } else { number(cell, spelling, decimals[column]) });
        }
    }
    for (column, evidence) in evidence.iter().enumerate().filter(|(_, evidence)| !evidence.clocks.is_empty())
    {
        match Clock::reading(&evidence.clocks, form.dates) {
            Ok((order, is_minutes, remark)) => {
                found.remarks.extend(remark.map(|remark| format!("column {}: {remark}", column + 1)));
                for (row, clock) in &evidence.clocks {
                    found.columns[column][*row] = clock.seconds(order, is_minutes);
                }
            }
            Err(doubt) => found.doubts[column] = Some(doubt),
        }
    }
    found
}

/// `12:30:01.5`, `3:30:01.5 PM`, `04:12.5`, `10:00:00:500`, or a date and a time.
#[derive(Clone, Copy, Debug)]
struct Clock {
    date: Date,
    /// Numbers between colons, and how many.
    parts: [f64; 4],
    count: usize,
    has_fraction: bool,
    /// 0 for AM, half a day for PM.
    half_s: Option<f64>,
    /// Offset of the time zone.
    zone_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Date {
    None,
    /// Days since 1970.
    Day(i64),
    /// First and second number, and the year.
    Slashes([i64; 3]),
}

fn clock(cell: &str) -> Option<Clock> {
    let begins = cell.as_bytes().first().is_some_and(u8::is_ascii_digit);
    if !begins || !cell.contains(':') || !cell.is_ascii() {
        return None;
    }
    let (cell, half_s) = match cell.to_ascii_lowercase() {
        lower if lower.ends_with("am") => (cell[..cell.len() - 2].trim_end(), Some(0.0)),
        lower if lower.ends_with("pm") => (cell[..cell.len() - 2].trim_end(), Some(0.5 * DAY_S)),
        _ => (cell, None),
    };
    let (date, time) = match cell.split_once(['T', ' ']) {
        Some((date, time)) => (Date::of(date)?, time.trim_start()),
        None => (Date::None, cell),
    };
    let (time, zone_s) = match time.find(['Z', '+', '-']) {
        Some(at) => (&time[..at], zone_s(&time[at..])?),
        None => (time, 0.0),
    };
    let (mut parts, mut count) = ([0.0; 4], 0);
    for part in time.split(':') {
        *parts.get_mut(count)? = part.replace(',', ".").parse().ok().filter(|v: &f64| *v >= 0.0)?;
        count += 1;
    }
    // Of four numbers the last are milliseconds, if it has three digits; frames of a film have two.
    let is_last_ms = || time.rsplit(':').next().is_some_and(|last| last.len() == 3);
    let is_known = matches!(count, 2 | 3) || count == 4 && is_last_ms();
    let has_fraction = time.contains(['.', ',']);
    is_known.then_some(Clock { date, parts, count, has_fraction, half_s, zone_s })
}

impl Date {
    fn of(text: &str) -> Option<Self> {
        let mut numbers = text.split(['-', '/', '.']).map(|part| part.parse::<i64>());
        let mut next = || numbers.next()?.ok();
        let [a, b, c] = [next()?, next()?, next()?];
        match (a > 31, c > 31) {
            (true, false) => days_since_1970(a, b, c).map(Self::Day),
            // 03.04.2023 is in April, wherever it is written.
            (false, true) if text.contains('.') => days_since_1970(c, b, a).map(Self::Day),
            (false, true) => Some(Self::Slashes([a, b, c])),
            _ => None,
        }
    }

    fn days(self, order: DateOrder) -> Option<i64> {
        match (self, order) {
            (Self::None, _) => Some(0),
            (Self::Day(days), _) => Some(days),
            (Self::Slashes([day, month, year]), DateOrder::DayFirst)
            | (Self::Slashes([month, day, year]), DateOrder::MonthFirst) => days_since_1970(year, month, day),
        }
    }
}

impl Clock {
    /// How a column's clocks are read: order of dates, whether two numbers are minutes and seconds, and a remark; or why that is not known.
    fn reading(
        clocks: &[(usize, Self)],
        given: Option<DateOrder>,
    ) -> Result<(DateOrder, bool, Option<String>), String> {
        let is_pair = |clock: &Self| clock.count == 2 && clock.date == Date::None && clock.half_s.is_none();
        let mut pairs = clocks.iter().map(|(_, clock)| clock).filter(|clock| is_pair(clock)).peekable();
        let has_pairs = pairs.peek().is_some();
        let is_minutes = pairs.any(|clock| clock.has_fraction || clock.parts[0] > 23.0);
        if has_pairs && !is_minutes {
            return Err("its clocks are hours and minutes, or minutes and seconds; write `h:m:s`, as with \
                        pandas.to_timedelta('00:' + column) for minutes"
                .into());
        }
        if let Some(order) = given {
            return Ok((order, is_minutes, None));
        }
        let mut dates: Vec<Date> = clocks.iter().map(|(_, clock)| clock.date).collect();
        dates.retain(|date| matches!(date, Date::Slashes(_)));
        dates.dedup();
        let follows = |order: DateOrder| {
            let days: Option<Vec<i64>> = dates.iter().map(|date| date.days(order)).collect();
            days.map(|days| days.windows(2).all(|pair| pair[1] - pair[0] == 1))
        };
        match (follows(DateOrder::DayFirst), follows(DateOrder::MonthFirst)) {
            (Some(_), None) => Ok((DateOrder::DayFirst, is_minutes, None)),
            (None, Some(_)) => Ok((DateOrder::MonthFirst, is_minutes, None)),
            // One date: times from the first row on do not depend on its month.
            _ if dates.len() < 2 => Ok((DateOrder::MonthFirst, is_minutes, None)),
            (Some(true), Some(false)) => {
                let remark = "dates are day/month/year, as these days follow each other".into();
                Ok((DateOrder::DayFirst, is_minutes, Some(remark)))
            }
            (Some(false), Some(true)) => {
                let remark = "dates are month/day/year, as these days follow each other".into();
                Ok((DateOrder::MonthFirst, is_minutes, Some(remark)))
            }
            _ => Err("its dates are day/month/year or month/day/year; say `dates = \"day/month/year\"` or the other in [table]".into()),
        }
    }

    /// Seconds since midnight, or since 1970 with a date; NaN for a date that does not exist.
    fn seconds(&self, order: DateOrder, is_minutes: bool) -> f64 {
        let [a, b, c, ms] = self.parts;
        let is_minutes = is_minutes && self.date == Date::None && self.half_s.is_none();
        let time_s = match self.count {
            2 if is_minutes => 60.0 * a + b,
            2 => 3600.0 * a + 60.0 * b,
            3 => 3600.0 * a + 60.0 * b + c,
            _ => 3600.0 * a + 60.0 * b + c + 1e-3 * ms,
        };
        // 12:30 AM is half past midnight.
        let time_s = self.half_s.map_or(time_s, |half_s| time_s % (0.5 * DAY_S) + half_s);
        self.date.days(order).map_or(f64::NAN, |days| DAY_S * days as f64 + time_s - self.zone_s)
    }
}

fn zone_s(zone: &str) -> Option<f64> {
    if zone == "Z" {
        return Some(0.0);
    }
    let digits = zone.get(1..)?.replace(':', "");
    let (hours, minutes): (f64, f64) = (
        digits.get(..2)?.parse().ok()?,
        digits.get(2..).filter(|m| !m.is_empty()).map_or(Some(0.0), |m| m.parse().ok())?,
    );
    let sign = if zone.starts_with('-') { -1.0 } else { 1.0 };
    Some(sign * (3600.0 * hours + 60.0 * minutes))
}

/// Days of a date of the Gregorian calendar, years counted from March.
fn days_since_1970(year: i64, month: i64, day: i64) -> Option<i64> {
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || !(1..=9999).contains(&year) {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    Some(365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468)
}
