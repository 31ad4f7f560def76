//! The largest stress of the shipped models, found without the field and in it.

use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::Inputs;
use rom::model::{Model, Nodes, Selection};
use rom::reconstructor::Reconstructor;
use rom::rng::Rng;
use rom::snapshots::FieldKind;
use rom::stress_peak::StressPeak;

const STATES: usize = 2000;

fn model(name: &str) -> Model {
    let path = format!("{}/../../models/{name}/{name}.twin", env!("CARGO_MANIFEST_DIR"));
    Model::from_bytes(&std::fs::read(path).expect("in the repository")).expect("loads")
}

/// A state among the training inputs, or some way beyond them.
fn state(model: &Model, random: &mut Rng, is_wide: bool) -> Inputs {
    let reach = if is_wide { 0.5 } else { 0.0 };
    let specs = model.header.inputs.iter().enumerate();
    specs.fold(Inputs::new(0.0, 0.0), |inputs, (at, spec)| {
        let [low, high] = spec.range;
        inputs.with(at, low + (high - low) * (random.uniform() * (1.0 + 2.0 * reach) - reach))
    })
}

fn check(name: &str) {
    let model = model(name);
    let field =
        model.header.fields.iter().find(|field| field.spec.kind == FieldKind::Stress).expect("stress");
    let selection = Selection { fields: Some(vec![field.spec.name.clone()]), nodes: Nodes::All };
    let whole = Reconstructor::new(&model, &selection).expect("fits");
    let evaluator = Evaluator::new(&model.header).expect("consistent");
    let stress = model.header.fields.iter().position(|field| field.spec.kind == FieldKind::Stress);
    let mut restricted = evaluator.clone();
    restricted.restrict(&[stress.expect("stress")]);
    let mut search = StressPeak::new(&model).expect("whole").expect("stress");
    let (mut evaluation, mut some) = (evaluator.evaluation(), evaluator.evaluation());
    let (mut values, mut random) = (vec![0.0; whole.entries()], Rng::new(22));
    let (mut inside, mut computed) = (0, 0.0);
    for number in 0..STATES {
        let inputs = state(&model, &mut random, number % 2 == 1);
        evaluator.evaluate(inputs, &mut evaluation);
        restricted.evaluate(inputs, &mut some);
        let wanted =
            whole.reconstruct_into(&evaluation, &mut values).expect("fits").stress_mpa.expect("stress");
        for of in [&evaluation, &some] {
            let found = search.find(of).expect("fits");
            assert_eq!(
                found.value.to_bits(),
                wanted.value.to_bits(),
                "{name}: {inputs:?} {found:?} {wanted:?}"
            );
            assert_eq!(found.node, wanted.node, "{name}: {inputs:?}");
        }
        if evaluation.domain == DomainStatus::Inside {
            (inside, computed) = (inside + 1, computed + search.computed_share());
        }
    }
    assert!(inside > STATES / 20, "{name}: {inside} states among the training states");
    let share = computed / f64::from(inside as u32);
    assert!(share < 0.05, "{name}: the stress of {share} of the nodes was computed: the bounds are loose");
}

#[test]
fn of_the_finger() {
    check("pneunet");
}

#[test]
fn of_the_gripper_finger() {
    check("gripper");
}

#[test]
fn of_the_finger_with_a_stiffness() {
    check("pneunet-stiffness");
}

#[test]
fn of_the_finger_with_five_parameters() {
    check("pneunet-design");
}
