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
    let AbaqusMesh { points, labels, blocks, .. } = abaqus::parse(TET).expect("a mesh");
    assert_eq!((points.len(), labels[0], points[2]), (10, 11, [0.0, 1.0, 0.0]));
    let mesh = MeshFile::of_solids(points, &blocks).expect("tetrahedra");
    assert_eq!(mesh.tets, [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]]);
}

#[test]
fn unknown_keywords_are_refused_by_name_and_line() {
    assert!(refused(&TET.replace("c3d10h", "C3D5")).contains("C3D5"));
    assert!(refused(&format!("{TET}*Include, input=more.inp\n")).contains("more.inp"));
    assert!(refused(&format!("{TET}*Part, name=B\n")).contains("2 parts"));
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

/// Nodes and one hexahedron of 2 x 1 x 3.
const BRICK: &str = "*Node\n1,0,0,0\n2,2,0,0\n3,2,1,0\n4,0,1,0\n5,0,0,3\n6,2,0,3\n7,2,1,3\n8,0,1,3\n*Element, type=C3D8\n1,1,2,3,4,5,6,7,8\n";

fn extents(mesh: &AbaqusMesh) -> ([f64; 3], [f64; 3]) {
    let over = |pick: fn(f64, f64) -> f64, start: f64| {
        [0, 1, 2].map(|k| mesh.points.iter().fold(start, |m, p| pick(m, p[k])))
    };
    (over(f64::min, f64::INFINITY), over(f64::max, f64::NEG_INFINITY))
}

fn near(found: ([f64; 3], [f64; 3]), expected: ([f64; 3], [f64; 3])) -> bool {
    let pairs = found.0.iter().chain(&found.1).zip(expected.0.iter().chain(&expected.1));
    pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-9)
}

#[test]
fn systems_place_the_nodes_that_follow_until_the_next() {
    let moved = abaqus::parse(&format!("*System\n0,0,100, 1,0,100\n{BRICK}")).expect("a mesh");
    assert!(near(extents(&moved), ([0.0, 0.0, 100.0], [2.0, 1.0, 103.0])), "{:?}", moved.points);
    // x along the global y, xy plane towards the global z.
    let turned = abaqus::parse(&format!("*System\n5,0,0, 5,1,0\n5,0,1\n{BRICK}")).expect("a mesh");
    assert!(near(extents(&turned), ([5.0, 0.0, 0.0], [8.0, 2.0, 1.0])), "{:?}", turned.points);
    let ended = abaqus::parse(&format!("*System\n0,0,100\n*System\n{BRICK}")).expect("a mesh");
    assert!(near(extents(&ended), ([0.0; 3], [2.0, 1.0, 3.0])), "{:?}", ended.points);
    // Coordinates left out are zero, at their places; Fortran's exponents are numbers.
    let blanks = abaqus::parse(&format!("*System\n,,1.D2, 1,,1.D2,\n{BRICK}")).expect("a mesh");
    assert_eq!(blanks.points, moved.points);
    assert!(refused(&format!("*System\n0,0,inf\n{BRICK}")).contains("inf"));
    assert!(
        refused(&format!("*System\n0,0,0, 0,0,1\n{BRICK}")).contains("*SYSTEM"),
        "no axis in the xy plane"
    );
}

#[test]
fn cylindrical_and_spherical_coordinates_become_rectangular() {
    let nodes = |kind: &str| format!("*Node, system={kind}\n1, 2, 90, 30\n2, 2, 0, 0\n3, 2, 180, 90\n");
    let points = |kind: &str| abaqus::parse(&nodes(kind)).expect("nodes").points;
    let close = |found: Vec<[f64; 3]>, expected: [[f64; 3]; 3]| {
        found.as_flattened().iter().zip(expected.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-12)
    };
    assert!(close(points("C"), [[0.0, 2.0, 30.0], [2.0, 0.0, 0.0], [-2.0, 0.0, 90.0]]));
    let across = 3.0_f64.sqrt();
    assert!(close(points("S"), [[0.0, across, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]]));
    assert!(refused(&nodes("Q")).contains("SYSTEM=Q"));
}

