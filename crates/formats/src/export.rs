//! States as files of other programs: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, CSV, NPY.
//!
//! States are written one after the other: one state is in memory at a time.

use crate::error::{Diagnostic, FormatError};
use crate::table::TableWriter;
use crate::vtu::Cells;
use crate::{file, npy, table, vtu};
use quick_xml::escape::escape;
use rom::model::Model;
use rom::model_state::ModelState;
use rom::observable::Observables;
use rom::snapshots::{Database, FieldKind, FieldSpec};
use std::fmt::Display;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::{fmt, io};

// ---- name of a state and its scalar inputs and results ----

/// Name and scalars of a state; all states of a series have the same names of scalars in the same order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Label {
    /// Name of a case; may be empty.
    pub name: String,
    /// Names with unit (`pressure_mpa`) and values; a value that is not finite is absent (`gap_mm` without an obstacle).
    pub numbers: Vec<(String, f64)>,
}

impl Label {
    /// Label of a state of the actuator: pressure, gap (`None` without an obstacle), further inputs, contact force.
    pub fn of_state(
        pressure_mpa: f64,
        gap_mm: Option<f64>,
        parameters: impl IntoIterator<Item = (String, f64)>,
        contact_force_n: f64,
    ) -> Self {
        let named = |name: &str, value| (name.to_owned(), value);
        let mut numbers =
            vec![named("pressure_mpa", pressure_mpa), named("gap_mm", gap_mm.unwrap_or(f64::INFINITY))];
        numbers.extend(parameters);
        numbers.push(named("contact_force_n", contact_force_n));
        Self { name: String::new(), numbers }
    }

    pub(crate) fn present(&self) -> impl Iterator<Item = (&str, f64)> {
        self.numbers
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(name, value)| (name.as_str(), *value))
    }
}

/// One line: `A: pressure_mpa = 0.05, gap_mm = 40`.
impl Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.present().map(|(name, value)| format!("{name} = {value}")).collect();
        let between = if self.name.is_empty() || numbers.is_empty() { "" } else { ": " };
        write!(f, "{}{between}{}", self.name, numbers.join(", "))
    }
}

/// Writes a series in the format given by the ending of the file name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesFormat {
    /// One `.vtu` per state and a `.pvd` that lists them.
    Pvd,
    /// Tecplot ASCII, one zone per state.
    Tecplot,
    /// XDMF 3, a temporal collection with inline numbers.
    Xdmf,
    /// One row per node and state.
    Csv,
    /// NumPy: f32, states x nodes x fields.
    Npy,
}

impl SeriesFormat {
    /// Format by the ending of a file name.
    ///
    /// # Errors
    /// Any other ending.
    pub fn of(path: &Path) -> Result<Self, FormatError> {
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("pvd") => Ok(Self::Pvd),
            Some("dat" | "tec") => Ok(Self::Tecplot),
            Some("xdmf" | "xmf") => Ok(Self::Xdmf),
            Some("csv") => Ok(Self::Csv),
            Some("npy") => Ok(Self::Npy),
            other => {
                let expected = "an ending of .pvd, .dat, .xdmf, .csv or .npy";
                let found = other.unwrap_or("no ending");
                Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
            }
        }
    }

    fn layout<'a>(self, path: &Path, series: StateSeries<'a>) -> Box<dyn Layout + 'a> {
        match self {
            Self::Pvd => Box::new(Pvd::new(path, series)),
            Self::Tecplot => Box::new(Tecplot::new(series)),
            Self::Xdmf => Box::new(Xdmf(series)),
            Self::Csv => Box::new(Csv(series)),
            Self::Npy => Box::new(Npy(series)),
        }
    }
}

