//! lab
mod support;
use softtwin_rom::{config::*, evaluation::*, predict::*, regime::*, snapshots::*, train::train};
use std::time::Instant;
fn run(name: &str, db: &Database, cfg: &TrainConfig) {
    let t = Instant::now();
    let (model, sheet) = train(db, cfg, &mut |s| println!("  {s} {:?}", t.elapsed())).unwrap();
    println!(
        "{name}: trained in {:?}; remarks {:?} sag {:?} reach {:?}",
        t.elapsed(),
        sheet.remarks,
        sheet.sag_mm,
        sheet.reach_mm
    );
    for r in &sheet.regimes {
        println!(" {:?} cases {} boundary {} bars {:?}", r.kind, r.cases, r.boundary_states, r.bars);
        for g in r.groups.iter().chain(&r.force) {
            println!(
                "  {} modes {} trunc {:.1e} cond {:.1e} res {:.1e} loo {:.3e}",
                g.name, g.modes, g.truncation_error, g.condition, g.residual, g.leave_one_out
            );
            for c in g.candidates.iter().take(40) {
                println!(
                    "     {} {:?} s {:.1e} l {} err {:?} {:?}",
                    c.kernel, c.metric, c.smoothing, c.modes, c.error, c.refused
                );
            }
        }
    }
    let mut p = Predictor::new(&model, &Selection::default()).unwrap();
    let mut e = p.evaluation();
    let mut y = vec![0f32; p.entries()];
    let n = db.node_count;
    let mut mse: std::collections::BTreeMap<String, (f64, usize)> = Default::default();
    for i in (0..db.cases.len()).filter(|&i| db.cases[i].split != Split::Train) {
        let c = &db.cases[i];
        p.evaluate(
            Input { pressure_mpa: c.pressure_mpa, gap_mm: c.gap_mm.unwrap_or(f64::INFINITY) },
            &mut RegimeSwitch::default(),
            &mut e,
        );
        p.reconstruct_into(&e, &mut y).unwrap();
        let mut line = format!(
            "  case {} {:?} P {} g {:?} dom {:?} {:.3} F {:.5} ({:.5}) err {:+.3}%",
            c.name,
            e.basis,
            c.pressure_mpa,
            c.gap_mm,
            e.domain,
            e.domain_distance,
            e.contact_force_n,
            c.contact_force_n,
            100.0 * (e.contact_force_n / c.contact_force_n - 1.0)
        );
        let mut sq = 0.0;
        for f in 0..5 {
            let (mut emax, mut ymax) = (0f64, 0f64);
            for (k, v) in db.field(i, f).enumerate() {
                let d = (y[f * n + k] - v).abs() as f64;
                emax = emax.max(d);
                ymax = ymax.max(v.abs() as f64);
                sq += d * d;
            }
            line += &format!(" {}:{:.4}%", db.fields[f].name, 100.0 * emax / ymax);
        }
        println!("{line} mse {:.2e}", sq / (5 * n) as f64);
        if c.split == Split::Test {
            let m = mse.entry(format!("{:?}", c.regime)).or_default();
            m.0 += sq / (5 * n) as f64;
            m.1 += 1;
        }
    }
    for (k, v) in &mse {
        println!("  MSE {k} {:.3e}", v.0 / v.1 as f64);
    }
    // jump
    if let Some(t) = &model.header.onset {
        let (mut worst, mut worstf, mut at) = (0f32, 0f64, 0.0);
        let mut y2 = y.clone();
        for k in 0..100 {
            let g = 28.0 + 42.0 * k as f64 / 99.0;
            let Onset::At(pc) = t.onset(g) else {
                println!("gap {g} {:?}", t.onset(g));
                continue;
            };
            p.evaluate(
                Input { pressure_mpa: pc * (1.0 - 1e-9), gap_mm: g },
                &mut RegimeSwitch::default(),
                &mut e,
            );
            assert_eq!(e.basis, RegimeKind::Free);
            p.reconstruct_into(&e, &mut y).unwrap();
            let f0 = e.contact_force_n;
            p.evaluate(
                Input { pressure_mpa: pc * (1.0 + 1e-9), gap_mm: g },
                &mut RegimeSwitch::default(),
                &mut e,
            );
            assert_eq!(e.basis, RegimeKind::Contact);
            p.reconstruct_into(&e, &mut y2).unwrap();
            let j = (0..4 * n).map(|i| (y[i] - y2[i]).abs()).fold(0f32, f32::max);
            if j > worst {
                worst = j;
                at = g;
            }
            worstf = worstf.max((e.contact_force_n - f0).abs());
        }
        println!("  jump {worst} mm at gap {at}, {worstf:.2e} N");
    }
    let t0 = Instant::now();
    for _ in 0..2000 {
        p.evaluate(Input { pressure_mpa: 0.05, gap_mm: 30.0 }, &mut RegimeSwitch::default(), &mut e);
    }
    println!("  evaluate {:?}", t0.elapsed() / 2000);
}
#[test]
fn lab() {
    let db = support::shared_database(support::Scene::Plate).unwrap();
    run("default", &db, &TrainConfig::default());
    if std::env::var("CAP").is_ok() {
        return;
    }
    run("paper", &db, &TrainConfig::paper());
    let db = support::shared_database(support::Scene::Gripper).unwrap();
    run("gripper", &db, &TrainConfig::default());
}
