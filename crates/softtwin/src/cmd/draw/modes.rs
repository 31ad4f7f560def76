//! POD modes as pictures: each mode's shape as colour on the mean state of its regime (the paper's Fig. 6).

use super::args::Args;
use crate::failure::usage;
use crate::picture::canvas::Canvas;
use crate::picture::colour::ColourMap;
use crate::picture::scale::Scale;
use crate::picture::scene::Scene;
use crate::picture::sheet::{Panel, Row, Sheet};
use crate::picture::skin::DrawnBody;
use crate::picture::states::ShownField;
use crate::picture::visible::visible_facets;
use anyhow::{Context, Result};
use rom::model::{Model, RegimeModel};
use rom::snapshots::RegimeKind;

/// Modes a picture shows, and drawings a row.
const MAX_MODES: usize = 8;
const COLUMNS: usize = 4;

/// Draws the leading modes of a field of a regime.
pub fn draw(args: &Args, model: &Model, named: &str) -> Result<Canvas> {
    let header = &model.header;
    let regime = header.regimes.iter().find(|regime| regime.kind.name() == named);
    let regime = regime.ok_or_else(|| {
        usage(format!("the model has no regime {named}; it has {}", header.regime_names().join(", ")))
    })?;
    let (name, label) = match args.look.field {
        ShownField::Stress => ("von_mises", "von Mises stress"),
        ShownField::Displacement => ("y", "vertical position"),
    };
    let shapes = shapes(model, regime, name)?;
    let bodies = mean_state(model, regime.kind, &shapes)?;
    let energies = energies(regime, model, name);
    let panel = |k: usize, energy: f64| Panel {
        scene: Scene { body: &bodies[k], plate: None, blocks: &[], range: [-1.0, 1.0] },
        title: format!("mode {}", k + 1),
        note: format!("{:.2} %", 100.0 * energy),
    };
    let panels: Vec<(usize, f64)> = energies.into_iter().take(bodies.len()).enumerate().collect();
    let row = |part: &[(usize, f64)]| Row {
        heading: String::new(),
        panels: part.iter().map(|(k, energy)| panel(*k, *energy)).collect(),
    };
    let sheet = Sheet {
        title: format!("POD modes of the {named} regime: {label}"),
        caption: "Drawn on the mean state. Bold: share of the snapshots' variance.".into(),
        rows: panels.chunks(COLUMNS).map(row).collect(),
        bar_label: "mode / its largest entry".into(),
        scale: Scale::new([-1.0, 1.0], 4),
        map: ColourMap::diverging(),
        camera: args.look.view.camera(),
        panel_px: usize::from(args.look.width.unwrap_or(520)),
        text_px: 21.0,
        theme: args.look.theme.colours(),
    };
    sheet.draw()
}

/// The leading modes of a field, each divided by its entry of largest magnitude.
fn shapes(model: &Model, regime: &RegimeModel, name: &str) -> Result<Vec<Vec<f32>>> {
    let header = &model.header;
    let field = header.fields.iter().position(|field| field.spec.name == name);
    let field = field.with_context(|| format!("the model has no field {name:?}"))? as u32;
    let modes = model.modes(regime.kind, field);
    let modes = modes.with_context(|| format!("the field {name:?} is derived and has no modes"))?;
    let shape = |mode| {
        let values: Vec<f32> = (0..modes.nodes()).map(|node| modes.value(mode, node) as f32).collect();
        let largest = values.iter().copied().fold(0.0_f32, |a, b| if b.abs() > a.abs() { b } else { a });
        values.iter().map(|value| if largest == 0.0 { 0.0 } else { value / largest }).collect()
    };
    Ok((0..regime.group_of(field as usize).map_or(0, |group| group.coefficients.len()).min(MAX_MODES))
        .map(shape)
        .collect())
}

/// The mean state of a regime, once a shape, with the shape as values.
fn mean_state(model: &Model, regime: RegimeKind, shapes: &[Vec<f32>]) -> Result<Vec<DrawnBody>> {
    let fields = &model.header.fields;
    let mean = |name: &str| {
        let field = fields.iter().position(|field| field.spec.name == name)? as u32;
        model.mean(regime, field)
    };
    let (Some(x), Some(y), Some(z)) = (mean("x"), mean("y"), mean("z")) else {
        return Err(usage("modes are drawn on the mean state, and this model has no means of x, y and z"));
    };
    let undeformed = model.undeformed_nodes_mm().context("the model does not know the undeformed mesh")?;
    let facets = visible_facets(&undeformed, model.facets());
    let nodes_mm: Vec<[f32; 3]> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
    let body = |shape: &Vec<f32>| DrawnBody {
        nodes_mm: nodes_mm.clone(),
        facets: facets.clone(),
        values: shape.clone(),
    };
    Ok(shapes.iter().map(body).collect())
}

/// Shares of the variance: `sigma_k^2 / sum sigma^2` of the group that holds the field.
fn energies(regime: &RegimeModel, model: &Model, name: &str) -> Vec<f64> {
    let field = model.header.fields.iter().position(|field| field.spec.name == name);
    let group = regime.groups.iter().find(|group| field.is_some_and(|field| group.fields.contains(&field)));
    let sigma = group.map_or(&[][..], |group| &group.singular_values);
    let all: f64 = sigma.iter().map(|s| s * s).sum();
    sigma.iter().map(|s| s * s / all).collect()
}
