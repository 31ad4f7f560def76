//! Checks of meshes and detection of their surfaces.

use super::actuators::model;
use crate::actuator::Actuator;
use crate::mesh::Mesh;
use crate::mesh::diagnostics;
use std::collections::BTreeSet;

/// The reference mesh, to be damaged.
fn sound() -> Mesh {
    let path = model("pneunet/actuator.toml");
    Actuator::read(&path).unwrap().read_mesh(&path).unwrap()
}

#[test]
fn damaged_meshes_are_refused_with_the_place() {
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
fn missing_surface_is_named_with_the_present_ones() {
    let mut file = formats::msh::read(&model("pneunet/mesh.msh")).unwrap();
    file.surfaces.remove("sheet");
    file.surfaces.remove("slot_upper_3");
    let (_, list) = Actuator::read(&model("pneunet/actuator.toml")).unwrap().named(file);
    let text: Vec<String> = list.iter().map(ToString::to_string).collect();
    assert_eq!(text.len(), 2, "{text:?}");
    assert!(text[0].contains("surface sheet") && text[0].contains("cavity"), "{text:?}");
    assert!(text[1].contains("surface slot_upper_3"), "{text:?}");
}

#[test]
fn surfaces_by_position_equal_the_meshers_names() {
    let path = model("pneunet/actuator.toml");
    let actuator = Actuator::read(&path).unwrap();
    let file = formats::msh::read(&path.with_file_name("mesh.msh")).unwrap();
    let found = crate::actuator::locate(&actuator.shape().unwrap(), &file.points_mm, &file.tets);
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
