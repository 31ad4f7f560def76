//! Fig. 5: truncation error and MSE against modes, MSE against the number of training cases.

use super::folder::Folder;
use super::study::{REGIMES, Study, ours_with, paper, test_mse, train};
use rom::model::Model;
use rom::rng::Rng;
use rom::snapshots::{Database, RegimeKind, Split};
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use softtwin::progress::Progress;
use std::fmt::Write as _;
use train::config::{KernelKind, ModeChoice, Tail};

/// Numbers of modes at which models are trained.
const MODES: [usize; 8] = [1, 2, 3, 4, 5, 6, 9, 12];
/// Shares of the training cases at which subsets are drawn.
const SHARES: [f64; 6] = [0.2, 0.35, 0.5, 0.65, 0.8, 1.0];
const SEED: u64 = 2026;

pub fn section(study: &Study, out: &Folder, repeats: u64, progress: &mut Progress) -> anyhow::Result<String> {
    let mut panels = Vec::new();
    let mut tables = String::new();
    for regime in REGIMES {
        panels.push(truncation(study, regime));
        progress.step(&format!("regime {}: error against modes", regime.name()));
        panels.push(against_modes(study, regime)?);
        progress.step(&format!("regime {}: error against training cases", regime.name()));
        let (panel, table) = against_cases(study, regime, repeats)?;
        panels.push(panel);
        tables += &table;
    }
    for (panel, letter) in panels.iter_mut().zip('A'..) {
        panel.title = format!("{letter}  {}", panel.title);
    }
    let figure = Figure { title: "Modes and training cases".into(), panels, columns: 3 };
    let shown =
        out.picture("fig5", "Truncation error and MSE against modes, MSE against training cases", &figure)?;
    let caption = "\nA, D: truncation error (Eq. 4) of the joint uncentred snapshot matrix and of each of our centred groups. \
        B, E: mean squared error on the test cases against modes (ours: the same number for every group, cubic kernel with \
        linear tail). C, F: against the number of training cases; every dot is a random subset. No answer: \
        a test case is too far outside the subset.\n";
    Ok(format!("\n## Modes and training cases (the paper's Fig. 5)\n{shown}{caption}{tables}"))
}

fn truncation(study: &Study, regime: RegimeKind) -> Panel {
    let curves = |model: &Model, joint: bool| -> Vec<(String, Vec<(f64, f64)>)> {
        let groups = model.regime(regime).map_or(&[][..], |r| &r.groups);
        let curve = |g: &rom::model::GroupModel| {
            let count = g.singular_values.len().min(MODES[MODES.len() - 1]);
            let name = if joint { "joint (paper)".into() } else { g.name.clone() };
            (name, (1..=count).map(|l| (l as f64, g.truncation_error(l))).collect())
        };
        groups.iter().map(curve).collect()
    };
    let all = curves(&study.paper, true).into_iter().chain(curves(&study.ours, false));
    let series = all.enumerate().map(|(i, (name, points))| Series {
        name,
        colour: if i == 0 { 1 } else { [0, 2, 3, 4, 5][(i - 1) % 5] },
        mark: Mark::LineDots,
        points,
    });
    Panel {
        title: format!("Truncation error, {}", regime.name()),
        x: Axis::linear("modes"),
        y: Axis::log("truncation error (Eq. 4)"),
        series: series.collect(),
        map: None,
    }
}

/// The database with all training cases of the other regime that `regime` does not need set aside.
fn for_regime(study: &Study, regime: RegimeKind) -> Database {
    let mut database = study.database.clone();
    if regime == RegimeKind::Free {
        let contact =
            database.cases.iter_mut().filter(|c| c.regime == RegimeKind::Contact && c.split == Split::Train);
        contact.for_each(|c| c.split = Split::Check);
    }
    database
}

