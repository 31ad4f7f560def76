//! Accuracy on the committed finite-element databases, against this project's acceptance limits. Test and check cases are
//! evaluated only.

use crate::synthetic;
use formats::database::{ObstacleKind, read};
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::regime::Onset;
use rom::snapshots::{Database, NodeSet, RegimeKind, Sensitivities, Split};
use std::path::Path;
use std::sync::OnceLock;
use train::config::TrainConfig;
use train::datasheet::{Candidate, DataSheet};
use train::evaluate::{CaseReport, EvaluationReport, evaluate, spread};
use train::train;

/// Below this pressure the actuator's own weight bends it more than the pressure does.
const WEIGHT_MPA: f64 = 0.005;

struct Plate {
    database: Database,
    model: Model,
    sheet: DataSheet,
    report: EvaluationReport,
}

/// The database of the repository.
fn database() -> Database {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/pneunet/database");
    read(&folder, ObstacleKind::Plate).expect("the committed database")
}

/// A committed file of the reference actuator's model.
fn committed(file: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/pneunet").join(file);
    std::fs::read(path).expect("a committed file")
}

/// The database and the model that the committed one's configuration makes of it; trained once for all tests.
fn plate() -> &'static Plate {
    static PLATE: OnceLock<Plate> = OnceLock::new();
    PLATE.get_or_init(|| {
        let database = database();
        let sheet: DataSheet = serde_json::from_slice(&committed("pneunet.json")).expect("a data sheet");
        let (model, sheet) = train(&database, &sheet.config, &mut |_| {}).expect("trains");
        let report = test_report(&model, &database);
        Plate { database, model, sheet, report }
    })
}

fn test_report(model: &Model, database: &Database) -> EvaluationReport {
    let cases: Vec<usize> = database.of_split(Split::Test).collect();
    evaluate(model, database, &cases).expect("evaluates")
}

fn mse(report: &EvaluationReport, kind: RegimeKind) -> f64 {
    report.regimes.iter().find(|r| r.regime == kind).expect("regime").mse
}

fn normalised(case: &CaseReport, field: &str) -> f64 {
    case.fields.iter().find(|f| f.field == field).expect("field").normalised
}

fn at_most(what: &str, found: f64, bound: f64) {
    println!("{what}: {found:.3e}, at most {bound:.1e}");
    assert!(found <= bound, "{what}: {found} > {bound}");
}

/// The committed model is what the committed database gives by the configuration in its data sheet: to the byte on the kind of
/// machine that made it, elsewhere (other vector instructions, other rounding) in what it predicts.
#[test]
fn retraining_reproduces_the_committed_model() {
    let plate = plate();
    let committed = Model::from_bytes(&committed("pneunet.twin")).expect("a model");
    let hash = |model: &Model| model.prediction_hash().expect("encodes");
    let same = hash(&plate.model) == hash(&committed);
    println!("the same bytes but for half-widths: {same}");
    let mut states =
        [&plate.model, &committed].map(|m| ModelState::new(m, &Selection::default()).expect("fits"));
    for case in &plate.database.cases {
        let force = states.each_mut().map(|state| {
            state.update(case.inputs()).expect("trained");
            state.evaluation().contact_force_n
        });
        let entries = states[0].fields().iter().zip(states[1].fields());
        let (a, b) = entries
            .map(|(a, b)| (*a, *b))
            .max_by(|x, y| (x.0 - x.1).abs().total_cmp(&(y.0 - y.1).abs()))
            .expect("entries");
        if same {
            assert!(
                a.to_bits() == b.to_bits() && force[0].to_bits() == force[1].to_bits(),
                "case {}",
                case.name
            );
        }
        assert!(
            (a - b).abs() < 1e-4 && (force[0] - force[1]).abs() < 1e-7,
            "case {}: {a} and {b}, {force:?}",
            case.name
        );
    }
    assert!(
        same || !made_here(),
        "this machine made the model, and makes another one of the same database now"
    );
}

