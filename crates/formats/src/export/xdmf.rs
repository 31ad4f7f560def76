//! XDMF 3: a temporal collection whose grids share one topology; numbers stand in the file itself.

use super::Series;
use crate::error::FormatError;
use crate::vtu::Cells;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Writes the file.
pub fn write(path: &Path, series: &Series<'_>) -> Result<Vec<PathBuf>, FormatError> {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n");
    text += "<Grid Name=\"softtwin\" GridType=\"Collection\" CollectionType=\"Temporal\">\n";
    for moment in series.moments {
        let title = quick_xml::escape::escape(moment.title.as_str());
        let _ = writeln!(text, "<Grid Name=\"{title}\" GridType=\"Uniform\">\n<Time Value=\"{}\"/>", moment.time);
        topology(&mut text, series.cells);
        let [x, y, z] = series.coordinates(moment);
        let points: Vec<[f32; 3]> = x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect();
        text += "<Geometry GeometryType=\"XYZ\">\n";
        item(&mut text, &format!("{} 3", series.nodes), points.as_flattened(), 3);
        text += "</Geometry>\n";
        for k in series.quantities() {
            let name = format!("{} [{}]", series.fields[k].name, series.fields[k].unit);
            let name = quick_xml::escape::escape(name.as_str());
            let _ = writeln!(text, "<Attribute Name=\"{name}\" AttributeType=\"Scalar\" Center=\"Node\">");
            item(&mut text, &series.nodes.to_string(), series.field(moment, k), 10);
            text += "</Attribute>\n";
        }
        text += "</Grid>\n";
    }
    text += "</Grid>\n</Domain>\n</Xdmf>\n";
    std::fs::write(path, text).map_err(|error| FormatError::write(path, error))?;
    Ok(vec![path.into()])
}

/// XDMF's node order of the quadratic tetrahedron is VTK's, which is ours.
fn topology(text: &mut String, cells: Cells<'_>) {
    let (kind, count, corners, nodes): (_, _, _, Vec<u32>) = match cells {
        Cells::QuadraticTets(tets) => ("Tetrahedron_10", tets.len(), 10, tets.as_flattened().to_vec()),
        Cells::Triangles(facets) => ("Triangle", facets.len(), 3, facets.as_flattened().to_vec()),
    };
    let _ = writeln!(text, "<Topology TopologyType=\"{kind}\" NumberOfElements=\"{count}\">");
    let _ = writeln!(text, "<DataItem DataType=\"Int\" Dimensions=\"{count} {corners}\" Format=\"XML\" Precision=\"8\">");
    lines(text, &nodes, corners);
    text.push_str("</DataItem>\n</Topology>\n");
}

fn item(text: &mut String, dimensions: &str, values: &[f32], a_line: usize) {
    let _ = writeln!(text, "<DataItem DataType=\"Float\" Dimensions=\"{dimensions}\" Format=\"XML\" Precision=\"4\">");
    lines(text, values, a_line);
    text.push_str("</DataItem>\n");
}

fn lines(text: &mut String, values: &[impl std::fmt::Display], a_line: usize) {
    for line in values.chunks(a_line) {
        for value in line {
            let _ = write!(text, "{value} ");
        }
        text.push('\n');
    }
}