fn against_modes(study: &Study, regime: RegimeKind) -> anyhow::Result<Panel> {
    let database = for_regime(study, regime);
    let mut curves: [Vec<(f64, f64)>; 2] = Default::default();
    for modes in MODES {
        let configs =
            [paper([modes; 2]), ours_with(ModeChoice::Fixed(modes), KernelKind::Cubic, Tail::Linear)];
        for (curve, config) in curves.iter_mut().zip(configs) {
            curve.push((modes as f64, test_mse(&train(&database, &config)?, &database, regime)?));
        }
    }
    let [theirs, mine] = curves;
    Ok(Panel {
        title: format!("MSE against modes, {}", regime.name()),
        x: Axis::linear("modes"),
        y: Axis::log("MSE on test cases (Eq. 15)"),
        series: vec![
            Series { name: "paper's method".into(), colour: 1, mark: Mark::LineDots, points: theirs },
            Series { name: "ours".into(), colour: 0, mark: Mark::LineDots, points: mine },
        ],
        map: None,
    })
}

fn against_cases(study: &Study, regime: RegimeKind, repeats: u64) -> anyhow::Result<(Panel, String)> {
    let whole = for_regime(study, regime);
    let wanted = |i: &usize| whole.cases[*i].regime == regime;
    let pool: Vec<usize> = whole.of_split(Split::Train).filter(wanted).collect();
    let modes = super::published::MODES[usize::from(regime == RegimeKind::Contact)];
    let configs =
        || [paper([modes; 2]), ours_with(ModeChoice::LeaveOneOut(1.02), KernelKind::Cubic, Tail::Linear)];
    let mut random = Rng::new(SEED);
    let mut database = whole.clone();
    let (mut dots, mut rows) = ([Vec::new(), Vec::new()], String::new());
    for share in SHARES {
        let size = ((pool.len() as f64 * share).round() as usize).clamp(4.min(pool.len()), pool.len());
        let rounds = if size == pool.len() { 1 } else { repeats };
        let mut found = [Vec::new(), Vec::new()];
        for _ in 0..rounds {
            let mut shuffled = pool.clone();
            random.shuffle(&mut shuffled);
            for (rank, case) in shuffled.iter().enumerate() {
                database.cases[*case].split = if rank < size { Split::Train } else { Split::Check };
            }
            for (found, config) in found.iter_mut().zip(configs()) {
                // A subset can be too small for a method; that is a result, not a failure of the report.
                if let Ok(model) = train(&database, &config) {
                    found.push(test_mse(&model, &database, regime)?);
                }
            }
        }
        let _ = writeln!(
            rows,
            "| {} | {size} | {} | {} |",
            regime.name(),
            range(&found[0], rounds),
            range(&found[1], rounds)
        );
        for (dots, found) in dots.iter_mut().zip(found) {
            dots.extend(found.into_iter().map(|mse| (size as f64, mse)));
        }
    }
    let [theirs, mine] = dots;
    let panel = Panel {
        title: format!("MSE against training cases, {}", regime.name()),
        x: Axis::linear("training cases"),
        y: Axis::log("MSE on test cases (Eq. 15)"),
        series: vec![
            Series {
                name: format!("paper's method, {modes} modes"),
                colour: 1,
                mark: Mark::Dots,
                points: theirs,
            },
            Series { name: "ours".into(), colour: 0, mark: Mark::Dots, points: mine },
        ],
        map: None,
    };
    let head = "\n| regime | training cases | MSE of the paper's method: least, median, largest | ours |\n| --- | --- | --- | --- |\n";
    Ok((panel, format!("{head}{rows}")))
}

/// Least, median and largest, and how many subsets could not be trained on.
fn range(values: &[f64], rounds: u64) -> String {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let refused = rounds as usize - sorted.len();
    let note = if refused > 0 { format!(" ({refused} of {rounds} refused)") } else { String::new() };
    match sorted.as_slice() {
        [] => format!("-{note}"),
        [only] => format!("{only:.2e}{note}"),
        all => {
            // A model has no answer for a test case that is too far from its training cases; it counts as the largest error.
            let shown = [0, all.len() / 2, all.len() - 1].map(|place| match all[place] {
                error if error.is_nan() => "no answer".into(),
                error => format!("{error:.1e}"),
            });
            format!("{}{note}", shown.join(", "))
        }
    }
}