impl StateSeries<'_> {
    /// Writes the series in the format of the name's ending; returns the files written, `path` first. Cost and output are linear in
    /// states x nodes x fields.
    ///
    /// # Errors
    /// An unknown ending, an inconsistent series, an error among the states, or an I/O error.
    pub fn write<E: From<FormatError>>(
        &self,
        path: &Path,
        moments: impl Iterator<Item = Result<Moment, E>>,
    ) -> Result<Vec<PathBuf>, E> {
        FormatError::check((), path, self.diagnostics())?;
        let format = SeriesFormat::of(path)?;
        let mut layout = format.layout(path, *self);
        let refused = |error| FormatError::write(path, error);
        let mut out = BufWriter::new(File::create(path).map_err(refused)?);
        layout.begin(&mut out).map_err(refused)?;
        let mut written = 0;
        for moment in moments {
            let moment = moment?;
            self.check_length(&format!("state {written}"), &moment.values)
                .map_err(|diagnostic| FormatError::one(path, diagnostic))?;
            layout.state(&mut out, written, &moment).map_err(refused)?;
            written += 1;
        }
        if written != self.count {
            let diagnostic = Diagnostic::new("series", format!("{} states", self.count), written);
            return Err(FormatError::one(path, diagnostic).into());
        }
        layout.end(&mut out).and_then(|()| out.flush()).map_err(refused)?;
        let states = if format == SeriesFormat::Pvd { written } else { 0 };
        Ok(std::iter::once(path.into()).chain((0..states).map(|k| state_file(path, k))).collect())
    }
}

/// Reconstructed state as a file, by the ending of its name: `.npy` (f32, nodes x fields), `.csv`, `.vtu`, or
/// a series of one state as Tecplot ASCII (`.dat`) or XDMF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateFormat {
    /// NumPy: f32, nodes x fields.
    Npy,
    /// One row per node, one column per field, with a heading.
    Csv,
    /// VTK unstructured grid of the deformed body.
    Vtu,
    /// Tecplot ASCII or XDMF.
    OneOfSeries,
}

impl StateFormat {
    /// Format by the ending of a file name.
    ///
    /// # Errors
    /// Any other ending.
    pub fn of(path: &Path) -> Result<Self, FormatError> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("npy") => Ok(Self::Npy),
            Some("csv") => Ok(Self::Csv),
            Some("vtu") => Ok(Self::Vtu),
            other => match SeriesFormat::of(path) {
                Ok(SeriesFormat::Tecplot | SeriesFormat::Xdmf) => Ok(Self::OneOfSeries),
                _ => {
                    let expected = "an ending of .npy, .csv, .vtu, .dat or .xdmf";
                    let found = other.unwrap_or("no ending");
                    Err(FormatError::one(path, Diagnostic::new("file name", expected, found)))
                }
            },
        }
    }
}

impl StateSeries<'_> {
    /// Writes one state in the format of the name's ending; ignores [`StateSeries::count`] and the state's time.
    ///
    /// # Errors
    /// An unknown ending, a state of inconsistent sizes, or an I/O error.
    pub fn write_state(&self, path: &Path, state: &Moment) -> Result<(), FormatError> {
        let Moment { label, values, .. } = state;
        self.check_length("state", values).map_err(|diagnostic| FormatError::one(path, diagnostic))?;
        match StateFormat::of(path)? {
            StateFormat::Npy => {
                let by_node: Vec<f32> = (0..self.nodes).flat_map(|node| self.at_node(values, node)).collect();
                npy::write_f32(path, &[self.nodes, self.fields.len()], &by_node)
            }
            StateFormat::Csv => file::replace(path, table_of(self, values, label).as_bytes()),
            StateFormat::Vtu => write_vtu(path, self, state),
            StateFormat::OneOfSeries => {
                let one = StateSeries { count: 1, ..*self };
                one.write(path, std::iter::once(Ok::<_, FormatError>(state.clone()))).map(drop)
            }
        }
    }
}

/// Table with one row per node.
fn table_of(series: &StateSeries<'_>, values: &[f32], label: &Label) -> String {
    let first = std::iter::once("node".to_owned());
    let header: Vec<String> = first.chain(series.columns()).chain(heading(label)).collect();
    let last = cells(label);
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let row = |node: usize| {
        let values = series.at_node(values, node).map(|value| value.to_string());
        std::iter::once(node.to_string()).chain(values).chain(last.iter().cloned())
    };
    table::to_text(&header, (0..series.nodes).map(row))
}

