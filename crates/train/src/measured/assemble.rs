//! A fitted curve as a model: markers are nodes, every output a coefficient with a unit mode.

use super::curve::{Curve, quantile};
use super::data::{COVERAGE, Measured, OutputReport};
use super::layout::Layout;
use rom::halfwidths::HalfWidths;
use rom::hull::TrainingRange;
use rom::inputs::Point;
use rom::interpolant::Interpolant;
use rom::kernel::{Modes, Precision};
use rom::model::{BlockData, BlockKind, GroupModel, Model, ModelHeader, OutputField, RegimeModel};
use rom::snapshots::{Database, FieldKind, FieldSpec, NodeSet, RegimeKind};

impl Curve {
    pub(super) fn model(
        &self,
        actuator: &str,
        data: &Measured,
        surrogate: Interpolant,
        errors: &[Vec<f64>],
        reports: &[OutputReport],
    ) -> Model {
        let names: Vec<&str> = reports.iter().map(|report| report.name.as_str()).collect();
        let layout = Layout::of(&names);
        let (groups, mut blocks) = groups(&layout, &surrogate, reports);
        blocks.extend(undeformed(&layout, &surrogate));
        let dimensions = self.map.dimensions();
        let regime = RegimeModel {
            kind: RegimeKind::Free,
            inputs: self.map.clone(),
            groups,
            force: None,
            domain: TrainingRange::of_points(self.map.operating(), dimensions, &self.range_points()),
            halfwidths: HalfWidths {
                coverage: COVERAGE,
                displacement_mm: self.marker_half_width(&layout, errors),
                stress_mpa: f64::NAN,
                force_n: f64::NAN,
            },
            local_halfwidths: None,
            far_onset: None,
            difference: None,
        };
        let output = |spec: &FieldSpec| OutputField { spec: spec.clone(), magnitude_of: None };
        let set = |(node, name): (usize, &String)| NodeSet { name: name.clone(), nodes: vec![node as u32] };
        let header = ModelHeader {
            actuator: actuator.into(),
            inputs: self.specs.clone(),
            fields: layout.fields.iter().map(|(spec, _)| output(spec)).collect(),
            node_count: layout.node_count(),
            regimes: vec![regime],
            onset: None,
            hysteresis_mpa: 0.0,
            node_sets: layout.nodes.iter().enumerate().map(set).collect(),
            database_hash: hash(data),
            clearance: None,
        };
        Model { header, blocks }
    }

    /// Half-width of the distance of the worst marker; NaN without markers.
    fn marker_half_width(&self, layout: &Layout, errors: &[Vec<f64>]) -> f64 {
        let coordinates = || layout.fields.iter().filter(|(s, _)| matches!(s.kind, FieldKind::Coordinate(_)));
        let distance = |e: &Vec<f64>, node: usize| {
            let outputs = coordinates().filter_map(|(_, places)| places[node]);
            outputs.map(|output| e[output] * e[output]).sum::<f64>().sqrt()
        };
        let sizes: Vec<Vec<f64>> =
            (0..layout.nodes.len()).map(|node| errors.iter().map(|e| distance(e, node)).collect()).collect();
        let worst = (0..errors.len()).map(|row| sizes.iter().map(|of| of[row]).fold(0.0, f64::max)).collect();
        if sizes.is_empty() {
            return f64::NAN;
        }
        // The bound of a further run's mean error, along the axis where it is largest.
        let shift = coordinates().flat_map(|(_, places)| places.iter().flatten()).map(|output| {
            let own: Vec<f64> = errors.iter().map(|e| e[*output]).collect();
            self.half_width(vec![0.0], &own)
        });
        quantile(worst) + shift.fold(0.0, f64::max)
    }

