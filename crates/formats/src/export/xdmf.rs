//! XDMF 3: a temporal collection of grids with inline numbers.

use super::series::{Layout, Moment, Series, lines};
use crate::vtu::Cells;
use quick_xml::escape::escape;
use std::io::{self, Write};

pub(crate) struct Xdmf<'a>(pub(crate) Series<'a>);

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
    values: &[impl std::fmt::Display],
    a_line: usize,
) -> io::Result<()> {
    writeln!(
        out,
        "<DataItem DataType=\"{kind}\" Dimensions=\"{dimensions}\" Format=\"XML\" Precision=\"{bytes}\">"
    )?;
    lines(out, values, a_line)?;
    writeln!(out, "</DataItem>")
}