// ---- series of states: common properties, one state, and the trait of its formats ----

/// State of a series.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Time shown by viewers: seconds of a recording, or the number of a case.
    pub time: f64,
    /// Name and scalars of the state.
    pub label: Label,
    /// Field-major: all nodes of the first field, then of the next.
    pub values: Vec<f32>,
    /// Displacement of the undeformed nodes from [`StateSeries::undeformed`] by parameters, by axis in mm; `None`: zero.
    pub moved: Option<[Vec<f32>; 3]>,
}

/// Properties common to all states.
#[derive(Clone, Copy, Debug)]
pub struct StateSeries<'a> {
    /// Fields in order; x, y and z must be among them.
    pub fields: &'a [FieldSpec],
    pub nodes: usize,
    /// Cells of the body, or facets of its surface.
    pub cells: Cells<'a>,
    /// Undeformed coordinates by axis in mm, if known.
    pub undeformed: Option<[&'a [f32]; 3]>,
    pub count: usize,
}

impl<'a> StateSeries<'a> {
    /// Inconsistencies of the series.
    pub(super) fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics = Vec::new();
        if self.count == 0 {
            diagnostics.push(Diagnostic::new("series", "at least one state", "none"));
        }
        if (0..3).any(|axis| self.axis(axis).is_none()) {
            diagnostics.push(Diagnostic::new(
                "fields",
                "the coordinates x, y and z",
                "a series without them",
            ));
        }
        let corners = match self.cells {
            Cells::QuadraticTets(cells) => cells.as_flattened(),
            Cells::Triangles(cells) => cells.as_flattened(),
            Cells::Mixed(_) => {
                diagnostics.push(Diagnostic::new("cells", "10-node tetrahedra or triangles", "mixed cells"));
                &[]
            }
        };
        if let Some(bad) = corners.iter().find(|node| **node as usize >= self.nodes) {
            diagnostics.push(Diagnostic::new("cells", format!("node indices below {}", self.nodes), bad));
        }
        diagnostics
    }

    /// Checks that a state has a value for each node and field.
    ///
    /// # Errors
    /// Expected and found numbers of values.
    pub(super) fn check_length(&self, place: &str, values: &[f32]) -> Result<(), Diagnostic> {
        let expected = self.nodes * self.fields.len();
        if values.len() == expected {
            return Ok(());
        }
        Err(Diagnostic::new(place, format!("{expected} values"), values.len()))
    }

    /// Names of the columns of a table: `x_mm`.
    pub(super) fn columns(&self) -> impl Iterator<Item = String> + 'a {
        self.fields.iter().map(|field| format!("{}_{}", field.name, field.unit.to_lowercase()))
    }

    /// Position of the deformed coordinate along an axis.
    pub(super) fn axis(&self, axis: u8) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == FieldKind::Coordinate(axis))
    }

    /// Field of a state, by node.
    pub(super) fn field<'m>(&self, values: &'m [f32], field: usize) -> &'m [f32] {
        &values[field * self.nodes..(field + 1) * self.nodes]
    }

    /// Values of all fields at a node.
    pub(super) fn at_node<'m>(&self, values: &'m [f32], node: usize) -> impl Iterator<Item = f32> + 'm {
        values.iter().skip(node).step_by(self.nodes.max(1)).copied()
    }

    /// Positions of the fields that are not coordinates, with name and unit as viewers show them.
    pub(super) fn quantities(&self) -> impl Iterator<Item = (usize, String)> + 'a {
        let all = self.fields.iter().enumerate();
        all.filter(|(_, field)| !matches!(field.kind, FieldKind::Coordinate(_)))
            .map(|(k, field)| (k, format!("{} [{}]", field.name, field.unit)))
    }

    /// Coordinates of a state by axis; an axis without a field is empty.
    pub(super) fn coordinates<'m>(&self, values: &'m [f32]) -> [&'m [f32]; 3] {
        [0, 1, 2].map(|axis| self.axis(axis).map_or(&[][..], |field| self.field(values, field)))
    }
}