#[test]
fn instances_are_placed_copies_of_their_parts() {
    let assembly = |instances: &str| {
        format!(
            "*Part, name=Brick\n{BRICK}*End Part\n*Assembly, name=A\n{instances}*Node\n1, 9, 9, 9\n*End Assembly\n"
        )
    };
    let read = |instances: &str| abaqus::parse(&assembly(instances)).expect("a mesh");
    let turned = read("*Instance, name=L, part=brick\n10, 0, 0\n10, 0, 0, 10, 0, 1, 90\n*End Instance\n");
    assert!(near(extents(&turned), ([9.0, 0.0, 0.0], [10.0, 2.0, 3.0])), "{:?}", turned.points);
    let two = read(
        "*Instance, name=L, part=BRICK\n*End Instance\n*Instance, name=R, part=BRICK\n0, 0, 50\n*End Instance\n",
    );
    assert_eq!((two.points.len(), two.blocks[0].count()), (16, 2));
    assert_eq!(two.instances, [("L".to_owned(), 8), ("R".to_owned(), 8)]);
    assert_eq!(two.blocks[0].nodes[8..], [8, 9, 10, 11, 12, 13, 14, 15]);
    assert!(near(extents(&two), ([0.0; 3], [2.0, 1.0, 53.0])));
    assert!(refused(&assembly("*Instance, name=L, part=Other\n*End Instance\n")).contains("OTHER"));
    assert!(refused(&assembly("*Instance, library=old, name=L\n*End Instance\n")).contains("LIBRARY"));
    assert!(
        refused(&assembly("*Instance, name=L, part=BRICK\n1, 2, 3, 4\n*End Instance\n"))
            .contains("*INSTANCE")
    );
}

#[test]
fn nodes_and_elements_given_twice_are_refused_unless_equal() {
    let plain = abaqus::parse(BRICK).expect("a mesh");
    let again = format!("{BRICK}1,1,2,3,4,5,6,7,8\n*Node\n2,2,0,0\n8,0,1.0000000000001,3\n");
    assert_eq!(abaqus::parse(&again).expect("a mesh"), plain);
    assert!(refused(&format!("{BRICK}*Node\n2,2,0,0.001\n")).contains("node 2 again"));
    let text = refused(&format!("{BRICK}1,2,3,4,1,6,7,8,5\n"));
    assert!(text.contains("line 12") && text.contains("line 11"), "{text}");
    assert!(
        refused(BRICK.strip_prefix("*Node\n").expect("nodes")).contains("node 1"),
        "elements without nodes"
    );
    let oriented = abaqus::parse(&format!("{BRICK}*Orientation, name=O\n1,0,0, 0,1,0\n")).expect("a mesh");
    assert!(oriented.left_out[0].contains("ORIENTATION"));
}

#[test]
fn included_files_are_read_beside_the_file_that_names_them() {
    let dir = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).expect("written");
    let (nodes, elements) = BRICK.split_once("*Element, type=C3D8\n").expect("both");
    write("nodes.txt", nodes.strip_prefix("*Node\n").expect("nodes"));
    write("body.inp", &format!("*Element, type=C3D8\n{elements}"));
    write("job.inp", "*Node, nset=ALL,\ninput=nodes.txt\n*Include, input=body.inp\n");
    let mesh = abaqus::read(&dir.path().join("job.inp")).expect("a mesh");
    assert_eq!(mesh, abaqus::parse(BRICK).expect("a mesh"));
    write("nodes.txt", "1, 0, 0, zero\n");
    let error = abaqus::read(&dir.path().join("job.inp")).expect_err("refused").to_string();
    assert!(error.contains("nodes.txt, line 1"), "{error}");
    write("loop.inp", "*Include, input=loop.inp\n");
    assert!(abaqus::read(&dir.path().join("loop.inp")).is_err());
}

