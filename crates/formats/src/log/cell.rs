//! Cells and lines of a log: numbers, clocks, missing values, comments.

/// Words of a missing value.
const MISSING: [&str; 8] = ["nan", "na", "n/a", "#n/a", "null", "none", "-", "--"];

/// True if the line is neither empty nor a comment.
pub(super) fn is_content(line: &str) -> bool {
    !line.is_empty() && !line.starts_with(['#', '%', '!']) && !line.starts_with("//")
}

/// Number of a cell: decimal point or comma, or a clock in seconds; NaN for a missing value, `None` for other content.
pub(super) fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    if cell.is_empty() || MISSING.contains(&cell.to_ascii_lowercase().as_str()) {
        return Some(f64::NAN);
    }
    let comma = || {
        let is_decimal = decimal_comma && cell.matches(',').count() == 1 && !cell.contains('.');
        is_decimal.then(|| cell.replace(',', ".")).and_then(|cell| cell.parse().ok())
    };
    let minus = || cell.strip_prefix('\u{2212}').and_then(|size| size.parse::<f64>().ok()).map(|size| -size);
    cell.parse().ok().or_else(comma).or_else(minus).or_else(|| grouped(cell)).or_else(|| clock_s(cell))
}

/// Number with groups of thousands: `1,234.5` or `1.234,5`.
fn grouped(cell: &str) -> Option<f64> {
    let decimal = cell.rfind(['.', ',']).filter(|at| cell.contains(['.', ',']) && *at > 0)?;
    let separator = if cell[decimal..].starts_with('.') { ',' } else { '.' };
    let (whole, part) = (&cell[..decimal], &cell[decimal + 1..]);
    let mut groups = whole.split(separator);
    let leads = groups.next().map(|first| first.trim_start_matches(['-', '+']).len());
    let is_grouped = whole.contains(separator) && groups.all(|group| group.len() == 3);
    let number = format!("{}.{part}", whole.replace(separator, ""));
    number.parse().ok().filter(|_| is_grouped && leads.is_some_and(|digits| (1..=3).contains(&digits)))
}

/// Seconds of `12:30:01.5` or `3:30:01.5 PM` since midnight, or of a date and time since 1970 (UTC, or with its offset).
fn clock_s(cell: &str) -> Option<f64> {
    let (cell, half_s) = match cell.to_ascii_lowercase() {
        lower if lower.ends_with("am") => (cell[..cell.len() - 2].trim_end(), Some(0.0)),
        lower if lower.ends_with("pm") => (cell[..cell.len() - 2].trim_end(), Some(43200.0)),
        _ => (cell, None),
    };
    let (date, time) = match cell.split_once(['T', ' ']) {
        Some((date, time)) => (Some(date), time.trim_start()),
        None => (None, cell),
    };
    let days = match date {
        None => 0,
        Some(date) => {
            let parts: Vec<i64> =
                date.split(['-', '/', '.']).map(|part| part.parse().ok()).collect::<Option<Vec<_>>>()?;
            // 03.04.2023 is April; 03/04/2023 is taken for March: times from the first row on depend on it only in the night to another month.
            let [year, month, day] = match parts[..] {
                [day, month, year] if (date.contains('.') || day > 12) && year > 31 => [year, month, day],
                [month, day, year] if date.contains('/') && year > 31 => [year, month, day],
                [year, month, day] if year > 31 => [year, month, day],
                _ => return None,
            };
            days_since_1970(year, month, day)?
        }
    };
    let (time, zone_s) = match time.find(['Z', '+', '-']) {
        Some(at) => (&time[..at], zone_s(&time[at..])?),
        None => (time, 0.0),
    };
    let parts: Vec<f64> =
        time.replace(',', ".").split(':').map(|part| part.parse().ok()).collect::<Option<Vec<_>>>()?;
    let time_s = match parts[..] {
        [h, m] if date.is_some() => 3600.0 * h + 60.0 * m,
        [h, m, s] => 3600.0 * h + 60.0 * m + s,
        _ => return None,
    };
    // 12:30 AM is half past midnight.
    let time_s = half_s.map_or(time_s, |half_s| time_s % 43200.0 + half_s);
    Some(86400.0 * days as f64 + time_s - zone_s)
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