/// Format of a series; the writer opens and closes the file.
pub(crate) trait Layout {
    /// Writes the part before the first state.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()>;

    /// Writes one state; `index` counts from 0.
    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()>;

    /// Writes the part after the last state.
    fn end(&mut self, _out: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

/// Writes numbers, `per_line` on each line, each followed by a space.
pub(crate) fn lines(out: &mut dyn Write, values: &[impl Display], per_line: usize) -> io::Result<()> {
    for line in values.chunks(per_line) {
        line.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    Ok(())
}

/// All states as one table: one row per node and state.
pub(crate) struct Csv<'a>(pub(crate) StateSeries<'a>);

/// Names of the columns that are constant within a state.
pub(super) fn heading(label: &Label) -> impl Iterator<Item = String> {
    let name = Some("case".to_owned()).filter(|_| !label.name.is_empty());
    label.numbers.iter().map(|(name, _)| name.clone()).chain(name)
}

/// Values of these columns; empty if not finite.
pub(super) fn cells(label: &Label) -> Vec<String> {
    let number = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    let name = Some(label.name.clone()).filter(|name| !name.is_empty());
    label.numbers.iter().map(|(_, value)| number(*value)).chain(name).collect()
}

impl Layout for Csv<'_> {
    /// Writes nothing: the heading needs the names in the first state.
    fn begin(&mut self, _: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }

    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()> {
        let mut table = TableWriter::new(out);
        if index == 0 {
            let first = ["time", "node"].map(str::to_owned);
            table.row(first.into_iter().chain(self.0.columns()).chain(heading(&moment.label)))?;
        }
        let last = cells(&moment.label);
        for node in 0..self.0.nodes {
            let values: Vec<f32> = self.0.at_node(&moment.values, node).collect();
            let first: [&dyn Display; 2] = [&moment.time, &node];
            let values = values.iter().map(|value| value as &dyn Display);
            table.row(first.into_iter().chain(values).chain(last.iter().map(|cell| cell as &dyn Display)))?;
        }
        table.finish().map(drop)
    }
}

/// All states as one NumPy array: f32, states x nodes x fields, as `snapshots.npy` of a database.
pub(crate) struct Npy<'a>(pub(crate) StateSeries<'a>);

impl Layout for Npy<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        npy::write_f32_to(out, &[self.0.count, self.0.nodes, self.0.fields.len()], &[])
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let values = (0..self.0.nodes).flat_map(|node| self.0.at_node(&moment.values, node));
        let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
        out.write_all(&bytes)
    }
}

// ---- Tecplot ASCII ----

// Tecplot ASCII: one finite-element zone per state, nodes and connectivity as the authors' post-processing reads them.
//
// Tecplot has no quadratic tetrahedra, so each is split into eight linear ones over its ten nodes; nodes keep their numbers and
// values. Every zone has a connectivity, because other readers do not support shared ones.

/// Eight linear tetrahedra of a quadratic one: four at its corners, four around the diagonal from the mid-side of 02 to that of 13.
const EIGHT: [[usize; 4]; 8] = [
    [0, 4, 6, 7],
    [4, 1, 5, 8],
    [6, 5, 2, 9],
    [7, 8, 9, 3],
    [6, 4, 5, 8],
    [6, 5, 9, 8],
    [6, 9, 7, 8],
    [6, 7, 4, 8],
];

/// Numbers per line; Tecplot reads up to 32,000 characters.
const A_LINE: usize = 10;

pub(crate) struct Tecplot<'a> {
    series: StateSeries<'a>,
    kind: &'static str,
    corners: usize,
    cells: Vec<u32>,
}