#[test]
fn elements_without_a_body_are_left_out_by_name_and_bodies_are_not() {
    for kind in ["T3D2", "B31", "R3D4", "SFM3D4", "SPRINGA", "CONN3D2"] {
        let mesh = abaqus::parse(&format!("{BRICK}*Element, type={kind}\n9, 1, 2\n")).expect("a mesh");
        assert_eq!(mesh.blocks, abaqus::parse(BRICK).expect("a mesh").blocks);
        assert!(mesh.left_out.len() == 1 && mesh.left_out[0].contains(kind), "{:?}", mesh.left_out);
    }
    for kind in ["C3D27", "CPS4", "CAX8"] {
        assert!(refused(&format!("{BRICK}*Element, type={kind}\n9, 1, 2\n")).contains(kind));
    }
    for keyword in ["NGEN", "NMAP", "IMPERFECTION"] {
        assert!(refused(&format!("{BRICK}*{keyword}\n")).contains(keyword));
    }
    assert_eq!(abaqus::parse(&format!("{BRICK}*Transform, nset=A\n")).expect("a mesh").left_out.len(), 1);
}

proptest! {
    /// Nodes in any order, in blocks whose keywords are spelled in any way, between keywords that change no geometry, some repeated: the
    /// corners of the element are where the labels say. A repeated node elsewhere is refused.
    #[test]
    fn nodes_in_any_order_and_spelling_are_where_their_labels_say(
        order in Just((1_usize..=8).collect::<Vec<_>>()).prop_shuffle(),
        spelling in prop::collection::vec(0_usize..5, 8),
        places in prop::collection::vec(prop::array::uniform3(-9.0_f64..9.0), 8),
        repeated in 1_usize..=8,
        labels in prop::collection::btree_set(1_u64..1_000_000, 8),
    ) {
        let labels: Vec<u64> = labels.into_iter().collect();
        let place = |node: usize| places[node - 1];
        let line = |node: usize, add: f64| {
            let [x, y, z] = place(node);
            format!("{}, {x:e},{y} , {}\n", labels[node - 1], z + add)
        };
        let keywords = ["*Node\n", "*NODE, NSET=ALL\n", "** a comment\n", "*node,\nnset=A\n", "*Nset, nset=B\n7\n*Node\n"];
        let nodes: String = order
            .iter()
            .zip(&spelling)
            .map(|(node, spelling)| keywords[*spelling].to_owned() + &line(*node, 0.0))
            .collect();
        let corners = labels.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let element = format!("*Element, TYPE=C3D8\n1, {corners}\n");
        let text = |add: f64| format!("*Node\n{nodes}{}{element}", line(repeated, add));
        let mesh = abaqus::parse(&text(0.0)).expect("a mesh");
        prop_assert_eq!(mesh.points.len(), 8);
        prop_assert_eq!(mesh.blocks.len(), 1);
        for (corner, at) in mesh.blocks[0].nodes.iter().enumerate() {
            prop_assert_eq!(mesh.points[*at as usize], place(corner + 1));
            prop_assert_eq!(mesh.labels[*at as usize], labels[corner]);
        }
        prop_assert!(abaqus::parse(&text(0.5)).is_err(), "two places of one node");
    }

    /// A brick placed by a system, in cylindrical coordinates, and by an instance: the distances between its nodes stay, and its
    /// nodes are where two rotations and translations put them.
    #[test]
    fn placements_keep_distances_and_agree(a in prop::array::uniform3(-5.0_f64..5.0), degrees in -180.0_f64..180.0) {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let [x, y, z] = a;
        let by_system = abaqus::parse(&format!("*System\n{x},{y},{z},{},{},{z}\n{BRICK}", x + cos, y + sin)).expect("a mesh");
        let by_instance = abaqus::parse(&format!(
            "*Part, name=B\n{BRICK}*End Part\n*Assembly\n*Instance, name=I, part=B\n{x},{y},{z}\n{x},{y},{z},{x},{y},{},{degrees}\n*End Instance\n",
            z + 1.0
        )).expect("a mesh");
        let plain = abaqus::parse(BRICK).expect("a mesh");
        for ((s, i), p) in by_system.points.iter().zip(&by_instance.points).zip(&plain.points) {
            let expected = [x + cos * p[0] - sin * p[1], y + sin * p[0] + cos * p[1], z + p[2]];
            for k in 0..3 {
                prop_assert!((s[k] - expected[k]).abs() < 1e-9 && (i[k] - expected[k]).abs() < 1e-9, "{s:?} {i:?} {expected:?}");
            }
        }
    }
}

