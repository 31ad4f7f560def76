//! Points of the mesh: their positions are those of the whole field, their derivatives those of differences.

use rom::evaluator::{Evaluator, Query};
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::probe::{MeshPoint, PointError, ProbePosition, Probes, model_tip, tip_node};
use rom::reconstructor::Reconstructor;
use rom::regime::LastOnset;
use rom::snapshots::RegimeKind;

fn shipped() -> Model {
    committed(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/pneunet.twin"))
}

fn committed(path: &str) -> Model {
    Model::from_bytes(&std::fs::read(path).expect("the committed model")).expect("a model")
}

#[test]
fn positions_match_the_field_and_derivatives_match_differences() {
    let model = shipped();
    let evaluator = Evaluator::new(&model.header).expect("evaluator");
    let reconstructor = Reconstructor::new(&model, &Selection::default()).expect("reconstructor");
    let nodes = [0_u32, 12_000, 25_021];
    let points = nodes.map(|node| MeshPoint::node(&model, node).expect("a node"));
    let probes = Probes::new(&model, &points).expect("probes");
    let mut evaluation = evaluator.evaluation();
    let mut fields = vec![0.0; reconstructor.entries()];
    let (mut scratch, mut at) = (probes.evaluation(), [ProbePosition::default(); 3]);
    let mut beside = at;
    for (pressure_mpa, gap_mm) in [(0.01, 45.3), (0.05, 30.37), (0.09, 20.21)] {
        evaluator.answer(Inputs::new(pressure_mpa, gap_mm), Query::GRADIENTS, &mut evaluation);
        reconstructor.reconstruct_into(&evaluation, &mut fields).expect("fields");
        probes.answer(Inputs::new(pressure_mpa, gap_mm), Query::GRADIENTS, &mut scratch, &mut at);
        let force = (scratch.regime, scratch.contact_force_n, scratch.force_gradient);
        assert_eq!(force, (evaluation.regime, evaluation.contact_force_n, evaluation.force_gradient));
        for (probe, node) in at.iter().zip(nodes) {
            for (axis, position) in probe.position_mm.iter().enumerate() {
                let field = f64::from(fields[axis * reconstructor.rows() + node as usize]);
                assert!((position - field).abs() < 2e-4, "node {node} axis {axis}: {position} {field}");
            }
        }
        for (input, step) in [(0, 1e-5), (1, 1e-2)] {
            let moved = |by: f64| {
                let values = [pressure_mpa, gap_mm];
                Inputs::new(values[0], values[1]).with(input, values[input] + by)
            };
            let mut difference = |by: f64| {
                probes.answer(moved(by), Query::GRADIENTS, &mut scratch, &mut beside);
                beside
            };
            let (above, below) = (difference(step), difference(-step));
            for (probe, (above, below)) in at.iter().zip(above.iter().zip(&below)) {
                for axis in 0..3 {
                    let slope = (above.position_mm[axis] - below.position_mm[axis]) / (2.0 * step);
                    let found = probe.gradient[axis][input];
                    assert!(
                        (found - slope).abs() <= 1e-5 * slope.abs() + 2e-4,
                        "{input} {axis}: {found} {slope}"
                    );
                }
            }
        }
    }
}

#[test]
fn points_of_the_mesh_are_found_and_others_are_refused() {
    let model = shipped();
    let tip = MeshPoint::at(&model, [115.0, 2.0, 16.0]).expect("the middle of the base's free end");
    let sum: f64 = tip.weights.iter().map(|(_, weight)| weight).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{tip:?}");
    for wanted in [[57.3, 0.0, 10.1], [110.2, 3.1, 8.8]] {
        let point = MeshPoint::at(&model, wanted).expect("a point inside");
        assert!(point.weights.iter().all(|(_, weight)| weight.abs() < 3.0), "{point:?}");
    }
    let far = MeshPoint::at(&model, [200.0, 0.0, 16.0]).expect_err("outside");
    assert!(matches!(far, PointError::OffMesh { distance_mm, .. } if distance_mm > 80.0), "{far}");
    let none = MeshPoint::node(&model, 25_022).expect_err("no such node");
    assert_eq!(none.to_string(), "node 25022: the mesh has 25022 nodes, numbered from 0");
}

#[test]
fn tip_is_nearest_to_the_middle_of_the_end_face() {
    let face = [[9.995, 0.0, 0.0], [10.0, 4.0, 0.0], [10.0, 0.0, 6.0], [10.0, 1.0, 2.0], [9.0, 1.5, 2.0]];
    assert_eq!(tip_node(&face), Some(3), "the last one lies before the end face");
    assert_eq!((tip_node(&face[4..]), tip_node(&[])), (Some(0), None));
    assert_eq!(model_tip(&shipped()), Some(334));
}

/// A walk through inflation, stiffness and gap, of a model whose onset depends on the stiffness.
#[test]
fn near_search_matches_full_search_and_free_states_match_no_obstacle() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet-design/pneunet-design.twin");
    let model = committed(path);
    let probes = Probes::new(&model, &[MeshPoint::node(&model, 12_000).expect("a node")]).expect("probes");
    let (mut scratch, mut near, mut last) = (probes.evaluation(), probes.evaluation(), LastOnset::default());
    let mut at = [[ProbePosition::default()]; 2];
    let mut touched = 0;
    for step in 0..400 {
        let t = f64::from(step) / 400.0;
        let wave = (40.0 * t).sin();
        let state = Inputs::new(0.01 + 0.075 * t, 42.0 + 3.0 * wave).with(2, 0.8 + 0.05 * (55.0 * t).cos());
        probes.answer(state, Query::GRADIENTS, &mut scratch, &mut at[0]);
        let query = Query { range: false, near: Some(&mut last), ..Query::GRADIENTS };
        probes.answer(state, query, &mut near, &mut at[1]);
        let force = (near.contact_force_n - scratch.contact_force_n).abs();
        assert!(near.regime == scratch.regime && force < 1e-5, "{state:?}: {force} N");
        let slopes = near.force_gradient.iter().zip(scratch.force_gradient);
        slopes.for_each(|(near, full)| {
            assert!((near - full).abs() < 1e-3 * full.abs() + 1e-4, "{near} {full}")
        });
        assert_eq!(at[0], at[1], "{state:?}");
        touched += u32::from(near.regime == RegimeKind::Contact);
        probes.answer(state.with(1, f64::INFINITY), Query::GRADIENTS, &mut scratch, &mut at[0]);
        let query = Query { range: false, regime: Some(RegimeKind::Free), ..Query::GRADIENTS };
        probes.answer(state, query, &mut near, &mut at[1]);
        assert!(near.regime == RegimeKind::Free && near.contact_force_n == 0.0);
        assert_eq!(at[0], at[1], "{state:?}");
    }
    assert!((200..395).contains(&touched), "{touched}");
}
