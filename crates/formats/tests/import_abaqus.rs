//! Abaqus input files: what is read, what is refused and by which name.

use formats::abaqus::{self, AbaqusMesh};
use formats::mesh_file::MeshFile;
use proptest::prelude::*;

/// A 10-node tetrahedron whose node numbers begin at 11, with the surrounding content of a real file.
const TET: &str = "*Heading\n** a comment\n*Part, name=FINGER\n*Node, nset=ALL\n 11, 0., 0., 0.\n 12, 1., 0., 0.\n 13, 0., 1.,\n\
 14, 0., 0., 1.\n15,.5,0,0\n16,.5,.5,0\n17,0,.5,0\n18,0,0,.5\n19,.5,0,.5\n20,0,.5,.5\n*ELEMENT, type=c3d10h, elset=BODY\n\
 1, 11, 12, 13, 14, 15, 16,\n 17, 18, 19, 20\n*Nset, nset=tip, generate\n 12, 16, 2\n*Nset, nset=ends\n11, 14\n\
*Material, name=GENT\n*Density\n 1e-9,\n*End Part\n";

fn refused(text: &str) -> String {
    let problems = abaqus::parse(text).expect_err("refused");
    problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

#[test]
fn nodes_and_elements_over_several_lines_are_read() {
    let AbaqusMesh { points, labels, blocks } = abaqus::parse(TET).expect("a mesh");
    assert_eq!((points.len(), labels[0], points[2]), (10, 11, [0.0, 1.0, 0.0]));
    let mesh = MeshFile::of_solids(points, &blocks).expect("tetrahedra");
    assert_eq!(mesh.tets, [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]]);
}

#[test]
fn unknown_keywords_are_refused_by_name_and_line() {
    assert!(refused(&TET.replace("c3d10h", "C3D5")).contains("C3D5"));
    assert!(refused(&format!("{TET}*Include, input=more.inp\n")).contains("*INCLUDE"));
    assert!(refused(&format!("{TET}*Part, name=B\n")).contains("*PART"));
    assert!(refused(&TET.replace(" 17, 18, 19, 20\n", " 17, 18\n")).contains("found 8"));
    assert!(refused(&TET.replace("17, 18, 19, 20", "17, 18, 19, 99")).contains("node 99"));
    assert!(refused(&TET.replace(" 13, 0., 1.,", " 13, zero, 1.,")).contains("line 7"));
    assert!(refused(&TET.replace("15,.5,0,0", "11,.5,0,0")).contains("node 11 again"));
    assert!(refused("*Heading\n").contains("*NODE"));
}

#[test]
fn hexahedra_and_shells_are_read_but_are_no_body_of_tetrahedra() {
    let nodes: String = (1..=20).map(|k| format!("{k}, {k}., 0., 0.\n")).collect();
    let row = |count: usize| (1..=count).map(|k| k.to_string()).collect::<Vec<_>>().join(", ");
    let text = format!(
        "*Node\n{nodes}*Element, type=C3D20R\n1, {}\n*Element, type=S8R\n2, {}\n*Element, type=STRI65\n3, {}\n",
        row(20),
        row(8),
        row(6)
    );
    let mesh = abaqus::parse(&text).expect("a mesh");
    let kinds: Vec<(u8, usize)> = mesh.blocks.iter().map(|b| (b.kind, b.nodes_per_cell)).collect();
    assert_eq!(kinds, [(25, 20), (23, 8), (22, 6)]);
    let refused = MeshFile::of_solids(mesh.points, &mesh.blocks).expect_err("no tetrahedra");
    assert_eq!((refused.place.as_str(), refused.found.as_str()), ("cells", "1 of type 25"));
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in "(\\*(NODE|ELEMENT, TYPE=C3D10|NSET, NSET=A, GENERATE|PART)\n|[0-9 ,.e*-]{0,12}\n){0,20}") {
        let _ = abaqus::parse(&text);
    }
}