/// Two tetrahedra with a common face: sets by name and number, of elements, faces and nodes, in a part and in an assembly.
#[test]
fn named_sets_become_volumes_and_surfaces() {
    let corners = [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2], [2, 2, 2]];
    let edges = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3], [1, 4], [2, 4], [3, 4]];
    let place = |k: usize| -> String {
        let p = match k {
            0..5 => corners[k],
            _ => [0, 1, 2].map(|i| (corners[edges[k - 5][0]][i] + corners[edges[k - 5][1]][i]) / 2),
        };
        format!("{}, {}, {}, {}\n", k + 1, p[0], p[1], p[2])
    };
    let nodes: String = (0..14).map(place).collect();
    let body = format!(
        "*Part, name=P\n*Node\n{nodes}*Element, type=C3D10, elset=soft\n1, 1,2,3,4, 6,7,8,9,10,11\n*Element, type=C3D10\n\
         2, 2,3,4,5, 7,11,10,12,13,14\n*Elset, elset=Bone\n2\n*Elset, elset=both, generate\n1, 2, 1\n*Nset, nset=Clamp\n1,2,3,6,7,8\n\
         *Surface, type=ELEMENT, name=Inside\nsoft, S2\n2, s4\n*End Part\n"
    );
    let mesh = abaqus::parse(&body).expect("a mesh");
    let volumes: Vec<(&str, &[u32])> = mesh.volumes.iter().map(|(n, e)| (n.as_str(), e.as_slice())).collect();
    assert_eq!(volumes, [("Bone", &[1][..]), ("both", &[0, 1]), ("soft", &[0])]);
    assert_eq!(mesh.surfaces["Clamp"], [[0, 2, 1, 7, 6, 5]]);
    assert_eq!(mesh.surfaces["Inside"], [[0, 1, 3, 5, 9, 8], [1, 4, 3, 11, 13, 9]]);
    // A face between two elements is on no surface, and a set of an instance is of the assembly.
    let inner = body.replace("1,2,3,6,7,8", "2,3,4,7,10,11");
    assert!(!abaqus::parse(&inner).expect("a mesh").surfaces.contains_key("Clamp"));
    let assembly = format!(
        "{body}*Assembly, name=A\n*Instance, name=I, part=P\n*End Instance\n*Elset, elset=_s2, internal, instance=I\n1\n\
         *Surface, type=ELEMENT, name=Wall\n_s2, S3\n*End Assembly\n"
    );
    let mesh = abaqus::parse(&assembly).expect("a mesh");
    assert_eq!(mesh.surfaces["Wall"], [[1, 2, 3, 6, 10, 9]]);
    // gmsh writes faces as elements of plane stress; alone they are a plane model.
    let faces = body
        .replace("*Elset, elset=Bone", "*Element, type=CPS6, elset=Skin\n9, 1,2,3,6,7,8\n*Elset, elset=Bone");
    assert_eq!(abaqus::parse(&faces).expect("a mesh").surfaces["Skin"], [[0, 1, 2, 5, 6, 7]]);
    assert!(refused(&format!("*Node\n{nodes}*Element, type=CPS6\n9, 1,2,3,6,7,8\n")).contains("CPS6"));
}
