//! Answers of a model along each of its inputs, the others at the middle of their ranges, without an obstacle.

use crate::bench::{line, panel};
use crate::failure::usage;
use crate::picture::{Figure, Mark};
use anyhow::Result;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, InputAxis, Inputs};
use rom::model::{Model, RegimeModel, Selection};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::snapshots::RegimeKind;

/// Steps along an input, as in the force map.
pub const CELLS: usize = 120;
/// Modal coefficients shown.
const LEADING: usize = 4;

/// States along one input.
struct Sweep {
    /// Name with unit.
    input: String,
    states: Vec<(f64, Inputs)>,
}

/// The free regime and a sweep for each of its inputs.
fn sweeps(model: &Model) -> Result<(&RegimeModel, Vec<Sweep>)> {
    let regime = model
        .regime(RegimeKind::Free)
        .ok_or_else(|| usage("expected a model with a free regime; `softtwin inspect` shows its regimes"))?;
    let middle = |axis: &InputAxis| 0.5 * (axis.min + axis.max);
    let start = Inputs::new(f64::NAN, f64::INFINITY);
    let axes = || regime.inputs.axes.iter().filter(|axis| axis.input != GAP);
    let centre = axes().fold(start, |state, axis| state.with(axis.input, middle(axis)));
    let of = |axis: &InputAxis| {
        let value = |i: usize| axis.min + i as f64 / CELLS as f64 * (axis.max - axis.min);
        let states = (0..=CELLS).map(|i| (value(i), centre.with(axis.input, value(i))));
        Sweep { input: model.header.inputs[axis.input].key(), states: states.collect() }
    };
    Ok((regime, axes().map(of).collect()))
}

/// Leading modal coefficients by group.
pub fn coefficients(model: &Model) -> Result<Figure> {
    let (regime, sweeps) = sweeps(model)?;
    let evaluator = Evaluator::new(&model.header)?;
    let mut evaluation = evaluator.evaluation();
    let mut panels = Vec::new();
    for sweep in &sweeps {
        let mut evaluated = |(value, inputs): &(f64, Inputs)| {
            evaluator.evaluate(*inputs, &mut evaluation);
            (*value, evaluation.coefficients.clone())
        };
        let states: Vec<(f64, Vec<f64>)> = sweep.states.iter().map(&mut evaluated).collect();
        for group in &regime.groups {
            let mode = |(k, at): (usize, usize)| {
                let points = states.iter().filter_map(|(p, a)| Some((*p, *a.get(at)?)));
                line(&format!("mode {}", k + 1), k, Mark::Line, points)
            };
            let series = group.coefficients.clone().take(LEADING).enumerate().map(mode).collect();
            panels.push(panel(&group.name, &sweep.input, "modal coefficient", series));
        }
    }
    let title = format!("Modal coefficients of {}, free regime", model.header.actuator);
    Ok(Figure { title, panels, columns: 2 })
}

/// Observables, and the outputs of a measured model, with their half-widths.
pub fn observables(model: &Model) -> Result<Figure> {
    let (_, sweeps) = sweeps(model)?;
    let observables = Observables::of(model)?;
    let outputs = train::measured::outputs(model);
    if observables.count() + outputs.len() == 0 {
        return Err(usage(
            "the model has no observables; define them in [observables] of a training configuration",
        ));
    }
    let mut state = ModelState::new(model, &Selection::default())?;
    let names: Vec<String> =
        observables.names().map(str::to_owned).chain(outputs.iter().map(|o| o.name.clone())).collect();
    let mut panels = Vec::new();
    for sweep in &sweeps {
        let mut curves: Vec<Vec<(f64, f64, f64)>> = vec![Vec::new(); names.len()];
        for (x, inputs) in &sweep.states {
            state.update(*inputs)?;
            let observed = (0..observables.count()).map(|at| {
                let found = observables.value(at, state.evaluation());
                (found.value, found.halfwidth)
            });
            let measured = outputs.iter().map(|output| {
                let at = output.field * model.header.node_count + output.node;
                (f64::from(state.fields()[at]), output.half_width_of(state.evaluation()))
            });
            curves.iter_mut().zip(observed.chain(measured)).for_each(|(to, (v, h))| to.push((*x, v, h)));
        }
        for (name, curve) in names.iter().zip(&curves) {
            let of = |label: &str, colour, sign: f64| {
                line(label, colour, Mark::Line, curve.iter().map(|(x, v, h)| (*x, v + sign * h)))
            };
            let series = vec![of("", 0, 0.0), of("half-width", 4, 1.0), of("", 4, -1.0)];
            panels.push(panel("", &sweep.input, name, series));
        }
    }
    Ok(Figure { title: format!("Observables of {}, free regime", model.header.actuator), panels, columns: 2 })
}
