//! Input files of the simulator: actuator files, meshes, lists of cases. Valid ones are accepted, errors are named.

use crate::actuators::{model, reference, with};
use fem::actuator::{Actuator, NewActuator, NewMaterial, NewShape};
use fem::cases;
use fem::{ContactSettings, NewtonSettings};
use proptest::prelude::*;

#[test]
fn committed_actuators_meshes_and_lists_are_valid() {
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
fn case_lists_contain_the_reference_cases() {
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
fn vanishing_or_overlapping_parts_and_impossible_materials_are_named() {
    for (section, key, value, word) in [
        ("base", "lower_mm", "-0.1", "base.lower_mm"),
        ("slots", "width_mm", "-1.0", "slots.width_mm"),
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
fn all_errors_are_listed_and_unknown_keys_refused() {
    let both = with(&reference(), "base", "lower_mm", "-1.0").replace("poisson = 0.2", "poisson = 2.0");
    assert!(Actuator::parse(&both).unwrap_err().len() >= 2);
    let unknown = reference().replace("[sheet]", "[sheet]\ncolour = \"white\"");
    assert!(Actuator::parse(&unknown).unwrap_err()[0].to_string().contains("colour"));
}

#[test]
fn contact_and_newton_have_defaults() {
    let mut text = reference();
    for section in ["[contact]", "[newton]"] {
        let Some(from) = text.find(section) else { continue };
        let to = text[from + 1..].find("\n[").map_or(text.len(), |length| from + 1 + length);
        text.replace_range(from..to, "");
    }
    let without = Actuator::parse(&text).unwrap();
    assert_eq!((without.contact, without.newton), (ContactSettings::default(), NewtonSettings::default()));
    let some = Actuator::parse(&(text + "\n[contact]\nobstacle_penalty_mpa_per_mm = 2.0\n")).unwrap();
    assert_eq!(
        some.contact,
        ContactSettings { obstacle_penalty_mpa_per_mm: 2.0, ..ContactSettings::default() }
    );
}

#[test]
fn new_actuator_has_a_pressure_for_every_further_cavity_of_its_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = model("shapes/two-chambers/mesh.msh");
    let new = NewActuator {
        name: "two",
        shape: NewShape::Mesh { file: &mesh, fixed: "clamp" },
        hanging: false,
        material: NewMaterial::Shear(0.1),
    };
    let (report, made) = new.create(&folder.path().join("two")).unwrap();
    let read = Actuator::read(&report.actuator).unwrap();
    assert_eq!(read, made);
    assert_eq!(read.pressure_mpa, [("lower".to_owned(), 0.0)].into());
    read.read_mesh(&report.actuator).unwrap();
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
