//! Charts of what a model has learnt: the force map, singular values, and answers along each of its inputs, the others at the middle of
//! their ranges, without an obstacle.

use crate::failure::usage;
use crate::picture::{Axis, Figure, Map, Mark, Panel, Series};
use anyhow::Result;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, InputAxis, Inputs, PRESSURE};
use rom::model::{GroupModel, Model, RegimeModel, Selection};
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::regime::OnsetTable;
use rom::snapshots::{Database, RegimeKind, Split};

/// Steps along an input, as in the force map.
const CELLS: usize = 120;
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
    let sweep = |axis: &InputAxis| {
        let value = |i: usize| axis.min + i as f64 / CELLS as f64 * (axis.max - axis.min);
        let states = (0..=CELLS).map(|i| (value(i), centre.with(axis.input, value(i))));
        Sweep { input: model.header.inputs[axis.input].key(), states: states.collect() }
    };
    Ok((regime, axes().map(sweep).collect()))
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
                Series::line(format!("mode {}", k + 1), k, points)
            };
            let series = group.coefficients.clone().take(LEADING).enumerate().map(mode).collect();
            panels.push(Panel::new(&group.name, sweep.input.as_str(), "modal coefficient", series));
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
                let entry = output.field * model.header.node_count + output.node;
                (f64::from(state.fields()[entry]), output.half_width_of(state.evaluation()))
            });
            curves.iter_mut().zip(observed.chain(measured)).for_each(|(to, (v, h))| to.push((*x, v, h)));
        }
        for (name, curve) in names.iter().zip(&curves) {
            let line = |label: &str, colour, sign: f64| {
                Series::line(label, colour, curve.iter().map(|(x, v, h)| (*x, v + sign * h)))
            };
            let series = vec![line("", 0, 0.0), line("half-width", 4, 1.0), line("", 4, -1.0)];
            panels.push(Panel::new("", sweep.input.as_str(), name.as_str(), series));
        }
    }
    Ok(Figure { title: format!("Observables of {}, free regime", model.header.actuator), panels, columns: 2 })
}

pub fn force_map(model: &Model, database: Option<&Database>) -> Result<Figure> {
    let contact = model.regime(RegimeKind::Contact).filter(|regime| regime.inputs.dimensions() == 2);
    let range = |input| contact.and_then(|regime| regime.inputs.range(input));
    let (Some(pressures), Some(gaps)) = (range(PRESSURE), range(GAP)) else {
        return Err(usage(
            "force-map: expected a model with a contact regime over pressure and gap; `softtwin inspect` shows its regimes",
        ));
    };
    let (x, y) = ([0.0, pressures[1]], gaps);
    let evaluator = Evaluator::new(&model.header)?;
    let mut evaluation = evaluator.evaluation();
    let mut values = Vec::with_capacity(CELLS * CELLS);
    for row in 0..CELLS {
        for column in 0..CELLS {
            let centre = |range: [f64; 2], i: usize| {
                range[0] + (i as f64 + 0.5) / CELLS as f64 * (range[1] - range[0])
            };
            evaluator.evaluate(Inputs::new(centre(x, column), centre(y, row)), &mut evaluation);
            values.push(evaluation.contact_force_n);
        }
    }
    let mut series: Vec<Series> = model.header.onset.iter().map(|table| onset_curve(table, x, y)).collect();
    for (name, split, colour) in
        [("training states", Split::Train, 4), ("test and check states", Split::Test, 5)]
    {
        let same = |s: Split| (s == Split::Train) == (split == Split::Train);
        let cases = database
            .iter()
            .flat_map(|d| &d.cases)
            .filter(|c| c.regime == RegimeKind::Contact && same(c.split));
        let seen = cases.filter_map(|c| Some((c.pressure_mpa, c.gap_mm?)));
        let inside = seen.filter(|(p, g)| *p <= x[1] && (y[0]..=y[1]).contains(g));
        series.push(Series::new(name, colour, Mark::Dots, inside));
    }
    series.retain(|series| !series.points.is_empty());
    let map = Map { label: "contact force [N]".into(), x, y, columns: CELLS, values };
    let panel = Panel { map: Some(map), ..Panel::new("", "pressure [MPa]", "gap [mm]", series) };
    Ok(Figure::one(&format!("Contact force of {}", model.header.actuator), panel))
}

fn onset_curve(table: &OnsetTable, x: [f64; 2], y: [f64; 2]) -> Series {
    let points = table.pressure_mpa.iter().copied().zip(table.gap_mm.iter().copied());
    let inside = points.filter(|(p, g)| (x[0]..=x[1]).contains(p) && (y[0]..=y[1]).contains(g));
    Series::line("onset pressure", 1, inside)
}

pub fn singular_values(model: &Model) -> Figure {
    let panel = |regime: &RegimeModel| {
        let decay = |(colour, group): (usize, &GroupModel)| {
            let largest = group.singular_values.first().copied().unwrap_or(1.0);
            let values = group.singular_values.iter().enumerate().filter(|(_, s)| **s > 1e-14 * largest);
            let name = format!("{} ({} kept)", group.name, group.coefficients.len());
            Series::new(name, colour, Mark::LineDots, values.map(|(k, s)| (k as f64 + 1.0, s / largest)))
        };
        let series = regime.groups.iter().enumerate().map(decay).collect();
        let title = format!("Regime {}", regime.kind.name());
        Panel::new(title, "mode", Axis::log("singular value / largest"), series)
    };
    let panels: Vec<Panel> = model.header.regimes.iter().map(panel).collect();
    Figure {
        title: format!("Singular values of {}", model.header.actuator),
        columns: panels.len().max(1),
        panels,
    }
}
