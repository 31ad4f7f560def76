//! The stability suite: every hard case ends as it must, and the table is printed.

use rom::stability::{Ending, Row, hard_cases, run};

#[test]
fn every_hard_case_ends_as_it_must() {
    let rows: Vec<Row> = hard_cases().iter().map(run).collect();
    for r in &rows {
        let show = |o: &rom::stability::Outcome| {
            let number = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.1e}"));
            format!("{:?} condition {} error {}", o.ending, number(o.condition), number(o.error))
        };
        println!(
            "{:22} bound {:.0e}  ours {:50} paper {}  {}",
            r.case,
            r.bound,
            show(&r.ours),
            show(&r.paper),
            r.ours.note
        );
    }
    let wrong: Vec<&Row> = rows.iter().filter(|r| !r.passed()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(rows.iter().all(|r| r.ours.ending != Ending::SilentlyWrong));
}
