//! What people give the simulator: actuator files, meshes, lists of cases. Sound ones pass, bad ones are refused by name.

use super::actuators::{reference, with};
use crate::actuator::Actuator;
use crate::cases;
use crate::mesh::Mesh;
use crate::mesh::diagnostics;
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn model(file: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models")).join(file)
}

#[test]
fn the_committed_actuators_meshes_and_lists_are_sound() {
    for name in ["pneunet", "gripper"] {
        let path = model(name).join("actuator.toml");
        let actuator = Actuator::read(&path).unwrap();
        let mesh = actuator.read_mesh(&path).unwrap();
        assert_eq!(mesh.nodes_mm.len(), 25_022, "{name}");
        assert_eq!(mesh.slots.len(), 10, "{name}");
        cases::read(&model(name).join("cases.csv")).unwrap();
    }
    Actuator::read(&model("cylinder/actuator.toml")).unwrap();
    let count = |list: &str| cases::read(&model("cylinder").join(list)).unwrap().len();
    assert_eq!((count("cases.csv"), count("sealed.csv")), (60, 20));
}

#[test]
fn every_case_of_the_list_is_where_the_issue_wants_it() {
    let list = cases::read(&model("pneunet/cases.csv")).unwrap();
    let count =
        |regime: &str, split: &str| list.iter().filter(|c| c.regime == regime && c.split == split).count();
    assert_eq!((count("free", "test"), count("contact", "test")), (2, 2));
    assert!(count("free", "train") >= 17 + 2 && count("contact", "train") >= 85 + 3);
    assert!(list.iter().any(|c| c.pressure_mpa == 0.0 && c.gap_mm.is_none()), "rest");
    assert!(["A", "B", "C", "D", "E", "F", "G", "H"].iter().all(|n| list.iter().any(|c| c.name == *n)));
    let gripper = cases::read(&model("gripper/cases.csv")).unwrap();
    assert_eq!(gripper.iter().filter(|c| c.split != "check").count(), 32 + 2);
}

#[test]
fn parts_that_vanish_or_overlap_and_impossible_materials_are_named() {
    for (section, key, value, word) in [
        ("base", "lower_mm", "0.0", "base.lower_mm"),
        ("body", "pocket_mm", "2.5", "body.pocket_mm"),
        ("body", "width_mm", "40.0", "body.width_mm"),
        ("body", "length_mm", "120.0", "base.length_mm"),
        ("chambers", "count", "0", "chambers.count"),
        ("chambers", "count", "12", "body.length_mm"),
        ("chambers", "length_mm", "8.5", "slots.width_mm"),
        ("chambers", "top_mm", "19.0", "chambers.top_mm"),
        ("chambers", "width_mm", "20.0", "chambers.width_mm"),
        ("chambers", "first_mm", "nan", "chambers.first_mm"),
        ("slots", "floor_mm", "5.0", "slots.floor_mm"),
        ("channels", "width_mm", "15.0", "channels.width_mm"),
        ("channels", "top_mm", "3.0", "channels.top_mm"),
        ("elastomer.law", "mu_mpa", "-0.8", "mu_mpa"),
        ("elastomer.law", "jm", "0.0", "jm"),
        ("sheet", "poisson", "0.6", "poisson"),
        ("obstacle", "x_mm", "[120.0, 0.0]", "obstacle.x_mm"),
        ("loads", "gravity_mm_s2", "[0.0, inf, 0.0]", "gravity_mm_s2"),
    ] {
        let list = Actuator::parse(&with(&reference(), section, key, value)).unwrap_err();
        assert!(list.iter().any(|p| p.to_string().contains(word)), "{key} = {value}: {list:?}");
    }
}

#[test]
fn all_problems_come_at_once_and_unknown_keys_are_refused() {
    let both = with(&reference(), "base", "lower_mm", "-1.0").replace("poisson = 0.2", "poisson = 2.0");
    assert!(Actuator::parse(&both).unwrap_err().len() >= 2);
    let unknown = reference().replace("[sheet]", "[sheet]\ncolour = \"white\"");
    assert!(Actuator::parse(&unknown).unwrap_err()[0].to_string().contains("colour"));
}

/// The reference mesh, to be damaged.
fn sound() -> Mesh {
    let path = model("pneunet/actuator.toml");
    Actuator::read(&path).unwrap().read_mesh(&path).unwrap()
}