impl<'a> Tecplot<'a> {
    pub(crate) fn new(series: StateSeries<'a>) -> Self {
        let (kind, corners, cells) = linear(series.cells);
        Self { series, kind, corners, cells }
    }
}

impl Layout for Tecplot<'_> {
    /// Writes upper-case names for the coordinates, and name with unit for the rest.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let quantities = self.series.quantities().map(|(_, name)| name);
        let names: Vec<String> = ["X", "Y", "Z"].map(String::from).into_iter().chain(quantities).collect();
        writeln!(out, "TITLE = \"softtwin\"\nVARIABLES = \"{}\"", names.join("\", \""))
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let title = moment.label.to_string().replace(['"', '\n'], "'");
        let (nodes, elements) = (self.series.nodes, self.cells.len() / self.corners);
        let (kind, time) = (self.kind, moment.time);
        writeln!(
            out,
            "ZONE T=\"{title}\", STRANDID=1, SOLUTIONTIME={time}, NODES={nodes}, ELEMENTS={elements}, DATAPACKING=BLOCK, ZONETYPE={kind}"
        )?;
        let quantities = self.series.quantities().map(|(k, _)| self.series.field(&moment.values, k));
        for values in self.series.coordinates(&moment.values).into_iter().chain(quantities) {
            lines(out, values, A_LINE)?;
        }
        let numbers: Vec<u32> = self.cells.iter().map(|node| node + 1).collect();
        lines(out, &numbers, self.corners)
    }
}

fn linear(cells: Cells<'_>) -> (&'static str, usize, Vec<u32>) {
    match cells {
        Cells::QuadraticTets(tets) => {
            let parts = tets.iter().flat_map(|tet| EIGHT.map(|part| part.map(|k| tet[k])));
            ("FETETRAHEDRON", 4, parts.flatten().collect())
        }
        Cells::Triangles(facets) => ("FETRIANGLE", 3, facets.as_flattened().to_vec()),
        Cells::Mixed(_) => ("FETRIANGLE", 3, Vec::new()), // refused by the series before
    }
}

/// XDMF 3: a temporal collection of grids with inline numbers.
pub(crate) struct Xdmf<'a>(pub(crate) StateSeries<'a>);

impl Layout for Xdmf<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>")?;
        writeln!(out, "<Grid Name=\"softtwin\" GridType=\"Collection\" CollectionType=\"Temporal\">")
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let Self(series) = self;
        let (title, time) = (escape(moment.label.to_string()), moment.time);
        writeln!(out, "<Grid Name=\"{title}\" GridType=\"Uniform\">\n<Time Value=\"{time}\"/>")?;
        topology(out, series.cells)?;
        let [x, y, z] = series.coordinates(&moment.values);
        let points: Vec<[f32; 3]> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
        writeln!(out, "<Geometry GeometryType=\"XYZ\">")?;
        floats(out, &format!("{} 3", series.nodes), points.as_flattened(), 3)?;
        writeln!(out, "</Geometry>")?;
        for (k, name) in series.quantities() {
            let name = escape(name.as_str());
            writeln!(out, "<Attribute Name=\"{name}\" AttributeType=\"Scalar\" Center=\"Node\">")?;
            floats(out, &series.nodes.to_string(), series.field(&moment.values, k), 10)?;
            writeln!(out, "</Attribute>")?;
        }
        writeln!(out, "</Grid>")
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "</Grid>\n</Domain>\n</Xdmf>")
    }
}

/// XDMF's node order of the quadratic tetrahedron is that of VTK.
fn topology(out: &mut dyn Write, cells: Cells<'_>) -> io::Result<()> {
    let (kind, corners, nodes) = match cells {
        Cells::QuadraticTets(tets) => ("Tetrahedron_10", 10, tets.as_flattened()),
        Cells::Triangles(facets) => ("Triangle", 3, facets.as_flattened()),
        Cells::Mixed(_) => return Ok(()), // refused by the series before
    };
    let count = nodes.len() / corners;
    writeln!(out, "<Topology TopologyType=\"{kind}\" NumberOfElements=\"{count}\">")?;
    item(out, "Int", 8, &format!("{count} {corners}"), nodes, corners)?;
    writeln!(out, "</Topology>")
}

