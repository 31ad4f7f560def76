//! The table of units: factors of what files, sensors and options may state to MPa, mm, N, rad, s, V, A, mm^3 and 1/mm.
//!
//! A table instead of a package: `uom` checks units at compile time and reads none of a file's spellings; the others bring a language
//! of expressions. The test holds the factors.

/// What a unit measures. The comment of each says the base unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// MPa.
    Pressure,
    /// mm.
    Length,
    /// N.
    Force,
    /// rad.
    Angle,
    /// s.
    Time,
    /// V.
    Voltage,
    /// A.
    Current,
    /// mm^3.
    Volume,
    /// 1/mm.
    Curvature,
    /// No unit.
    Number,
}

/// Spellings, dimension, factor to its base unit.
const UNITS: &[(&[&str], Dimension, f64)] = &[
    (&["mpa", "n/mm2", "n/mm^2"], Dimension::Pressure, 1.0),
    (&["gpa"], Dimension::Pressure, 1e3),
    (&["kpa", "kpag"], Dimension::Pressure, 1e-3),
    (&["hpa", "mbar"], Dimension::Pressure, 1e-4),
    (&["pa"], Dimension::Pressure, 1e-6),
    (&["bar", "barg"], Dimension::Pressure, 0.1),
    (&["psi", "psig"], Dimension::Pressure, 0.006_894_757_293_168_361),
    (&["atm"], Dimension::Pressure, 0.101_325),
    (&["torr", "mmhg"], Dimension::Pressure, 101_325e-6 / 760.0),
    (&["cmh2o"], Dimension::Pressure, 98.0665e-6),
    (&["kgf/cm2", "kgf/cm^2"], Dimension::Pressure, 0.098_066_5),
    (&["mm", "millimeters"], Dimension::Length, 1.0),
    (&["cm", "centimeters"], Dimension::Length, 10.0),
    (&["m", "meters"], Dimension::Length, 1000.0),
    (&["um", "\u{b5}m", "\u{3bc}m"], Dimension::Length, 1e-3),
    (&["in", "inch", "\""], Dimension::Length, 25.4),
    (&["n"], Dimension::Force, 1.0),
    (&["mn"], Dimension::Force, 1e-3),
    (&["kn"], Dimension::Force, 1e3),
    (&["gf"], Dimension::Force, 9.806_65e-3),
    (&["kgf"], Dimension::Force, 9.806_65),
    (&["lbf"], Dimension::Force, 4.448_221_615_260_5),
    (&["rad"], Dimension::Angle, 1.0),
    (&["deg", "\u{b0}", "degree", "degrees"], Dimension::Angle, std::f64::consts::PI / 180.0),
    (&["s", "sec", "second", "seconds"], Dimension::Time, 1.0),
    (&["ms", "msec", "milliseconds", "millis"], Dimension::Time, 1e-3),
    (&["us", "\u{b5}s", "\u{3bc}s", "usec", "microseconds", "micros"], Dimension::Time, 1e-6),
    (&["ns", "nsec", "nanoseconds"], Dimension::Time, 1e-9),
    (&["min", "minutes"], Dimension::Time, 60.0),
    (&["h", "hour", "hours"], Dimension::Time, 3600.0),
    (&["d", "day", "days"], Dimension::Time, 86_400.0),
    (&["v", "volts"], Dimension::Voltage, 1.0),
    (&["mv"], Dimension::Voltage, 1e-3),
    (&["a"], Dimension::Current, 1.0),
    (&["ma"], Dimension::Current, 1e-3),
    (&["mm3", "mm^3", "ul", "\u{b5}l"], Dimension::Volume, 1.0),
    (&["ml", "cm3", "cm^3", "cc"], Dimension::Volume, 1e3),
    (&["l"], Dimension::Volume, 1e6),
    (&["1/mm", "per_mm", "mm^-1"], Dimension::Curvature, 1.0),
    (&["1/cm", "cm^-1"], Dimension::Curvature, 0.1),
    (&["1/m", "m^-1"], Dimension::Curvature, 1e-3),
    (&["1", "count", "counts"], Dimension::Number, 1.0),
];

/// Dimension and factor of a unit's spelling.
#[must_use]
pub fn unit(spelling: &str) -> Option<(Dimension, f64)> {
    let spelling = spelling.trim().to_lowercase();
    let found = UNITS.iter().find(|(names, ..)| names.contains(&spelling.as_str()));
    found.map(|(_, dimension, factor)| (*dimension, *factor))
}

