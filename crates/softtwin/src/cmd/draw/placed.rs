//! A whole scene as a picture: its actuators in their places, its blocks between them.

use super::args::Args;
use super::states::StateDrawer;
use crate::failure::{configuration, usage};
use crate::files;
use crate::picture::canvas::Canvas;
use crate::picture::scene::Block;
use crate::picture::skin::DrawnBody;
use crate::picture::states::{DrawnState, Group, draw};
use anyhow::Result;
use runtime::config::{BlockSpec, PlaceSpec, Scene};
use std::path::Path;

/// All actuators of a scene at one pressure.
pub fn scene(args: &Args, path: &Path) -> Result<Canvas> {
    let pressure = args.pressure_mpa()?;
    let scene = Scene::load(path).map_err(configuration)?;
    let narrow = |point: [f64; 3]| point.map(|v| v as f32);
    let block = |block: &BlockSpec| Block { min_mm: narrow(block.min_mm), max_mm: narrow(block.max_mm) };
    let mut whole = DrawnState {
        body: DrawnBody::default(),
        plate: None,
        blocks: scene.blocks.iter().map(block).collect(),
        force_n: 0.0,
        outside: false,
        title: format!("{} at P = {pressure} MPa", scene.name),
    };
    for actuator in &scene.actuators {
        let (min_mm, max_mm) = actuator.gap_mm.range_mm();
        let gap_mm = args.gap_mm.or((min_mm == max_mm).then_some(min_mm)).ok_or_else(|| {
            usage(format!("--gap: the scene leaves the gap of `{}` open, so give one", actuator.name))
        })?;
        let model = files::model(&actuator.model)?;
        let state = StateDrawer::new(&model, args.look.field)?.draw_state(pressure, Some(gap_mm))?;
        whole.force_n = whole.force_n.max(state.force_n);
        whole.outside |= state.outside;
        add(&mut whole.body, &state.body, &actuator.place);
    }
    let caption = "Predicted by the reduced-order model. Bold: contact force of one finger.";
    draw(&args.look, &[Group::alone(whole)], None, caption.into())
}

/// Adds a body at its place; a mirrored one is turned inside out by the mirror, so its facets turn round.
fn add(whole: &mut DrawnBody, body: &DrawnBody, place: &PlaceSpec) {
    let first = whole.nodes_mm.len() as u32;
    let placed = |point: &[f32; 3]| place.apply(point.map(f64::from)).map(|v| v as f32);
    whole.nodes_mm.extend(body.nodes_mm.iter().map(placed));
    whole.values.extend_from_slice(&body.values);
    let turned = |[a, b, c]: [u32; 3]| if place.mirrored { [a, c, b] } else { [a, b, c] };
    whole.facets.extend(body.facets.iter().map(|facet| turned(*facet).map(|node| first + node)));
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_draw_placed.rs"]
mod tests;
