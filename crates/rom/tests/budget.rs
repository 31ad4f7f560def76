//! A basis stored within an accepted error, on the shipped model: it loses nothing that can be measured and is smaller.

use formats::database::{ObstacleKind, read};
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::kernel::{Basis, Precision};
use rom::model::{Model, ModelError, ModelReader, Selection};
use rom::model_state::ModelState;
use rom::reconstructor::{Reconstructor, Storage};
use rom::snapshots::{RegimeKind, Split};
use std::path::PathBuf;

fn shipped() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models/pneunet")
}

fn model() -> Model {
    let bytes = std::fs::read(shipped().join("pneunet.twin")).expect("the shipped model");
    ModelReader::open(std::io::Cursor::new(bytes))
        .and_then(|mut r| r.load(&Selection::default()))
        .expect("reads")
}

/// Bytes that a reconstruction reads at most, of both regimes together.
fn bytes(fields: &Reconstructor) -> usize {
    let of = |kind| fields.largest_basis(kind).map_or(0, Basis::bytes);
    of(RegimeKind::Free) + of(RegimeKind::Contact)
}

/// Errors of a state by field: the worst node's, and the root mean square over the nodes.
fn errors(state: &ModelState, truth: &[Vec<f64>]) -> Vec<[f64; 2]> {
    let of = |(values, truth): (&[f32], &Vec<f64>)| {
        let errors = || values.iter().zip(truth).map(|(value, truth)| (f64::from(*value) - truth).abs());
        let square: f64 = errors().map(|error| error * error).sum();
        [errors().fold(0.0, f64::max), (square / truth.len() as f64).sqrt()]
    };
    state.fields().chunks_exact(truth[0].len()).zip(truth).map(of).collect()
}

#[test]
fn the_default_lets_no_error_on_unseen_states_grow_by_more_than_two_per_cent() {
    let model = model();
    let database = read(&shipped().join("database"), ObstacleKind::Plate).expect("the committed database");
    let mut full = ModelState::new(&model, &Selection::default()).expect("fits");
    let mut small =
        ModelState::with_precision(&model, &Selection::default(), Storage::AS_GOOD).expect("fits");
    let fields = database.fields.len();
    // By field and measure: the errors of all states, in full and stored.
    let mut all = vec![[[Vec::new(), Vec::new()], [Vec::new(), Vec::new()]]; fields];
    for case in database.of_split(Split::Check).chain(database.of_split(Split::Test)) {
        full.update(database.cases[case].inputs()).expect("trained");
        small.update(database.cases[case].inputs()).expect("trained");
        if full.evaluation().domain != DomainStatus::Inside {
            continue;
        }
        let truth: Vec<Vec<f64>> =
            (0..fields).map(|field| database.field(case, field).map(f64::from).collect()).collect();
        for (which, state) in [&full, &small].into_iter().enumerate() {
            for (field, found) in errors(state, &truth).into_iter().enumerate() {
                found.iter().enumerate().for_each(|(measure, error)| all[field][measure][which].push(*error));
            }
        }
    }
    assert!(all[0][0][0].len() >= 57, "the unseen states inside the domain");
    for (of, by_measure) in database.fields.iter().zip(&mut all) {
        for (measure, [before, after]) in ["worst node", "root mean square"].into_iter().zip(by_measure) {
            let figures = |errors: &mut Vec<f64>| {
                errors.sort_by(f64::total_cmp);
                let mean = errors.iter().sum::<f64>() / errors.len() as f64;
                [mean, errors[errors.len() * 95 / 100], errors[errors.len() - 1]]
            };
            let (before, after) = (figures(before), figures(after));
            for (figure, (before, after)) in
                ["mean", "95th percentile", "worst"].into_iter().zip(before.into_iter().zip(after))
            {
                let growth = 100.0 * (after / before - 1.0);
                println!(
                    "{}, {measure}, {figure}: {before:.3e} {}, grows by {growth:.2} %",
                    of.name, of.unit
                );
                assert!(growth <= 2.0, "{}, {measure}, {figure}: {before} becomes {after}", of.name);
            }
        }
    }
    let [small, full] = [bytes(small.reconstructor()), bytes(full.reconstructor())];
    println!("bases of both regimes: {small} bytes for {full}");
    assert!(small as f64 <= 0.30 * full as f64, "{small} bytes for {full}");
}