#[test]
fn damaged_meshes_are_refused_with_what_and_where() {
    let good = sound();
    type Damage = (&'static str, fn(&mut Mesh));
    let damage: [Damage; 7] = [
        ("positive volume", |m| {
            let tet = &mut m.tets[7];
            *tet = [tet[1], tet[0], tet[2], tet[3], tet[4], tet[6], tet[5], tet[8], tet[7], tet[9]];
        }),
        ("every element once", |m| m.tets.push(m.tets[3])),
        ("straight edges", |m| m.nodes_mm[m.tets[5][6] as usize][1] += 1.0),
        ("every node in a tetrahedron", |m| m.nodes_mm.push([1.0, 2.0, 3.0])),
        ("one connected body", |m| {
            let first = m.nodes_mm.len() as u32;
            let copy = m.tets[0].map(|n| m.nodes_mm[n as usize].map(|v| v + 500.0));
            m.nodes_mm.extend(copy);
            m.tets.push(std::array::from_fn(|i| first + i as u32));
        }),
        ("faces of tetrahedra", |m| m.bottom[0].swap(0, 3)),
        ("larger indices", |m| m.tets[0][0] = u32::MAX),
    ];
    assert!(diagnostics(&good).is_empty());
    for (word, spoil) in damage {
        let mut mesh = good.clone();
        spoil(&mut mesh);
        let list = diagnostics(&mesh);
        assert!(list.iter().any(|p| p.to_string().contains(word)), "{word}: {list:?}");
    }
}

#[test]
fn a_missing_surface_is_named_with_those_that_are_there() {
    let mut file = formats::msh::read(&model("pneunet/mesh.msh")).unwrap();
    file.surfaces.remove("sheet");
    file.surfaces.remove("slot_upper_3");
    let (_, list) = crate::actuator::named(file, 10);
    let text: Vec<String> = list.iter().map(ToString::to_string).collect();
    assert_eq!(text.len(), 2, "{text:?}");
    assert!(text[0].contains("surface sheet") && text[0].contains("cavity"), "{text:?}");
    assert!(text[1].contains("surface slot_upper_3"), "{text:?}");
}

#[test]
fn surfaces_are_found_where_the_mesher_named_them() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pneunet/actuator.toml"));
    let actuator = Actuator::read(path).unwrap();
    let file = formats::msh::read(&path.with_file_name("mesh.msh")).unwrap();
    let found = crate::actuator::locate(&actuator, &file.points_mm, &file.tets);
    assert_eq!(found.keys().collect::<Vec<_>>(), file.surfaces.keys().collect::<Vec<_>>());
    let keys = |tris: &[[u32; 6]]| -> BTreeSet<[u32; 3]> {
        let corners = |t: &[u32; 6]| {
            let mut key = [t[0], t[1], t[2]];
            key.sort_unstable();
            key
        };
        tris.iter().map(corners).collect()
    };
    for (name, named) in &file.surfaces {
        assert_eq!(keys(named), keys(&found[name]), "{name}");
    }
}

#[test]
fn lists_of_cases_are_checked_row_by_row() {
    let head = "case,regime,split,pressure_mpa,gap_mm\n";
    let good =
        "# a comment\ncase,regime,split,pressure_mpa,gap_mm\na,free,train,0.01,\nb,contact,check,0.02,30\n";
    let list = cases::parse(good).unwrap();
    assert_eq!((list[0].gap_mm, list[1].gap_mm), (None, Some(30.0)));
    assert_eq!(cases::parse(&cases::to_csv(&list)).unwrap(), list);
    for (rows, word) in [
        ("a,free,train,-0.01,\n", "pressure of 0 to 10 MPa"),
        ("a,free,train,nan,\n", "pressure of 0 to 10 MPa"),
        ("a,free,train,35,\n", "pressure of 0 to 10 MPa"),
        ("a,contact,train,0.01,\n", "gap above 0"),
        ("a,contact,train,0.01,-3\n", "gap above 0"),
        ("a,free,train,0.01,40\n", "no gap"),
        ("a,bent,train,0.01,\n", "free, contact or gripper"),
        ("a,free,learn,0.01,\n", "train, test or check"),
        ("../a,free,train,0.01,\n", "a name"),
        ("a,free,train,0.01,\na,free,train,0.02,\n", "every name once"),
        ("a,free,train,0.01,\nb,free,test,0.01,\n", "every state once"),
        ("", "at least one case"),
    ] {
        let list = cases::parse(&(head.to_owned() + rows)).unwrap_err();
        assert!(list.iter().any(|p| p.to_string().contains(word)), "{rows}: {list:?}");
    }
    assert_eq!(cases::parse("case,regime\n").unwrap_err().len(), 3);
}

proptest! {
    #[test]
    fn noise_is_refused_without_a_panic(text in ".{0,300}") {
        prop_assert!(cases::parse(&text).is_err());
        prop_assert!(Actuator::parse(&text).is_err());
    }
}
