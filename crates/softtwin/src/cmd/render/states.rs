//! States of a model or of a database as pictures.

use super::{Args, Shown};
use crate::failure::usage;
use crate::files::{self, refusal};
use crate::load::LoadedModel;
use crate::render::canvas::Canvas;
use crate::render::colour::MapName;
use crate::render::scale::Scale;
use crate::render::scene::{Block, Plate, Scene};
use crate::render::sheet::{Panel, Row, Sheet};
use crate::render::skin::Body;
use crate::render::visible::visible_facets;
use anyhow::{Context, Result};
use rom::evaluation::{Evaluation, Input};
use rom::predict::{Predictor, Selection};
use rom::regime::RegimeSwitch;
use rom::snapshots::{Database, Footprint, RegimeKind};

/// The paper's three scenes and five pressures.
const FIG9_GAPS_MM: [f64; 3] = [80.0, 40.0, 15.0];
const FIG9_PRESSURES_MPA: [f64; 5] = [0.01, 0.025, 0.04, 0.055, 0.07];

/// A state ready to draw.
pub(super) struct Shot {
    pub(super) body: Body,
    pub(super) plate: Option<Plate>,
    pub(super) blocks: Vec<Block>,
    pub(super) force_n: f64,
    pub(super) outside: bool,
}

/// A model that answers with shots.
pub(super) struct Studio {
    predictor: Predictor,
    switch: RegimeSwitch,
    evaluation: Evaluation,
    values: Vec<f32>,
    facets: Vec<[u32; 3]>,
    /// Positions of x, y, z and the shown field.
    columns: [usize; 4],
}

impl Studio {
    pub(super) fn new(loaded: &LoadedModel, shown: Shown) -> Result<Self> {
        let fields = &loaded.model.header.fields;
        let at = |name: &str| fields.iter().position(|field| field.spec.name == name);
        let (Some(x), Some(y), Some(z), Some(shown)) = (at("x"), at("y"), at("z"), at(shown.name())) else {
            let known: Vec<&str> = fields.iter().map(|field| field.spec.name.as_str()).collect();
            let wanted = shown.name();
            return Err(usage(format!(
                "a picture needs the fields x, y, z, {wanted}; the model has {}",
                known.join(", ")
            )));
        };
        let undeformed = loaded.undeformed_mm();
        let facets = undeformed.map_or_else(Vec::new, |nodes| visible_facets(&nodes, &loaded.facets()));
        if facets.is_empty() {
            return Err(usage(
                "the model knows no surface; train it on a database with a mesh (mesh.vtu) to draw it",
            ));
        }
        let predictor = Predictor::new(&loaded.model, &Selection::default())?;
        Ok(Self {
            evaluation: predictor.evaluation(),
            values: vec![0.0; predictor.entries()],
            switch: RegimeSwitch::default(),
            columns: [x, y, z, shown],
            facets,
            predictor,
        })
    }

    pub(super) fn shoot(&mut self, pressure_mpa: f64, gap_mm: Option<f64>) -> Result<Shot> {
        let input = Input { pressure_mpa, gap_mm: gap_mm.unwrap_or(f64::INFINITY) };
        self.predictor.evaluate(input, &mut self.switch, &mut self.evaluation);
        self.predictor.reconstruct_into(&self.evaluation, &mut self.values)?;
        let rows = self.predictor.rows();
        let column = |k: usize| &self.values[self.columns[k] * rows..(self.columns[k] + 1) * rows];
        let (x, y, z) = (column(0), column(1), column(2));
        Ok(Shot {
            body: Body {
                nodes_mm: x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect(),
                facets: self.facets.clone(),
                values: column(3).to_vec(),
            },
            plate: gap_mm.map(plate),
            blocks: Vec::new(),
            force_n: self.evaluation.contact_force_n,
            outside: self.evaluation.flags.extrapolated,
        })
    }
}

fn plate(gap_mm: f64) -> Plate {
    let Footprint { x_mm, z_mm } = Footprint::PLATE;
    let narrow = |range: [f64; 2]| range.map(|v| v as f32);
    Plate { gap_mm: gap_mm as f32, x_mm: narrow(x_mm), z_mm: narrow(z_mm) }
}

/// One state of a model.
pub fn one(args: &Args, loaded: LoadedModel) -> Result<Canvas> {
    let pressure = args.pressure()?;
    let shot = Studio::new(&loaded, args.field)?.shoot(pressure, args.gap_mm)?;
    let place = args.gap_mm.map_or("no plate".into(), |gap| format!("gap {gap} mm"));
    let caption = format!("Predicted by the reduced-order model {}.", loaded.name());
    draw(args, &[vec![shot]], |_, _| format!("P = {pressure} MPa, {place}"), |_| String::new(), "", &caption)
}

/// The paper's Fig. 9.
pub fn fig9(args: &Args, loaded: LoadedModel) -> Result<Canvas> {
    let mut studio = Studio::new(&loaded, args.field)?;
    let mut row =
        |gap: f64| FIG9_PRESSURES_MPA.iter().map(|pressure| studio.shoot(*pressure, Some(gap))).collect();
    let rows = FIG9_GAPS_MM.iter().map(|gap| row(*gap)).collect::<Result<Vec<Vec<Shot>>>>()?;
    let title = |_: usize, k: usize| format!("P = {} MPa", FIG9_PRESSURES_MPA[k]);
    let heading = |r: usize| format!("gap ΔH = {} mm", FIG9_GAPS_MM[r]);
    let caption =
        "Predicted by the reduced-order model. Bold: contact force on the plate (lines every 10 mm).";
    draw(args, &rows, title, heading, "Three gaps, five pressures", caption)
}