/// True if this processor has the vector instructions of the machines that made the models: AVX-512 changes no rounding of
/// training, FMA does.
fn made_here() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Derivatives change the best metric, and with it the order of the kernels.
#[test]
fn metrics_are_chosen_with_the_derivatives_in_the_system() {
    let contact = plate().sheet.regimes.iter().find(|r| r.kind == RegimeKind::Contact).expect("contact");
    let force = contact.force.as_ref().expect("a contact force");
    let best = |with: bool| {
        let fitted = |c: &&Candidate| c.kernel.ends_with("derivatives") == with && c.error.is_some();
        let of: Vec<&Candidate> = force.candidates.iter().filter(fitted).collect();
        of.into_iter().min_by(|a, b| a.error.partial_cmp(&b.error).expect("numbers")).expect("a candidate")
    };
    let (with, without) = (best(true), best(false));
    println!("with derivatives {with:?}, without {without:?}");
    assert!(with.error < without.error, "{with:?} {without:?}");
    assert_eq!(force.candidates[0].kernel, with.kernel, "the best candidate is the one that is taken");
    // The same kernel at the metric that was best without derivatives.
    let of_kernel = |c: &&Candidate| format!("{}, derivatives", c.kernel) == with.kernel && c.error.is_some();
    let kept = force.candidates.iter().find(of_kernel).expect("tried without derivatives as well").metric;
    let unmoved = force.candidates.iter().find(|c| c.kernel == with.kernel && c.metric == kept);
    let unmoved = unmoved.and_then(|c| c.error).expect("tried with them");
    assert!(with.metric != kept && with.error < Some(0.98 * unmoved), "{with:?} {unmoved}");
}

#[test]
fn errors_of_the_papers_test_cases_are_within_limits() {
    let plate = plate();
    at_most("MSE (Eq. 15), free", mse(&plate.report, RegimeKind::Free), 2e-6);
    at_most("MSE (Eq. 15), contact", mse(&plate.report, RegimeKind::Contact), 1e-5);
    for case in &plate.report.cases {
        let (u, s, force) = match case.regime {
            RegimeKind::Free => (1e-4, 1e-3, 0.0),
            RegimeKind::Contact => (6e-4, 1e-2, 2e-3),
        };
        let name = format!("case {} ({} MPa, gap {:?} mm)", case.case, case.pressure_mpa, case.gap_mm);
        at_most(&format!("{name}, normalised displacement"), normalised(case, "displacement"), u);
        at_most(&format!("{name}, normalised stress"), normalised(case, "von_mises"), s);
        at_most(&format!("{name}, force"), case.force_relative.unwrap_or(0.0), force);
    }
}

/// The paper reports 3.56e-4 and 4.18e-3 on its own database.
#[test]
fn papers_method_reproduces_the_papers_errors() {
    let database = &plate().database;
    let (model, _) = train(database, &TrainConfig::paper(), &mut |_| {}).expect("trains");
    let report = test_report(&model, database);
    for (kind, expected) in [(RegimeKind::Free, 3.86e-4), (RegimeKind::Contact, 1.97e-3)] {
        let found = mse(&report, kind);
        println!("the paper's method, {}: MSE {found:.3e}", kind.name());
        assert!((found / expected - 1.0).abs() < 0.02, "{}: {found} is not {expected}", kind.name());
    }
}

#[test]
fn fields_and_force_are_continuous_at_the_onset() {
    let plate = plate();
    let state = ModelState::new(&plate.model, &Selection::default()).expect("fits");
    let mut sides = [(state.clone(), RegimeKind::Free), (state, RegimeKind::Contact)];
    let table = plate.model.header.onset.as_ref().expect("two regimes");
    let (mut jump_mm, mut jump_n, mut jump_stress) = (0.0_f32, 0.0_f64, 0.0_f32);
    let (sag, reach) = (table.sag_mm(), table.reach_mm());
    for step in 0..=200 {
        let gap_mm = (sag + (reach - sag) * f64::from(step) / 200.0).min(reach);
        let onset = match table.onset(gap_mm) {
            Onset::At(onset) => onset,
            Onset::Always if step == 0 => continue, // at the sag itself there is no other side
            other => panic!("gap {gap_mm} mm is within reach, found {other:?}"),
        };
        for (side, (state, kind)) in sides.iter_mut().enumerate() {
            let pressure_mpa = onset * (1.0 + 1e-9 * (2.0 * side as f64 - 1.0));
            state.update(Inputs::new(pressure_mpa, gap_mm)).expect("trained");
            assert_eq!(state.evaluation().regime, *kind);
        }
        let [(below, _), (above, _)] = &sides;
        let lengths = 4 * below.reconstructor().rows(); // x, y, z and the displacement
        let jumps = below.fields()[..lengths].iter().zip(above.fields()).map(|(a, b)| (a - b).abs());
        jump_mm = jumps.fold(jump_mm, f32::max);
        let stresses = [below, above].map(|state| &state.fields()[lengths..]);
        let largest = stresses[1].iter().fold(0.0, |most: f32, s| most.max(*s));
        let jumps = stresses[0].iter().zip(stresses[1]).map(|(a, b)| (a - b).abs() / largest);
        jump_stress = jumps.fold(jump_stress, f32::max);
        let [below_n, above_n] = [below, above].map(|state| state.evaluation().contact_force_n);
        jump_n = jump_n.max((above_n - below_n).abs());
    }
    at_most("jump at the onset, mm", f64::from(jump_mm), 0.05);
    at_most("jump at the onset, N", jump_n, 1e-3);
    at_most("jump of stress at the onset, over the state's largest", f64::from(jump_stress), 3e-3);
}

