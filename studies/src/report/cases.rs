//! Figs. 7 and 8 (cases A-D), appendix A (E-H), appendix B (nearest sample), and the validation states.

use super::folder::Folder;
use super::published::{self, Case as Published};
use super::study::{REGIMES, Study, percent};
use rom::hull::DomainStatus;
use rom::snapshots::{Case, FieldKind, RegimeKind, Split};
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use std::fmt::Write as _;
use train::evaluate::{CaseReport, spread};

pub fn section(study: &Study, out: &Folder) -> anyhow::Result<String> {
    let mut page = String::from("\n## Test cases (the paper's Figs. 7 and 8)\n\n");
    page += &mse_table(study)?;
    let test = study.cases(|c| c.split == Split::Test);
    page += &case_table(study, &test, "")?;
    page +=
        &out.picture("cases", "Largest errors of the test cases by both methods", &picture(study, &test)?)?;
    page += &held_out(study)?;
    page += "\n## Outside the training range (appendix A)\n\n";
    let check = study.cases(|c| c.split == Split::Check);
    let report = study.evaluate(&study.ours, &check)?;
    let pairs = check.iter().zip(&report.cases);
    let outside: Vec<usize> =
        pairs.filter(|(_, c)| c.domain != DomainStatus::Inside).map(|(i, _)| *i).collect();
    page += &case_table(
        study,
        &outside,
        "All are flagged; the state contains their distance to the training range.\n",
    )?;
    page += &nearest(study)?;
    Ok(page)
}

fn mse_table(study: &Study) -> anyhow::Result<String> {
    let mut text = String::from(
        "| mean squared error (Eq. 15) | paper | paper's method | ours |\n| --- | --- | --- | --- |\n",
    );
    for (regime, published) in REGIMES.into_iter().zip(published::MSE) {
        let paper = super::study::test_mse(&study.paper, &study.database, regime)?;
        let ours = super::study::test_mse(&study.ours, &study.database, regime)?;
        let _ = writeln!(text, "| {} | {published:.2e} | {paper:.2e} | {ours:.2e} |", regime.name());
    }
    Ok(text + "\n")
}

fn case_table(study: &Study, cases: &[usize], note: &str) -> anyhow::Result<String> {
    if cases.is_empty() {
        return Ok("This database has no such cases.\n".into());
    }
    let paper = study.evaluate(&study.paper, cases)?;
    let ours = study.evaluate(&study.ours, cases)?;
    let mut text = String::from(
        "| case | state | quantity | paper % | paper's method % | ours % |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    for ((i, theirs), mine) in cases.iter().zip(&paper.cases).zip(&ours.cases) {
        let case = &study.database.cases[*i];
        let known = published::find(case.pressure_mpa, case.gap_mm);
        let name = match known {
            Some(k) if k.name != case.name => format!("{} (case {})", k.name, case.name),
            _ => case.name.clone(),
        };
        let gap = case.gap_mm.map_or(String::new(), |gap| format!(", {gap:.2} mm"));
        let state = format!("{:.4} MPa{gap}, {}", case.pressure_mpa, mine.domain);
        for (quantity, of, figure) in QUANTITIES {
            let (Some(theirs), Some(mine)) = (of(study, theirs), of(study, mine)) else { continue };
            let figure = known.and_then(figure).map_or("-".into(), |v| format!("{v}"));
            let _ = writeln!(
                text,
                "| {name} | {state} | {quantity} | {figure} | {} | {} |",
                percent(theirs),
                percent(mine)
            );
        }
    }
    Ok(text + "\n" + note)
}

type Measured = fn(&Study, &CaseReport) -> Option<f64>;
type Figure1 = fn(&Published) -> Option<f64>;

/// Comparison: name, measured fraction, published percentage.
const QUANTITIES: [(&str, Measured, Figure1); 3] = [
    ("displacement, normalised", |s, c| normalised(s, c, FieldKind::Magnitude), |k| Some(k.displacement)),
    ("stress, normalised", |s, c| normalised(s, c, FieldKind::Stress), |k| Some(k.stress)),
    ("contact force, relative", |_, c| c.force_relative, |k| k.force),
];

/// Normalised error of the field of a kind.
fn normalised(study: &Study, case: &CaseReport, kind: FieldKind) -> Option<f64> {
    let at = study.database.fields.iter().position(|f| f.kind == kind)?;
    Some(case.fields[at].normalised)
}

fn picture(study: &Study, cases: &[usize]) -> anyhow::Result<Figure> {
    let (paper, ours) = (study.evaluate(&study.paper, cases)?, study.evaluate(&study.ours, cases)?);
    let names: Vec<String> = cases
        .iter()
        .map(|i| &study.database.cases[*i])
        .map(|c| published::find(c.pressure_mpa, c.gap_mm).map_or(c.name.clone(), |k| k.name.into()))
        .collect();
    let panel = |title: &str, of: Measured| {
        let points = |reports: &[CaseReport]| {
            let values =
                reports.iter().enumerate().filter_map(|(i, c)| Some((i as f64, 100.0 * of(study, c)?)));
            values.collect::<Vec<_>>()
        };
        let series = |name: &str, colour, reports: &[CaseReport]| Series {
            name: name.into(),
            colour,
            mark: Mark::Dots,
            points: points(reports),
        };
        Panel {
            title: title.into(),
            x: Axis::names("test case", names.clone()),
            y: Axis::log("error [%]"),
            series: vec![series("paper's method", 1, &paper.cases), series("ours", 0, &ours.cases)],
            map: None,
        }
    };
    let panels = QUANTITIES.iter().map(|(title, of, _)| panel(title, *of)).collect();
    Ok(Figure { title: "Test cases: largest errors".into(), panels, columns: 3 })
}