    /// Centres and the rows at the ends of the inputs: neighbours are a cell apart, while rows follow a path.
    fn range_points(&self) -> Vec<Point> {
        let ends = (0..self.map.dimensions()).flat_map(|axis| {
            let by = |a: &&Point, b: &&Point| a[axis].total_cmp(&b[axis]);
            self.x.iter().min_by(by).into_iter().chain(self.x.iter().max_by(by))
        });
        self.centres.iter().chain(ends).copied().collect()
    }
}

type Blocks = Vec<(BlockKind, BlockData)>;

/// Groups with unit modes: the coefficients are the outputs. A scalar is the same at all nodes.
fn groups(layout: &Layout, surrogate: &Interpolant, reports: &[OutputReport]) -> (Vec<GroupModel>, Blocks) {
    let (nodes, regime) = (layout.node_count(), RegimeKind::Free);
    let (mut groups, mut blocks, mut start) = (Vec::new(), Vec::new(), 0);
    for (field, (spec, places)) in layout.fields.iter().enumerate() {
        let is_scalar = !matches!(spec.kind, FieldKind::Coordinate(_));
        let count = if is_scalar { 1 } else { nodes };
        let pick = |weights: &[f64]| -> Vec<f64> {
            let row = |row: &[f64]| -> Vec<f64> {
                places[..count].iter().map(|place| place.map_or(0.0, |output| row[output])).collect()
            };
            weights.chunks_exact(surrogate.outputs).flat_map(row).collect()
        };
        let own = Interpolant {
            weights: pick(&surrogate.weights),
            tail_weights: pick(&surrogate.tail_weights),
            outputs: count,
            ..surrogate.clone()
        };
        groups.push(GroupModel {
            name: spec.name.clone(),
            fields: vec![field],
            coefficients: start..start + count,
            surrogate: own,
            singular_values: vec![1.0; count],
            // All modes count: without one an output is missing.
            leave_one_out: (0..=count).map(|k| if k < count { f64::MAX } else { 0.0 }).collect(),
        });
        start += count;
        let shape = |mode: usize, node: usize| if is_scalar || mode == node { 1.0 } else { 0.0 };
        let width = |place: &Option<usize>| place.map_or(0.0, |output| reports[output].half_width as f32);
        // Unit modes fit every number format.
        let Ok(modes) = Modes::new(Precision::F32, nodes, count, shape) else { continue };
        let field = field as u32;
        blocks.push((BlockKind::Mean { regime, field }, BlockData::F32(vec![0.0; nodes])));
        blocks.push((BlockKind::Modes { regime, field }, BlockData::Modes(modes)));
        blocks.push((BlockKind::HalfWidth { field }, BlockData::F32(places.iter().map(width).collect())));
    }
    (groups, blocks)
}

/// Positions of the markers at the smallest inputs; 0 where there are none.
fn undeformed(layout: &Layout, surrogate: &Interpolant) -> Blocks {
    let rest = surrogate.values_at(&Point::default());
    let along = |axis: u8| {
        let found = layout.fields.iter().find(|(spec, _)| spec.kind == FieldKind::Coordinate(axis));
        let at = |node: usize| found.and_then(|(_, places)| places[node]).map_or(0.0, |output| rest[output]);
        let values = (0..layout.node_count()).map(|node| at(node) as f32).collect();
        (BlockKind::Undeformed(axis), BlockData::F32(values))
    };
    (0..3).map(along).collect()
}

/// blake3 of the measured values.
fn hash(data: &Measured) -> [u8; 32] {
    let field = |name: &String| FieldSpec { name: name.clone(), unit: String::new(), kind: FieldKind::Other };
    let times: Vec<f64> = data.runs.iter().flat_map(|run| run.time_s.iter().copied()).collect();
    let values = data.runs.iter().flat_map(|run| {
        let columns = || run.inputs.iter().chain(&run.outputs);
        (0..run.time_s.len()).flat_map(move |row| columns().map(move |column| column[row] as f32))
    });
    let fields = data.inputs.iter().chain(&data.outputs).map(field).collect();
    Database::free("measured", fields, &times, values.collect()).hash
}
