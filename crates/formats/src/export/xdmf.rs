//! XDMF 3: a temporal collection of grids; numbers stand in the file itself.

use super::{Moment, Series, Sink};
use crate::error::FormatError;
use crate::vtu::Cells;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

pub struct Xdmf<'a> {
    path: PathBuf,
    out: BufWriter<File>,
    series: Series<'a>,
}

impl<'a> Xdmf<'a> {
    pub fn new(path: &Path, series: Series<'a>) -> Result<Self, FormatError> {
        let io = |error| FormatError::write(path, error);
        let mut out = BufWriter::new(File::create(path).map_err(io)?);
        let head = "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n\
                    <Grid Name=\"softtwin\" GridType=\"Collection\" CollectionType=\"Temporal\">";
        writeln!(out, "{head}").map_err(io)?;
        Ok(Self { path: path.into(), out, series })
    }

    fn grid(&mut self, moment: &Moment) -> io::Result<()> {
        let title = quick_xml::escape::escape(moment.title.as_str()).into_owned();
        writeln!(
            self.out,
            "<Grid Name=\"{title}\" GridType=\"Uniform\">\n<Time Value=\"{}\"/>",
            moment.time
        )?;
        self.topology()?;
        let [x, y, z] = self.series.coordinates(moment);
        let points: Vec<[f32; 3]> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
        writeln!(self.out, "<Geometry GeometryType=\"XYZ\">")?;
        self.floats(&format!("{} 3", self.series.nodes), points.as_flattened(), 3)?;
        writeln!(self.out, "</Geometry>")?;
        for (k, name) in self.series.quantities() {
            let name = quick_xml::escape::escape(name.as_str());
            writeln!(self.out, "<Attribute Name=\"{name}\" AttributeType=\"Scalar\" Center=\"Node\">")?;
            self.floats(&self.series.nodes.to_string(), self.series.field(moment, k), 10)?;
            writeln!(self.out, "</Attribute>")?;
        }
        writeln!(self.out, "</Grid>")
    }

    /// XDMF's node order of the quadratic tetrahedron is VTK's, which is ours.
    fn topology(&mut self) -> io::Result<()> {
        let (kind, corners, nodes) = match self.series.cells {
            Cells::QuadraticTets(tets) => ("Tetrahedron_10", 10, tets.as_flattened()),
            Cells::Triangles(facets) => ("Triangle", 3, facets.as_flattened()),
            Cells::Mixed(_) => return Ok(()), // refused before any file is opened
        };
        let count = nodes.len() / corners;
        writeln!(self.out, "<Topology TopologyType=\"{kind}\" NumberOfElements=\"{count}\">")?;
        writeln!(
            self.out,
            "<DataItem DataType=\"Int\" Dimensions=\"{count} {corners}\" Format=\"XML\" Precision=\"8\">"
        )?;
        lines(&mut self.out, nodes, corners)?;
        writeln!(self.out, "</DataItem>\n</Topology>")
    }

    fn floats(&mut self, dimensions: &str, values: &[f32], a_line: usize) -> io::Result<()> {
        writeln!(
            self.out,
            "<DataItem DataType=\"Float\" Dimensions=\"{dimensions}\" Format=\"XML\" Precision=\"4\">"
        )?;
        lines(&mut self.out, values, a_line)?;
        writeln!(self.out, "</DataItem>")
    }
}

impl Sink for Xdmf<'_> {
    fn add(&mut self, _: usize, moment: &Moment) -> Result<(), FormatError> {
        self.grid(moment).map_err(|error| FormatError::write(&self.path, error))
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, FormatError> {
        let closed = writeln!(self.out, "</Grid>\n</Domain>\n</Xdmf>").and_then(|()| self.out.flush());
        closed.map_err(|error| FormatError::write(&self.path, error))?;
        Ok(vec![self.path])
    }
}

fn lines(out: &mut impl Write, values: &[impl std::fmt::Display], a_line: usize) -> io::Result<()> {
    for line in values.chunks(a_line) {
        line.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    Ok(())
}