/// One case of a database.
pub fn case(args: &Args) -> Result<Canvas> {
    let (Some(dir), Some(wanted)) = (&args.database, &args.case) else {
        return Err(usage("give --model FILE, or --database DIR with --case NAME"));
    };
    let mut found = None;
    for scene in formats::database::scenes(dir).map_err(refusal)? {
        let database = files::database(dir, scene)?;
        if let Some(index) = database.cases.iter().position(|case| case.name == *wanted) {
            found = Some((database, index));
            break;
        }
    }
    let (database, index) = found.with_context(|| format!("no case {wanted:?} in {}", dir.display()))?;
    let shot = shot_of(&database, index, args.field)?;
    let case = &database.cases[index];
    let place = case.gap_mm.map_or("no plate".into(), |gap| format!("gap {gap} mm"));
    let title = |_: usize, _: usize| format!("P = {} MPa, {place}", case.pressure_mpa);
    let caption = format!("Finite elements: case {wanted} of {}.", database.actuator);
    draw(args, &[vec![shot]], title, |_| String::new(), "", &caption)
}

fn shot_of(database: &Database, index: usize, shown: Shown) -> Result<Shot> {
    let axis = |k: u8| database.coordinate(k).with_context(|| format!("the database has no coordinate {k}"));
    let [x, y, z] = [axis(0)?, axis(1)?, axis(2)?].map(|field| database.field(index, field));
    let shown =
        database.fields.iter().position(|field| field.name == shown.name()).context("no such field")?;
    let undeformed =
        database.undeformed_mm.as_ref().context("the database has no mesh.vtu, so no surface to draw")?;
    let undeformed: Vec<[f32; 3]> = undeformed.iter().map(|p| p.map(|v| v as f32)).collect();
    let case = &database.cases[index];
    let drawn = |gap: f64| {
        let Footprint { x_mm, z_mm } = database.obstacle;
        Plate { x_mm: x_mm.map(|v| v as f32), z_mm: z_mm.map(|v| v as f32), ..plate(gap) }
    };
    Ok(Shot {
        body: Body {
            nodes_mm: x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect(),
            facets: visible_facets(&undeformed, &database.surface_triangles),
            values: database.field(index, shown).collect(),
        },
        plate: case.gap_mm.map(drawn),
        blocks: Vec::new(),
        force_n: if case.regime == RegimeKind::Contact { case.contact_force_n } else { 0.0 },
        outside: false,
    })
}

/// The scale of all shots and the largest value. Stress peaks at single nodes of sharp corners; the scale ends where
/// 99.5 % of the visible nodes lie, so that the rest of the body is not all one colour, and the label says how far it goes.
fn colour_scale(args: &Args, rows: &[Vec<Shot>]) -> (Scale, f32) {
    let visible = |shot: &Shot| {
        let mut seen = shot.body.facets.as_flattened().to_vec();
        seen.sort_unstable();
        seen.dedup();
        seen.into_iter().map(|node| shot.body.values[node as usize]).collect::<Vec<f32>>()
    };
    let mut values: Vec<f32> =
        rows.iter().flatten().flat_map(visible).filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f32::total_cmp);
    let largest = values.last().copied().unwrap_or(0.0);
    let most = values.get(values.len() * 995 / 1000).copied().unwrap_or(0.0);
    let scale = args.range.map_or_else(|| Scale::rounded([0.0, most], 5), |range| Scale::new(range, 5));
    (scale, largest)
}

/// Lays shots out with one colour scale for all.
pub(super) fn draw(
    args: &Args,
    rows: &[Vec<Shot>],
    title: impl Fn(usize, usize) -> String,
    heading: impl Fn(usize) -> String,
    headline: &str,
    caption: &str,
) -> Result<Canvas> {
    let (scale, largest) = colour_scale(args, rows);
    let panel = |shot: &'_ Shot, r: usize, k: usize| -> (String, String) {
        let force = if shot.force_n > 0.0 { format!("{:.3} N", shot.force_n) } else { String::new() };
        let outside = if shot.outside { " (extrapolated)" } else { "" };
        (format!("{}{outside}", title(r, k)), force)
    };
    let single = rows.len() == 1;
    let panels = |(r, row): (usize, &'_ Vec<Shot>)| -> Vec<(String, String)> {
        row.iter().enumerate().map(|(k, shot)| panel(shot, r, k)).collect()
    };
    let texts: Vec<Vec<(String, String)>> = rows.iter().enumerate().map(panels).collect();
    let sheet = Sheet {
        title: if headline.is_empty() { texts[0][0].0.clone() } else { headline.to_owned() },
        caption: caption.to_owned(),
        rows: rows
            .iter()
            .zip(texts)
            .enumerate()
            .map(|(r, (row, texts))| Row {
                heading: heading(r),
                panels: row
                    .iter()
                    .zip(texts)
                    .map(|(shot, (title, note))| Panel {
                        scene: Scene {
                            body: &shot.body,
                            plate: shot.plate,
                            blocks: &shot.blocks,
                            range: scale.range,
                        },
                        title: if single { String::new() } else { title },
                        note,
                    })
                    .collect(),
            })
            .collect(),
        bar_label: format!("{}, largest {largest:.2}", args.field.label()),
        map: args.map(MapName::Stress),
        camera: args.view.camera(),
        panel_px: usize::from(args.width.unwrap_or(if single { 1100 } else { 420 })),
        text_px: if single { 22.0 } else { 21.0 },
        theme: args.theme.colours(),
        scale,
    };
    sheet.draw()
}