#[test]
fn training_cases_are_reproduced_to_the_truncation_error() {
    let plate = plate();
    let cases: Vec<usize> = plate.database.of_split(Split::Train).collect();
    let report = evaluate(&plate.model, &plate.database, &cases).expect("evaluates");
    // Kept modes are interpolated through the sample; those that a reconstruction leaves out by default and steps of i16 remain.
    let mut missed = [0.0_f64; 3];
    for case in &report.cases {
        for field in &case.fields {
            let (Some(truncation), Some(interpolation)) = (field.truncation_max, field.interpolation_max)
            else {
                continue;
            };
            assert!(field.max <= truncation + interpolation + 1e-4, "case {}, {}", case.case, field.field);
            let kind = match field.field == "von_mises" {
                true if case.pressure_mpa < WEIGHT_MPA => 2,
                is_stress => usize::from(is_stress),
            };
            let share = field.normalised / field.max.max(f64::MIN_POSITIVE);
            missed[kind] = missed[kind].max(interpolation * share);
        }
    }
    at_most("training cases, coordinates missed beyond truncation", missed[0], 1e-4);
    at_most("training cases, stress missed beyond truncation", missed[1], 5e-3);
    at_most("the same under the own weight", missed[2], 2e-2);
}

/// Leave-one-out over the contact cases inside the hull: what a state never trained on can expect, over-stated.
#[test]
fn left_out_contact_cases_are_predicted() {
    let plate = plate();
    let contact = plate.sheet.regimes.iter().find(|r| r.kind == RegimeKind::Contact).expect("contact");
    let inside: Vec<_> = contact.leave_one_out.iter().filter(|c| !c.on_hull).collect();
    let pressure_mpa =
        |name: &str| plate.database.cases.iter().find(|c| c.name == name).expect("case").pressure_mpa;
    let (weight, inflated): (Vec<_>, Vec<_>) =
        inside.iter().copied().partition(|c| pressure_mpa(&c.case) < WEIGHT_MPA);
    // Their largest stress is small, so the limit is absolute.
    let [_, stress_mpa, _] = spread(&mut weight.iter().map(|c| c.stress_mpa).collect::<Vec<_>>());
    at_most("left-out stress under the own weight, 95th percentile, MPa", stress_mpa, 5.3e-3);
    let largest = |name: &str, field: usize| {
        let case = plate.database.cases.iter().position(|c| c.name == name).expect("case");
        plate.database.field(case, field).fold(0.0, |m: f64, v| m.max(f64::from(v).abs()))
    };
    let mut errors = [
        inside.iter().map(|c| c.displacement_mm / largest(&c.case, 3)).collect::<Vec<_>>(),
        inflated.iter().map(|c| c.stress_mpa / largest(&c.case, 4)).collect(),
        inside.iter().map(|c| c.force_n / 0.856).collect(),
    ];
    let bounds = [("displacement", 6e-4, 1.5e-3), ("stress", 9e-3, 2.0e-2), ("force", 5e-4, 1.2e-3)];
    for (errors, (name, mean, p95)) in errors.iter_mut().zip(bounds) {
        let [found_mean, found_p95, _] = spread(errors);
        at_most(&format!("left-out {name}, mean"), found_mean, mean);
        at_most(&format!("left-out {name}, 95th percentile"), found_p95, p95);
    }
}

