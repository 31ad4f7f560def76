//! States of a model or of a database as pictures.

use super::args::Args;
use crate::failure::usage;
use crate::files::{self, refusal};
use crate::picture::canvas::Canvas;
use crate::picture::scene::Plate;
use crate::picture::skin::DrawnBody;
use crate::picture::states::{DrawnState, Group, ShownField, draw};
use crate::picture::visible::visible_facets;
use anyhow::{Context, Result};
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use rom::snapshots::{Database, Footprint, RegimeKind};

/// The paper's three scenes and five pressures.
const FIG9_GAPS_MM: [f64; 3] = [80.0, 40.0, 15.0];
const FIG9_PRESSURES_MPA: [f64; 5] = [0.01, 0.025, 0.04, 0.055, 0.07];
/// A model of which states are drawn.
pub(super) struct StateDrawer {
    state: ModelState,
    footprint: Footprint,
    /// Surface; empty for markers.
    facets: Vec<[u32; 3]>,
    undeformed_mm: Vec<[f32; 3]>,
    /// Positions of x, y, z and the shown field.
    columns: [usize; 4],
}

impl StateDrawer {
    pub(super) fn new(model: &Model, shown: ShownField) -> Result<Self> {
        let fields = &model.header.fields;
        let field = |name: &str| fields.iter().position(|field| field.spec.name == name);
        let is_measured = model.is_measured();
        // A measured model has no displacement: that of its markers is the distance from the smallest inputs.
        let shown_at = if is_measured { Some(usize::MAX) } else { field(shown.name()) };
        let (Some(x), Some(y), Some(z), Some(shown_at)) = (field("x"), field("y"), field("z"), shown_at)
        else {
            let known: Vec<&str> = fields.iter().map(|field| field.spec.name.as_str()).collect();
            let wanted = if is_measured { "of a marker" } else { shown.name() };
            return Err(usage(format!(
                "a picture needs the fields x, y, z, {wanted}; the model has {}; `--chart observables` draws curves",
                known.join(", ")
            )));
        };
        if is_measured && shown == ShownField::Stress {
            return Err(usage("a measured model has no stress: --field displacement shows its markers"));
        }
        let undeformed_mm = model.undeformed_nodes_mm().unwrap_or_default();
        let facets = if is_measured { Vec::new() } else { visible_facets(&undeformed_mm, model.facets()) };
        if facets.is_empty() && !is_measured {
            return Err(usage(
                "the model knows no surface; train it on a database with a mesh (mesh.vtu) to draw it",
            ));
        }
        let state = ModelState::new(model, &Selection::default())?;
        Ok(Self { columns: [x, y, z, shown_at], facets, undeformed_mm, footprint: model.plate(), state })
    }

    pub(super) fn draw_state(&mut self, pressure_mpa: f64, gap_mm: Option<f64>) -> Result<DrawnState> {
        let peaks = self.state.update(Inputs::new(pressure_mpa, gap_mm.unwrap_or(f64::INFINITY)));
        files::answered(&self.state, peaks, true)?;
        let (rows, evaluation) = (self.state.reconstructor().rows(), self.state.evaluation());
        let column = |k: usize| &self.state.fields()[self.columns[k] * rows..(self.columns[k] + 1) * rows];
        let (x, y, z) = (column(0), column(1), column(2));
        let nodes_mm: Vec<[f32; 3]> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
        let body = if self.facets.is_empty() {
            DrawnBody::of_markers(&nodes_mm, &self.undeformed_mm)
        } else {
            DrawnBody { nodes_mm, facets: self.facets.clone(), values: column(3).to_vec() }
        };
        Ok(DrawnState {
            body,
            plate: gap_mm.map(|gap_mm| plate(gap_mm, &self.footprint)),
            blocks: Vec::new(),
            force_n: evaluation.contact_force_n,
            outside: evaluation.flags.extrapolated,
            title: String::new(),
        })
    }
}

fn plate(gap_mm: f64, extent: &Footprint) -> Plate {
    let narrow = |range: [f64; 2]| range.map(|v| v as f32);
    Plate { gap_mm: gap_mm as f32, x_mm: narrow(extent.x_mm), z_mm: narrow(extent.z_mm) }
}

/// One state of a model.
pub fn one(args: &Args, model: &Model) -> Result<Canvas> {
    let needs = model.header.needs();
    let pressure = if needs.pressure { args.pressure_mpa()? } else { f64::NAN };
    let mut state = StateDrawer::new(model, args.look.field)?.draw_state(pressure, args.gap_mm)?;
    let given = args.settings.iter().map(|(name, value)| format!("{name} = {value}"));
    let own = needs.pressure.then(|| state_title(pressure, args.gap_mm));
    state.title = own.into_iter().chain(given).collect::<Vec<_>>().join(", ");
    let name = args.source.file_stem().unwrap_or_default().to_string_lossy();
    let caption = match model.is_measured() {
        true => format!("Markers predicted by the measured model {name}."),
        false => format!("Predicted by the reduced-order model {name}."),
    };
    draw(&args.look, &[Group::alone(state)], None, caption)
}