/// All held-out states inside the training range, ours only: the paper reports none.
fn held_out(study: &Study) -> anyhow::Result<String> {
    let cases = study.held_out()?;
    let report = study.evaluate(&study.ours, &cases)?;
    let mut text = String::from(
        "\n## Held-out states inside the training range\n\nTest and check cases together. Mean / 95th percentile / largest over cases; force per \
         largest force of the database.\n\n\
         | regime | states | displacement % | stress % | force % | within the half-width: displacement, stress, force |\n\
         | --- | --- | --- | --- | --- | --- |\n",
    );
    for summary in &report.regimes {
        let regime = |c: &&CaseReport| c.gap_mm.is_some() == (summary.regime == RegimeKind::Contact);
        let column = |kind| {
            let values = report.cases.iter().filter(regime).filter_map(|c| normalised(study, c, kind));
            three(spread(&mut values.collect::<Vec<_>>()))
        };
        let coverage = summary.coverage.map(|share| format!("{:.0} %", 100.0 * share)).join(", ");
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {coverage} |",
            summary.regime.name(),
            summary.cases,
            column(FieldKind::Magnitude),
            column(FieldKind::Stress),
            if summary.regime == RegimeKind::Contact { three(summary.force_normalised) } else { "-".into() },
        );
    }
    text += &worst_stress(study, &report.cases);
    let nominal = study.ours.header.regimes.first().map_or(0.0, |r| 100.0 * r.halfwidths.coverage);
    let _ = writeln!(
        text,
        "\nThe nominal coverage is {nominal:.0} %; this model's half-widths are calibrated by leave-one-out on the training cases alone."
    );
    Ok(text)
}

/// The state with the largest stress error, and the reason for large relative errors of small stresses.
fn worst_stress(study: &Study, cases: &[CaseReport]) -> String {
    let Some(f) = study.database.fields.iter().position(|f| f.kind == FieldKind::Stress) else {
        return String::new();
    };
    let mut sorted: Vec<&CaseReport> = cases.iter().collect();
    sorted.sort_by(|a, b| b.fields[f].normalised.total_cmp(&a.fields[f].normalised));
    let [worst, next, ..] = sorted.as_slice() else { return String::new() };
    let errors = &worst.fields[f];
    let gap = worst.gap_mm.map_or(String::new(), |gap| format!(", {gap:.2} mm"));
    format!(
        "\nThe largest stress error is that of {} ({:.4} MPa{gap}) at node {}: {:.4} MPa where the largest stress of the state is \
         {:.3} MPa; the next state has {} %. Von Mises stress has a kink where pressure cancels the stress of the weight (roots of the slots, a few \
         kPa), which no smooth interpolant follows.\n",
        worst.case,
        worst.pressure_mpa,
        errors.worst_node,
        errors.max,
        errors.max / errors.normalised.max(f64::MIN_POSITIVE),
        percent(next.fields[f].normalised),
    )
}

fn three(values: [f64; 3]) -> String {
    values.map(percent).join(" / ")
}

/// Appendix B: the nearest training sample as the answer.
fn nearest(study: &Study) -> anyhow::Result<String> {
    let mut text = String::from(
        "\n## The nearest training sample instead of a model (appendix B)\n\n\
         | test case | nearest training case | force error %, paper | force error % | displacement error % | stress error % |\n\
         | --- | --- | --- | --- | --- | --- |\n",
    );
    let database = &study.database;
    for i in study.cases(|c| c.split == Split::Test && c.regime == RegimeKind::Contact) {
        let case = &database.cases[i];
        let Some(near) = nearest_training(study, case) else { continue };
        let sample = &database.cases[near];
        let off = |kind| {
            let field = database.fields.iter().position(|f| f.kind == kind)?;
            let pairs = || database.field(i, field).zip(database.field(near, field));
            let largest = pairs().fold(0.0_f32, |m, (a, _)| m.max(a.abs()));
            Some(f64::from(pairs().fold(0.0_f32, |m, (a, b)| m.max((a - b).abs())) / largest))
        };
        let show = |value: Option<f64>| value.map_or("-".into(), percent);
        let known = published::find(case.pressure_mpa, case.gap_mm);
        let force = (sample.contact_force_n - case.contact_force_n).abs() / case.contact_force_n;
        let _ = writeln!(
            text,
            "| {} | {} ({:.4} MPa, {:.2} mm) | {} | {} | {} | {} |",
            known.map_or(case.name.as_str(), |k| k.name),
            sample.name,
            sample.pressure_mpa,
            sample.gap_mm.unwrap_or(f64::NAN),
            known.and_then(|k| k.nearest_force).map_or("-".into(), |v| v.to_string()),
            percent(force),
            show(off(FieldKind::Magnitude)),
            show(off(FieldKind::Stress)),
        );
    }
    Ok(text)
}

/// Nearest contact training case over inputs scaled to [0, 1].
fn nearest_training(study: &Study, case: &Case) -> Option<usize> {
    let inputs = &study.ours.regime(RegimeKind::Contact)?.inputs;
    let place = |c: &Case| inputs.scale(&c.inputs());
    let at = place(case);
    let distance = |i: &usize| {
        let p = place(&study.database.cases[*i]);
        (p[0] - at[0]).hypot(p[1] - at[1])
    };
    let training = study.cases(|c| c.split == Split::Train && c.regime == RegimeKind::Contact);
    training.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}