/// All spellings, for messages.
#[must_use]
pub fn known() -> String {
    UNITS.iter().map(|(names, ..)| names[0]).collect::<Vec<_>>().join(", ")
}

/// A spelling of each unit of a dimension, for messages.
#[must_use]
pub fn known_of(dimension: Dimension) -> String {
    let same = UNITS.iter().filter(|(_, found, _)| *found == dimension);
    same.map(|(names, ..)| names[0]).collect::<Vec<_>>().join(", ")
}

/// Units that are words or labels as well (`pressure_in`, `chamber_a`): read in brackets only.
const WORDS: [&str; 6] = ["in", "a", "l", "d", "h", "day"];

/// Unit of pixels, whose size a mapping states.
pub const PIXELS: &str = "px";

/// Spelling of the unit that a heading contains: in brackets, behind its last `_`, blank or `/` (`pressure_kpa`, `p/kPa`) or, of a
/// time, alone (`millis`); pixels included. A bracketed number is an index (`data[1]`), a unit behind `/` and another unit is a rate
/// (`deg/s`, `L/min`), and a pressure that is said to be absolute has none of these units, which are of pressures above the
/// atmosphere's.
#[must_use]
pub fn in_heading(heading: &str) -> Option<&str> {
    let is_known = |spelling: &&str| match unit(spelling) {
        Some((quantity, _)) => quantity != Dimension::Number || spelling.parse::<u32>().is_err(),
        None => spelling.trim().eq_ignore_ascii_case(PIXELS),
    };
    let bracket = heading.rfind(['(', '[']);
    let bracketed = bracket.map(|at| heading[at + 1..].trim_end_matches([')', ']', ' ']));
    let last_word = |text: &'_ str| -> Option<usize> { text.rfind(['_', ' ', '/']).map(|at| at + 1) };
    // `bar(a)`, `kPa (g)`: the bracket says against what the pressure is measured.
    if let Some((at, reference)) =
        bracket.zip(bracketed).filter(|(_, b)| b.len() == 1 && b.contains(['a', 'A', 'g', 'G']))
    {
        let before = heading[..at].trim_end();
        let word = &before[last_word(before).unwrap_or(0)..];
        if unit(word).is_some_and(|(quantity, _)| quantity == Dimension::Pressure) {
            return Some(word).filter(|_| reference.eq_ignore_ascii_case("g"));
        }
    }
    let last = last_word(heading).filter(|at| {
        let before = &heading[..at - 1];
        let divided = &before[last_word(before).unwrap_or(0)..];
        !heading[at - 1..].starts_with('/') || unit(divided).is_none()
    });
    let last = last.map(|at| &heading[at..]).filter(|last| !WORDS.contains(&last.to_lowercase().as_str()));
    let alone = Some(heading).filter(|h| h.len() > 3 && unit(h).is_some_and(|(q, _)| q == Dimension::Time));
    [bracketed, last, alone].into_iter().flatten().find(is_known)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_those_of_the_standards() {
        let factor = |name| unit(name).unwrap().1;
        assert!((factor("psi") / factor("pa") - 6_894.757).abs() < 1e-3);
        assert!((factor("bar") / factor("mbar") - 1000.0).abs() < 1e-9);
        assert!((factor("deg") * 180.0 - std::f64::consts::PI).abs() < 1e-12);
        assert!((factor("gf") * 1000.0 - 9.806_65).abs() < 1e-9);
        assert_eq!(unit("mN"), Some((Dimension::Force, 1e-3)));
        assert_eq!(in_heading("Pressure (N/mm2)"), Some("N/mm2"));
        assert_eq!(in_heading("pressure_kpa"), Some("kpa"));
        assert_eq!(in_heading("speed"), None);
        assert_eq!((in_heading("chamber_a"), in_heading("supply [A]")), (None, Some("A")));
        assert_eq!(in_heading("tip x (px)"), Some("px"));
        assert_eq!((in_heading("/pressure/data[1]"), in_heading("millis")), (None, Some("millis")));
        assert!((factor("mmHg") * 750.062 - 0.1).abs() < 1e-6 && (factor("1/m") - 1e-3).abs() < 1e-12);
        assert_eq!(
            (in_heading("gyro x deg/s"), in_heading("Flow L/min"), in_heading("p/kPa")),
            (None, None, Some("kPa"))
        );
        assert_eq!(
            (in_heading("P1 bar(a)"), in_heading("psi (A)"), in_heading("P kPa(g)")),
            (None, None, Some("kPa"))
        );
        assert_eq!((in_heading("Time (h)"), in_heading("point_d")), (Some("h"), None));
        assert_eq!(unit("furlong"), None);
    }
}