/// The paper's Fig. 9.
pub fn fig9(args: &Args, model: &Model) -> Result<Canvas> {
    let mut studio = StateDrawer::new(model, args.look.field)?;
    let mut state = |gap_mm: f64, pressure_mpa: f64| -> Result<DrawnState> {
        let title = format!("P = {pressure_mpa} MPa");
        Ok(DrawnState { title, ..studio.draw_state(pressure_mpa, Some(gap_mm))? })
    };
    let (gaps_mm, pressures_mpa) = (fig9_gaps_mm(trained(model, GAP)), fig9_pressures_mpa(model));
    let mut groups = Vec::new();
    for gap_mm in gaps_mm {
        let states = pressures_mpa.iter().map(|pressure| state(gap_mm, *pressure)).collect::<Result<_>>()?;
        groups.push(Group { heading: format!("gap ΔH = {gap_mm} mm"), states });
    }
    let caption =
        "Predicted by the reduced-order model. Bold: contact force on the plate (lines every 10 mm).";
    let headline = if groups.len() == 3 { "Three gaps, five pressures" } else { "One gap, five pressures" };
    draw(&args.look, &groups, Some(headline), caption.into())
}

/// Trained range of an input; none if the model does not take it.
fn trained(model: &Model, input: usize) -> Option<[f64; 2]> {
    Some(model.header.inputs[input].range).filter(|range| range[0].is_finite())
}

/// The paper's pressures where the model was trained up to them, else the same fractions of its largest one.
fn fig9_pressures_mpa(model: &Model) -> Vec<f64> {
    let [low, high] = trained(model, PRESSURE).unwrap_or([0.0, 0.1]);
    let [.., most] = FIG9_PRESSURES_MPA;
    if low <= FIG9_PRESSURES_MPA[0] && most <= high {
        return FIG9_PRESSURES_MPA.to_vec();
    }
    FIG9_PRESSURES_MPA.iter().map(|pressure| rounded_down(low + pressure / most * (high - low))).collect()
}

/// The paper's gaps if the model was trained around them (the largest one is without contact), else three from its range,
/// or its only one. A model without a gap is drawn over the paper's largest.
fn fig9_gaps_mm(range: Option<[f64; 2]>) -> Vec<f64> {
    match range {
        None => FIG9_GAPS_MM[..1].to_vec(),
        Some([low, high]) if low == high => vec![low],
        Some([low, high]) if low <= FIG9_GAPS_MM[2] && FIG9_GAPS_MM[1] <= high => FIG9_GAPS_MM.to_vec(),
        Some([low, high]) => [high, 0.5 * (low + high), low].map(|gap| (10.0 * gap).round() / 10.0).to_vec(),
    }
}

/// To two digits, never above the value.
fn rounded_down(value: f64) -> f64 {
    let decimals = (1.0 - value.abs().max(1e-12).log10().floor()) as i32;
    (value * 10_f64.powi(decimals) + 1e-9).floor() / 10_f64.powi(decimals)
}

/// One case of a database.
pub fn case(args: &Args, wanted: &str) -> Result<Canvas> {
    let dir = args.source.as_path();
    for scene in formats::database::obstacle_kinds(dir).map_err(refusal)? {
        let database = files::database(dir, scene)?;
        if let Some(index) = database.cases.iter().position(|case| case.name == wanted) {
            let state = drawn_case(&database, index, args.look.field)?;
            let caption = format!("Finite elements: case {wanted} of {}.", database.actuator);
            return draw(&args.look, &[Group::alone(state)], None, caption);
        }
    }
    anyhow::bail!("no case {wanted:?} in {}", dir.display())
}

fn state_title(pressure_mpa: f64, gap_mm: Option<f64>) -> String {
    let place = gap_mm.map_or("no plate".into(), |gap| format!("gap {gap} mm"));
    format!("P = {pressure_mpa} MPa, {place}")
}

fn drawn_case(database: &Database, index: usize, shown: ShownField) -> Result<DrawnState> {
    let axis = |k: u8| database.coordinate(k).with_context(|| format!("the database has no coordinate {k}"));
    let [x, y, z] = [axis(0)?, axis(1)?, axis(2)?].map(|field| database.field(index, field));
    let shown =
        database.fields.iter().position(|field| field.name == shown.name()).context("no such field")?;
    let undeformed =
        database.undeformed_mm.as_ref().context("the database has no mesh.vtu, so no surface to draw")?;
    let undeformed: Vec<[f32; 3]> = undeformed.iter().map(|p| p.map(|v| v as f32)).collect();
    let case = &database.cases[index];
    Ok(DrawnState {
        body: DrawnBody {
            nodes_mm: x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect(),
            facets: visible_facets(&undeformed, &database.surface_triangles),
            values: database.field(index, shown).collect(),
        },
        plate: case.gap_mm.map(|gap_mm| plate(gap_mm, &database.obstacle)),
        blocks: Vec::new(),
        force_n: if case.regime == RegimeKind::Contact { case.contact_force_n } else { 0.0 },
        outside: false,
        title: state_title(case.pressure_mpa, case.gap_mm),
    })
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_draw_states.rs"]
mod tests;