/// Every so-many-th node of a database: what does not depend on the mesh is trained in a fraction of the time.
fn thinned(database: &Database, every: usize) -> Database {
    let (fields, nodes) = (database.fields.len(), database.node_count);
    let kept: Vec<usize> = (0..nodes).step_by(every).collect();
    // Rows of `width` values per node.
    let rows = |values: &[f32], width: usize| -> Vec<f32> {
        let states = values.chunks_exact(nodes * width);
        states
            .flat_map(|state| kept.iter().flat_map(move |n| &state[n * width..(n + 1) * width]))
            .copied()
            .collect()
    };
    let set = |set: &NodeSet| NodeSet {
        nodes: set
            .nodes
            .iter()
            .filter(|n| (**n as usize).is_multiple_of(every))
            .map(|n| n / every as u32)
            .collect(),
        ..set.clone()
    };
    Database {
        node_count: kept.len(),
        snapshots: rows(&database.snapshots, fields),
        undeformed_mm: database.undeformed_mm.as_ref().map(|all| kept.iter().map(|n| all[*n]).collect()),
        surface_triangles: Vec::new(),
        node_sets: database.node_sets.iter().map(set).filter(|set| !set.nodes.is_empty()).collect(),
        sensitivities: database
            .sensitivities
            .as_ref()
            .map(|known| Sensitivities { values: rows(&known.values, known.fields.len()), ..known.clone() }),
        ..database.clone()
    }
}

/// Nominal coverage of 90 %: two thirds of the contact cases, held out in two parts from training and calibration,
/// are covered to 85-99 % (binomial spread allowed for).
#[test]
fn coverage_is_nominal_on_held_out_cases() {
    let whole = thinned(&plate().database, 8);
    let touching = |i: &usize| whole.cases[*i].contact_force_n > 0.0;
    let train_cases: Vec<usize> = whole.of_split(Split::Train).filter(touching).collect();
    let config = TrainConfig::default();
    let (mut held_out, mut covered) = (0, [0; 3]);
    for fold in 0..2 {
        let held: Vec<usize> = train_cases.iter().copied().skip(fold).step_by(3).collect();
        let mut database = whole.clone();
        held.iter().for_each(|&i| database.cases[i].split = Split::Check);
        let (model, _) = train(&database, &config, &mut |_| {}).expect("trains");
        for case in evaluate(&model, &database, &held).expect("evaluates").cases {
            // A state that its neighbours do not enclose has no half-widths.
            held_out += i32::from(case.covered.displacement.is_some());
            let within = [case.covered.displacement, case.covered.stress, case.covered.force];
            covered.iter_mut().zip(within).for_each(|(n, c)| *n += usize::from(c == Some(true)));
        }
    }
    for (name, covered) in ["displacement", "stress", "force"].into_iter().zip(covered) {
        let share = covered as f64 / f64::from(held_out);
        println!("{name}: {:.1} % of {held_out} held-out cases within the half-width of 90 %", 100.0 * share);
        assert!((0.80..=0.995).contains(&share), "{name}: {share}");
    }
}

#[test]
fn states_outside_the_training_range_are_flagged() {
    let plate = plate();
    let cases: Vec<usize> = plate.database.of_split(Split::Check).collect();
    let report = evaluate(&plate.model, &plate.database, &cases).expect("evaluates");
    for case in &report.cases {
        println!(
            "check case {}: {:?} by {:.3}, force {:.4} N",
            case.case, case.domain, case.domain_distance, case.force_n
        );
        let beyond = case.pressure_mpa > 0.09 || case.gap_mm.is_some_and(|g| g < 10.0);
        let never = if beyond { DomainStatus::Inside } else { DomainStatus::Outside };
        assert_ne!(case.domain, never, "case {}", case.case);
    }
}

#[test]
fn database_with_one_gap_is_trained() {
    let along = |from: f64, i: usize, count: usize| from + (0.09 - from) * i as f64 / (count - 1) as f64;
    let free = (0..12).map(|i| (Split::Train, along(0.0, i, 12), None));
    let contact = (0..16).map(|i| (Split::Train, along(0.012, i, 16), Some(25.0)));
    let held_out = [0.031, 0.052, 0.077].map(|pressure| (Split::Test, pressure, Some(25.0)));
    let states: Vec<synthetic::State> = free.chain(contact).chain(held_out).collect();
    let database = synthetic::database(&states);
    let (model, _) = train(&database, &TrainConfig::default(), &mut |_| {}).expect("trains");
    let contact = model.regime(RegimeKind::Contact).expect("contact");
    assert_eq!(contact.inputs.dimensions(), 1, "a constant gap is no input");
    for case in test_report(&model, &database).cases {
        at_most("one gap, normalised displacement", normalised(&case, "displacement"), 1e-3);
        at_most("one gap, normalised stress", normalised(&case, "von_mises"), 1e-2);
        at_most("one gap, force", case.force_relative.unwrap_or(0.0), 5e-3);
    }
}