#[test]
fn fields_stay_as_good_where_readings_pass_from_one_part_of_the_domain_to_the_next() {
    let model = model();
    let with = |storage| ModelState::with_precision(&model, &Selection::default(), storage).expect("fits");
    let mut full = with(Precision::F32.into());
    let (mut parts, mut whole) = (with(Storage::AS_GOOD), with(Storage::AS_GOOD.in_parts(1)));
    assert_eq!(whole.reconstructor().bases(RegimeKind::Contact).len(), 1);
    assert_eq!(parts.reconstructor().bases(RegimeKind::Contact).len(), Storage::PARTS);
    let [of_parts, of_whole] = [&parts, &whole].map(|state| bytes(state.reconstructor()));
    println!("read at most, both regimes: {of_parts} bytes of a part, {of_whole} of the whole domain");
    assert!(of_parts as f64 <= 0.75 * of_whole as f64, "{of_parts} bytes for {of_whole}");

    // By field and state on the way what storage adds, as a root mean square over the nodes: in parts, and in one.
    let (mut all, mut passed, mut last) = (vec![[Vec::new(), Vec::new()]; 5], 0, None);
    for step in 0..600 {
        let along = f64::from(step) / 600.0;
        let inputs = Inputs::new(0.005 + 0.084 * (7.0 * along).fract(), 10.0 + 40.0 * along);
        for state in [&mut full, &mut parts, &mut whole] {
            state.update(inputs).expect("trained");
        }
        let basis = parts.reconstructor().basis_of(parts.evaluation()).map(std::ptr::from_ref);
        passed += usize::from(last.replace(basis).is_some_and(|last| last != basis));
        let in_full = full.fields().chunks_exact(full.reconstructor().rows());
        let in_full: Vec<Vec<f64>> = in_full.map(|of| of.iter().map(|v| f64::from(*v)).collect()).collect();
        for (at, state) in [&parts, &whole].into_iter().enumerate() {
            all.iter_mut().zip(errors(state, &in_full)).for_each(|(all, [_, added])| all[at].push(added));
        }
    }
    assert!(passed >= 20, "from part to part {passed} times");
    for (field, all) in all.into_iter().enumerate() {
        let [in_parts, in_one] = all.map(|mut added| {
            added.sort_by(f64::total_cmp);
            [added[added.len() / 2], added[added.len() * 95 / 100], added[added.len() - 1]]
        });
        println!("field {field}: {in_parts:?} in parts, {in_one:?} in one: half of the states, 95 %, all");
        for (allowed, (in_parts, in_one)) in [1.2, 1.5, 3.0].into_iter().zip(in_parts.into_iter().zip(in_one))
        {
            assert!(in_parts <= allowed * in_one, "field {field}: {in_parts} in parts, {in_one} in one");
        }
    }
}

#[test]
fn an_error_that_no_basis_keeps_is_refused_with_what_can_be_kept() {
    let model = model();
    let refused =
        Reconstructor::with_precision(&model, &Selection::default(), Storage::within(1e-9)).unwrap_err();
    let ModelError::AcceptedError { regime, accepted, least, fields } = &refused else { panic!("{refused}") };
    assert_eq!((*regime, *accepted), ("free", 1e-9));
    assert!(*least > 1e-9 && *least < 0.02 && !fields.is_empty(), "{refused}");
    let text = refused.to_string();
    println!("{text}");
    assert!(
        text.contains("y may have") && text.contains(" mm") && text.contains("accept a share of"),
        "{text}"
    );
    for nothing in [0.0, -1.0, f64::NAN] {
        let refused = Reconstructor::with_precision(&model, &Selection::default(), Storage::within(nothing));
        assert!(matches!(refused, Err(ModelError::AcceptedError { .. })), "{nothing}");
    }
}

#[test]
fn what_is_stored_follows_what_is_accepted() {
    let model = model();
    let selection =
        Selection { fields: Some(vec!["displacement".into(), "von_mises".into()]), ..Selection::default() };
    let size =
        |storage: Storage| bytes(&Reconstructor::with_precision(&model, &selection, storage).expect("fits"));
    let shares = [0.01, 0.02, 0.5].map(|share| size(Storage::within(share)));
    assert!(shares[0] > shares[1] && shares[1] > shares[2], "{shares:?}");
    assert!(shares[1] < size(Precision::I16.into()), "{shares:?}");
}
