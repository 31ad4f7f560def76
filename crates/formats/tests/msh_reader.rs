//! The .msh reader on text and binary files of either byte order, and on damaged ones.

use formats::msh;
use proptest::prelude::*;

#[derive(Clone, Copy, Debug)]
enum Style {
    Text,
    Little,
    Big,
}

/// A file being written, number by number.
struct File(Vec<u8>, Style);

impl File {
    fn raw(&mut self, text: &str) -> &mut Self {
        self.0.extend(text.bytes());
        self
    }

    fn ints(&mut self, values: &[i32]) -> &mut Self {
        values.iter().for_each(|v| self.number(v, v.to_le_bytes().to_vec()));
        self
    }

    fn sizes(&mut self, values: &[u64]) -> &mut Self {
        values.iter().for_each(|v| self.number(v, v.to_le_bytes().to_vec()));
        self
    }

    fn doubles(&mut self, values: &[f64]) -> &mut Self {
        values.iter().for_each(|v| self.number(v, v.to_le_bytes().to_vec()));
        self
    }

    fn number(&mut self, value: &impl ToString, mut little: Vec<u8>) {
        match self.1 {
            Style::Text => self.0.extend(format!("{} ", value.to_string()).bytes()),
            Style::Little => self.0.extend(little),
            Style::Big => {
                little.reverse();
                self.0.extend(little);
            }
        }
    }
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
/// gmsh's order of the mid-sides.
const GMSH_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [2, 3], [1, 3]];
const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// One tetrahedron, its first face named both "bottom plate" and "fixed"; node tags 11 to 20.
fn one_tet(style: Style) -> Vec<u8> {
    let mut f = File(Vec::new(), style);
    f.raw("$MeshFormat\n").raw(if matches!(style, Style::Text) { "4.1 0 8\n" } else { "4.1 1 8\n" });
    if !matches!(style, Style::Text) {
        f.ints(&[1]).raw("\n");
    }
    f.raw("$EndMeshFormat\n$PhysicalNames\n3\n2 7 \"bottom plate\"\n2 8 \"fixed\"\n3 9 \"solid\"\n$EndPhysicalNames\n");
    f.raw("$Entities\n").sizes(&[1, 0, 1, 1]);
    f.ints(&[1]).doubles(&[0.0; 3]).sizes(&[0]);
    f.ints(&[4]).doubles(&[0.0; 6]).sizes(&[2]).ints(&[7, -8]).sizes(&[1]).ints(&[3]);
    f.ints(&[5]).doubles(&[0.0; 6]).sizes(&[1]).ints(&[9]).sizes(&[0]);
    f.raw("\n$EndEntities\n$Comments\nnothing $ of interest\n$EndComments\n$Nodes\n").sizes(&[2, 10, 11, 20]);
    f.ints(&[2, 4, 1]).sizes(&[4, 11, 12, 13, 14]);
    for corner in CORNERS {
        f.doubles(&corner).doubles(&[0.5, 0.5]);
    }
    f.ints(&[3, 5, 0]).sizes(&[6, 15, 16, 17, 18, 19, 20]);
    for [a, b] in GMSH_EDGES {
        f.doubles(&std::array::from_fn::<f64, 3, _>(|i| (CORNERS[a][i] + CORNERS[b][i]) / 2.0));
    }
    f.raw("\n$EndNodes\n$Elements\n").sizes(&[3, 3, 1, 3]);
    f.ints(&[0, 1, 15]).sizes(&[1, 1, 11]);
    f.ints(&[2, 4, 9]).sizes(&[1, 2, 11, 12, 13, 15, 16, 17]);
    f.ints(&[3, 5, 11]).sizes(&[1, 3, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20]);
    f.raw("\n$EndElements\n");
    f.0.clone()
}

#[test]
fn text_and_binary_give_the_same_mesh_with_named_surfaces() {
    for style in [Style::Text, Style::Little, Style::Big] {
        let mesh = msh::parse(&one_tet(style)).unwrap_or_else(|e| panic!("{style:?}: {e}"));
        assert_eq!(mesh.points_mm.len(), 10, "{style:?}");
        let tet = mesh.tets[0].map(|n| mesh.points_mm[n as usize]);
        for (k, [a, b]) in EDGES.into_iter().enumerate() {
            let middle: [f64; 3] = std::array::from_fn(|i| (tet[a][i] + tet[b][i]) / 2.0);
            assert_eq!(tet[4 + k], middle, "{style:?}: mid-side {k}");
        }
        assert_eq!(mesh.surfaces.keys().collect::<Vec<_>>(), ["bottom plate", "fixed"], "{style:?}");
        assert_eq!(mesh.volumes["solid"], [0], "{style:?}");
        assert!(mesh.surfaces.values().all(|t| t == &[[0, 1, 2, 4, 5, 6]]), "{style:?}: {:?}", mesh.surfaces);
    }
}

#[test]
fn errors_contain_cause_and_place() {
    let good = String::from_utf8(one_tet(Style::Text)).unwrap();
    let cases = [
        (good.replace("4.1 0 8", "2.2 0 8"), "Mesh.MshFileVersion"),
        (good.replace("4.1 0 8", "4.1 1 4"), "data size 8"),
        (good.replace("$EndNodes", "$Ennodes"), "$EndNodes"),
        (good.replace("3 5 11 1 3", "3 5 29 1 3"), "gmsh element type 29"),
        (good.replace("3 5 11 1 3 11 12 13 14", "3 5 4 1 3 11 12 13 14"), "set order 2"),
        (good.replace("15 16 17 18 19 20 \n$EndE", "15 16 17 18 19 99 \n$EndE"), "tags of nodes"),
        (good.replace("6 15 16 17", "6 15 16 14"), "node 14 again"),
        (good.replace("2 0 0 0.5", "2 0 nan 0.5"), "finite coordinates"),
        (good.replace("\"fixed\"", "fixed"), "double quotes"),
        (good.replace("2 10 11 20", "2 10 11 x"), "a number"),
        ("$Nodes\n".to_owned() + &good, "first section"),
        (String::new(), "$MeshFormat"),
    ];
    for (file, word) in cases {
        assert_ne!(file, good, "{word}: the case does not change the file");
        let problem = msh::parse(file.as_bytes()).unwrap_err().to_string();
        assert!(problem.contains(word), "{word}: {problem}");
    }
}

#[test]
fn announced_counts_do_not_determine_allocations() {
    for (count, huge) in
        [("2 10 11 20", "9999999999999 10 11 20"), ("6 15 16 17", "18446744073709551615 15 16 17")]
    {
        let file = String::from_utf8(one_tet(Style::Text)).unwrap().replace(count, huge);
        assert!(msh::parse(file.as_bytes()).is_err(), "{huge}");
    }
}

proptest! {
    #[test]
    fn damage_never_panics(
        style in 0..3_usize, cut in 1..3000_usize, flips in prop::collection::vec((0..3000_usize, 0..8), 0..6)
    ) {
        let mut file = one_tet([Style::Text, Style::Little, Style::Big][style]);
        for (at, bit) in flips {
            let at = at % file.len();
            file[at] ^= 1_u8 << bit;
        }
        file.truncate(cut);
        if let Ok(mesh) = msh::parse(&file) {
            let nodes = mesh.points_mm.len() as u32;
            let triangles = mesh.surfaces.values().flatten().flatten();
            prop_assert!(mesh.tets.iter().flatten().chain(triangles).all(|n| *n < nodes));
        }
    }

    #[test]
    fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(msh::parse(&bytes).is_err());
    }
}