fn floats(out: &mut dyn Write, dimensions: &str, values: &[f32], a_line: usize) -> io::Result<()> {
    item(out, "Float", 4, dimensions, values, a_line)
}

fn item(
    out: &mut dyn Write,
    kind: &str,
    bytes: u8,
    dimensions: &str,
    values: &[impl Display],
    a_line: usize,
) -> io::Result<()> {
    writeln!(
        out,
        "<DataItem DataType=\"{kind}\" Dimensions=\"{dimensions}\" Format=\"XML\" Precision=\"{bytes}\">"
    )?;
    lines(out, values, a_line)?;
    writeln!(out, "</DataItem>")
}

// ---- ParaView's collection: a `.pvd` that lists one `.vtu` per state, with its time ----

/// Writer of `NAME_0000.vtu`, `NAME_0001.vtu`, ... in the folder of `NAME.pvd`.
pub(crate) struct Pvd<'a> {
    path: PathBuf,
    series: StateSeries<'a>,
}

impl<'a> Pvd<'a> {
    pub(crate) fn new(path: &Path, series: StateSeries<'a>) -> Self {
        Self { path: path.into(), series }
    }
}

pub(crate) fn state_file(path: &Path, index: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}_{index:04}.vtu"))
}

impl Layout for Pvd<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "<?xml version=\"1.0\"?>")?;
        writeln!(
            out,
            "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>"
        )
    }

    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()> {
        let file = state_file(&self.path, index);
        write_vtu(&file, &self.series, moment).map_err(io::Error::other)?;
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let name = escape(name.as_ref());
        writeln!(out, "<DataSet timestep=\"{}\" part=\"0\" file=\"{name}\"/>", moment.time)
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "</Collection>\n</VTKFile>")
    }
}

/// Writes a state as a VTK unstructured grid of the deformed body.
///
/// # Errors
/// A state without coordinates, or as [`vtu::write`].
pub(crate) fn write_vtu(path: &Path, series: &StateSeries<'_>, moment: &Moment) -> Result<(), FormatError> {
    let Moment { label, values, moved, .. } = moment;
    let deformed = series.coordinates(values);
    if deformed.iter().any(|axis| axis.len() != series.nodes) {
        let diagnostic = Diagnostic::new("fields", "the coordinates x, y and z", "a state without them");
        return Err(FormatError::one(path, diagnostic));
    }
    let points: Vec<[f64; 3]> = (0..series.nodes).map(|i| deformed.map(|c| f64::from(c[i]))).collect();
    let vector: Option<Vec<f32>> = series.undeformed.map(|undeformed| {
        let moved = |k: usize, i: usize| moved.as_ref().map_or(0.0, |moved| moved[k][i]);
        let offset = |i: usize| (0..3).map(move |k| deformed[k][i] - (undeformed[k][i] + moved(k, i)));
        (0..series.nodes).flat_map(offset).collect()
    });
    let named: Vec<(usize, String)> = series.quantities().collect();
    let scalars = named.iter().map(|(k, name)| (name, series.field(values, *k)));
    let mut data: Vec<vtu::PointData<'_>> =
        scalars.map(|(name, values)| vtu::PointData { name, components: 1, values }).collect();
    if let Some(values) = &vector {
        data.push(vtu::PointData { name: "displacement vector [mm]", components: 3, values });
    }
    let grid = vtu::Grid { points_mm: &points, cells: series.cells, point_data: &data };
    let numbers: Vec<(&str, f64)> = label.present().collect();
    vtu::write_labelled(path, &grid, &label.name, &numbers)
}

