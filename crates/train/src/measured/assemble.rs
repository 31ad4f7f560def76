//! A fitted curve as a model: markers are nodes, the modes of the outputs one group over all fields.

use super::curve::{Curve, OutputModes};
use super::data::{COVERAGE, Measured, MeasuredError, OutputReport};
use super::layout::Layout;
use rom::halfwidths::HalfWidths;
use rom::hull::TrainingRange;
use rom::inputs::Point;
use rom::kernel::{Modes, Precision};
use rom::model::{BlockData, BlockKind, GroupModel, Model, ModelHeader, OutputField, RegimeModel};
use rom::snapshots::{Database, FieldKind, FieldSpec, NodeSet, RegimeKind};

impl Curve {
    pub(super) fn model(
        &self,
        actuator: &str,
        data: &Measured,
        modes: OutputModes,
        errors: &[Vec<f64>],
        reports: &[OutputReport],
    ) -> Result<Model, MeasuredError> {
        let names: Vec<&str> = reports.iter().map(|report| report.name.as_str()).collect();
        let layout = Layout::of(&names);
        let mut blocks = self.fields(&layout, &modes, reports)?;
        blocks.extend(self.undeformed(&layout, &modes));
        let count = modes.shapes.len();
        let group = GroupModel {
            name: "outputs".into(),
            fields: (0..layout.fields.len()).collect(),
            coefficients: 0..count,
            surrogate: modes.surrogate,
            singular_values: modes.singular_values,
            // The modes were chosen by their errors: all of them count.
            leave_one_out: (0..=count).map(|k| if k < count { f64::MAX } else { 0.0 }).collect(),
        };
        let dimensions = self.map.dimensions();
        let regime = RegimeModel {
            kind: RegimeKind::Free,
            inputs: self.map.clone(),
            groups: vec![group],
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
            limit: None,
            body: None,
        };
        Ok(Model { header, blocks })
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
        let worst: Vec<f64> =
            (0..errors.len()).map(|row| sizes.iter().map(|of| of[row]).fold(0.0, f64::max)).collect();
        if sizes.is_empty() {
            return f64::NAN;
        }
        let outputs = coordinates().flat_map(|(_, places)| places.iter().flatten());
        self.half_width_of_worst(worst, outputs.map(|output| errors.iter().map(|e| e[*output]).collect()))
    }

    /// Mean, modes and half-widths of each field. A scalar is the same at all nodes.
    fn fields(
        &self,
        layout: &Layout,
        modes: &OutputModes,
        reports: &[OutputReport],
    ) -> Result<Blocks, MeasuredError> {
        let (nodes, regime) = (layout.node_count(), RegimeKind::Free);
        let mut blocks = Vec::new();
        for (field, (_, places)) in layout.fields.iter().enumerate() {
            let by_node = |of: &dyn Fn(usize) -> f64| -> BlockData {
                BlockData::F32(places.iter().map(|place| place.map_or(0.0, of) as f32).collect())
            };
            let shape =
                |mode: usize, node: usize| places[node].map_or(0.0, |output| modes.shapes[mode][output]);
            let shapes = Modes::new(Precision::F32, nodes, modes.shapes.len(), shape)
                .map_err(|_| MeasuredError::Singular)?;
            let field = field as u32;
            blocks.push((BlockKind::Mean { regime, field }, by_node(&|output| self.means[output])));
            blocks.push((BlockKind::Modes { regime, field }, BlockData::Modes(shapes)));
            blocks.push((BlockKind::HalfWidth { field }, by_node(&|output| reports[output].half_width)));
        }
        Ok(blocks)
    }

    /// Positions of the markers at the smallest inputs; 0 where there are none.
    fn undeformed(&self, layout: &Layout, modes: &OutputModes) -> Blocks {
        let rest = modes.values(&Point::default());
        let along = |axis: u8| {
            let found = layout.fields.iter().find(|(spec, _)| spec.kind == FieldKind::Coordinate(axis));
            let place = |node: usize| found.and_then(|(_, places)| places[node]);
            let at = |node: usize| place(node).map_or(0.0, |output| self.means[output] + rest[output]);
            let values = (0..layout.node_count()).map(|node| at(node) as f32).collect();
            (BlockKind::Undeformed(axis), BlockData::F32(values))
        };
        (0..3).map(along).collect()
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