impl Moment {
    /// A case with its number in the file as its time.
    pub fn of_case(database: &Database, k: usize) -> Self {
        let case = &database.cases[k];
        let values = (0..database.fields.len()).flat_map(|field| database.field(k, field)).collect();
        let names = database.parameters.iter().map(|parameter| parameter.name.clone());
        let parameters = names.zip(case.parameters.iter().copied());
        let label = Label::of_state(case.pressure_mpa, case.gap_mm, parameters, case.contact_force_n);
        let label = Label { name: case.name.clone(), ..label };
        Self { time: k as f64, label, values, moved: database.moved_mm(k) }
    }

    /// A model's state for a file, with every input, the contact force and the observables.
    pub fn of_model(model: &Model, state: &ModelState, observables: &Observables, time: f64) -> Self {
        let evaluation = state.evaluation();
        let values = evaluation.inputs.values();
        let taken = model.header.taken_inputs().map(|(index, input)| (input.key(), values[index]));
        let mut numbers: Vec<(String, f64)> = taken.collect();
        if model.header.has_forces() {
            numbers.push(("contact_force_n".to_owned(), evaluation.contact_force_n));
        }
        let observed = observables.names().enumerate();
        numbers.extend(
            observed.map(|(index, name)| (name.to_owned(), observables.value(index, evaluation).value)),
        );
        let label = Label { name: String::new(), numbers };
        let moved = model.moved_mm(&evaluation.inputs);
        Self { time, label, values: state.fields().to_vec(), moved }
    }
}

/// A body without its states.
pub struct ExportBody {
    /// Number of nodes.
    pub nodes: usize,
    undeformed: Option<[Vec<f32>; 3]>,
    facets: Vec<[u32; 3]>,
    tets: Vec<[u32; 10]>,
}

impl ExportBody {
    /// The body of a model.
    pub fn of_model(model: &Model) -> Self {
        Self {
            nodes: model.header.node_count,
            undeformed: model.undeformed_mm().map(|axes| axes.map(<[f32]>::to_vec)),
            facets: model.facets().to_vec(),
            tets: Vec::new(),
        }
    }

    /// The body of a database.
    pub fn of_database(database: &Database) -> Self {
        let axis = |points: &[[f64; 3]], k: usize| points.iter().map(|p| p[k] as f32).collect();
        Self {
            nodes: database.node_count,
            undeformed: database.undeformed_mm.as_ref().map(|points| [0, 1, 2].map(|k| axis(points, k))),
            facets: database.surface_triangles.clone(),
            tets: Vec::new(),
        }
    }

    /// Nodes of which nothing else is known.
    pub fn of_points(nodes: usize) -> Self {
        Self { nodes, undeformed: None, facets: Vec::new(), tets: Vec::new() }
    }

    /// The same with the cells of a mesh file.
    ///
    /// # Errors
    /// A file that cannot be read, or has another number of nodes.
    pub fn with_mesh(mut self, path: Option<&Path>) -> Result<Self, FormatError> {
        let Some(path) = path else { return Ok(self) };
        let mesh = crate::read_mesh(path)?;
        let (expected, found) = (self.nodes, mesh.points_mm.len());
        if found != expected {
            let diagnostic = Diagnostic::new("nodes", format!("{expected}, as in the states"), found);
            return Err(FormatError::one(path, diagnostic));
        }
        self.undeformed = Some([0, 1, 2].map(|k| mesh.points_mm.iter().map(|p| p[k] as f32).collect()));
        self.tets = mesh.tets;
        Ok(self)
    }

    /// The description of a series of `count` states.
    pub fn series<'a>(&'a self, fields: &'a [FieldSpec], count: usize) -> StateSeries<'a> {
        let cells = match self.tets.as_slice() {
            [] => Cells::Triangles(&self.facets),
            tets => Cells::QuadraticTets(tets),
        };
        let undeformed = self.undeformed.as_ref().map(|[x, y, z]| [x.as_slice(), y, z]);
        StateSeries { fields, nodes: self.nodes, cells, undeformed, count }
    }
}

#[cfg(test)]
#[path = "../tests/unit/export_tecplot.rs"]
mod tecplot_tests;
