//! Finished simulations of other programs. `data/*.frd` were written by CalculiX 2.20 (`ccx -i`): a block of one hexahedron that is
//! sheared, then loaded until an increment fails; and a 20-node hexahedron, a 15-node wedge and a 10-node tetrahedron.

use crate::common::{at_rest, data, quantity, wanted};
use formats::cells::surface;
use formats::results::{self, Assembly, NodalQuantity, Wanted, parse_frd};
use proptest::prelude::*;
use rom::snapshots::FieldKind;
use std::collections::HashMap;
use std::fs;
use std::io::Write;

#[test]
fn an_increment_that_failed_is_left_out_and_named() {
    let run = results::read(&data("cutback.frd")).unwrap();
    let names: Vec<&str> = run.steps.iter().map(|step| step.name.as_str()).collect();
    assert_eq!(names, ["step 1 increment 1", "step 1 increment 2"]);
    assert_eq!(run.steps[1].time, Some(1.0));
    assert!(run.left_out[0].starts_with("step 2 increment 1"), "{:?}", run.left_out);
    assert_eq!(run.points.len(), 8);
    assert_eq!(quantity(&run, 0, "DISP").values[3 * 5..3 * 6], [0.1, -8.98957e-3, -1.46767e-2]);
    assert_eq!(quantity(&run, 0, "STRESS").components, ["SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"]);
}

#[test]
fn states_have_nodes_stress_and_further_fields_in_the_given_units() {
    let run = results::read(&data("cutback.frd")).unwrap();
    let fields = vec![("ENER".to_owned(), "mJ/mm3".to_owned()), ("STRESS.SXX".to_owned(), "MPa".to_owned())];
    let wanted = Wanted { length_mm: 1000.0, stress_mpa: Some(1e-3), fields, ..wanted() };
    let mut assembly = Assembly::new(wanted);
    let path = data("cutback.frd");
    assert_eq!(assembly.add(&path, &run, &run.steps[0], at_rest("a")).unwrap(), None);
    let (database, blocks) = assembly.finish("block".into(), vec![]).unwrap();
    let names: Vec<&str> = database.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, ["x", "y", "z", "displacement", "von_mises", "ener", "stress_sxx"]);
    let row = &database.snapshot(0)[7 * 5..7 * 6];
    let u = [0.1, -8.98957e-3, -1.46767e-2_f64].map(|v| 1000.0 * v);
    let s = [2.50157e-1, 2.71094e-1, 2.19464e-1, -1.68821e-2, -6.75334e-3, 5.49470e-2_f64];
    let normal = (s[0] - s[1]).powi(2) + (s[1] - s[2]).powi(2) + (s[2] - s[0]).powi(2);
    let von_mises = (0.5 * normal + 3.0 * s[3..].iter().map(|v| v * v).sum::<f64>()).sqrt();
    let size = u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let expected = [1000.0 + u[0], u[1], 1000.0 + u[2], size, 1e-3 * von_mises, 1.36296e-3, s[0]];
    for (found, expected) in row.iter().zip(expected) {
        assert!((f64::from(*found) - expected).abs() <= 1e-6 * expected.abs(), "{found} {expected}");
    }
    assert_eq!((blocks[0].kind, blocks[0].count()), (12, 1));
}

#[test]
fn quadratic_cells_have_a_closed_surface_around_their_volume() {
    let run = results::read(&data("quadratic.frd")).unwrap();
    let kinds: Vec<(u8, usize)> = run.blocks.iter().map(|block| (block.kind, block.count())).collect();
    assert_eq!(kinds, [(25, 1), (26, 1), (24, 1)]);
    let skin = surface(&run.points, &run.blocks);
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    let mut volume = 0.0;
    for [a, b, c] in &skin {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((*from.min(to), *from.max(to))).or_default() += if from < to { 1 } else { -1 };
        }
        let [p, q, r] = [a, b, c].map(|node| run.points[*node as usize]);
        let cross = [q[1] * r[2] - q[2] * r[1], q[2] * r[0] - q[0] * r[2], q[0] * r[1] - q[1] * r[0]];
        volume += (0..3).map(|k| p[k] * cross[k]).sum::<f64>() / 6.0;
    }
    assert!(edges.values().all(|count| *count == 0), "every edge belongs to two triangles of opposite turn");
    assert!((volume - (1.0 + 0.5 + 1.0 / 6.0)).abs() < 1e-12, "{volume}");
}

#[test]
fn unreadable_files_are_refused_with_a_remedy() {
    let good = fs::read(data("cutback.frd")).unwrap();
    let refused = |bytes: &[u8]| parse_frd(bytes).expect_err("refused")[0].to_string();
    assert!(refused(&good[..1000]).contains("did the job end?"), "{}", refused(&good[..1000]));
    assert_eq!(
        parse_frd(&good[..good.len() * 3 / 4]).unwrap().steps.len(),
        1,
        "the second state is cut short"
    );
    let binary = String::from_utf8(good).unwrap().replace(
        "    2C                             8                                     1",
        "    2C                             8                                     3",
    );
    assert!(refused(binary.as_bytes()).contains("*NODE FILE"));
    let dir = tempfile::tempdir().unwrap();
    for (name, part) in [
        ("run.odb", "Abaqus' Python"),
        ("run.h5", "softtwin-convert"),
        ("my run.xdmf", "my run.xdmf' --out '"),
        ("run.case", "save its data as .pvd"),
        ("run", "no ending"),
    ] {
        let path = dir.path().join(name);
        fs::write(&path, "").unwrap();
        let text = results::read(&path).unwrap_err().to_string();
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let run = results::read(&data("cutback.frd")).unwrap();
    let path = data("cutback.frd");
    let refused = |wanted: Wanted| {
        let error =
            Assembly::new(wanted).add(&path, &run, &run.steps[0], at_rest("a")).unwrap_err().to_string();
        assert!(error.contains("cutback.frd"), "{error}");
        error
    };
    let text = refused(Wanted { stress_mpa: None, ..wanted() });
    assert!(text.contains("quantity STRESS: "), "{text}");
    let mut unknown = Assembly::new(Wanted { displacement: Some("U2".into()), ..wanted() });
    let text = unknown.add(&path, &run, &run.steps[0], at_rest("a")).unwrap().unwrap();
    assert!(text.contains("U2") && text.contains("DISP, STRESS, FORC, ENER"), "{text}");
    let text = refused(Wanted { fields: vec![("FORC".into(), "N".into())], ..wanted() });
    assert!(text.contains("F1, F2, F3"), "{text}");
    let mut assembly = Assembly::new(wanted());
    assembly.add(&path, &run, &run.steps[0], at_rest("a")).unwrap();
    let other = results::read(&data("quadratic.frd")).unwrap();
    let text = assembly.add(&path, &other, &other.steps[0], at_rest("b")).unwrap_err().to_string();
    assert!(text.contains("mesh: "), "{text}");
    let mut broken = run.clone();
    broken.steps[1].quantities[0].values[4] = f64::NAN;
    let reason = assembly.add(&path, &broken, &broken.steps[1], at_rest("b")).unwrap();
    assert!(
        reason.is_some_and(|reason| reason.contains("step 1 increment 2: 2 values")),
        "y and the size of one node"
    );
}

#[test]
fn a_length_as_an_input_makes_the_displacement_a_field_of_its_own() {
    let run = results::read(&data("cutback.frd")).unwrap();
    let mut longer = run.clone();
    longer.points.iter_mut().for_each(|point| point[0] *= 1.1);
    let path = data("cutback.frd");
    let mut assembly = Assembly::new(wanted());
    assembly.add(&path, &run, &run.steps[0], at_rest("a")).unwrap();
    assert!(!assembly.shape_varies());
    assembly.add(&path, &longer, &longer.steps[1], at_rest("b")).unwrap();
    assert!(assembly.shape_varies());
    assert_eq!(assembly.finish("block".into(), vec![]).unwrap().0.fields[3].kind, FieldKind::Other);
}

/// A mesh with its results as a table, and as NumPy arrays: both give the same run.
#[test]
fn tables_and_stacks_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let inp = "*NODE\n11,0,0,0\n12,1,0,0\n13,0,1,0\n14,0,0,1\n*ELEMENT,TYPE=C3D4\n1,11,12,13,14\n";
    let csv = "step,time,node,u1,u2,u3,mises\n1,0.5,11,0,0,0,1\n1,0.5,12,0,0,0,2\n1,0.5,13,0,0,0,3\n1,0.5,14,.1,.2,.3,4\n\
               2,1,11,0,0,0,5\n2,1,12,0,0,0,6\n2,1,13,0,0,0,7\n2,1,14,.2,.4,.6,8\n";
    fs::write(dir.path().join("run.inp"), inp).unwrap();
    fs::write(dir.path().join("run.csv"), csv).unwrap();
    let run = results::read(&dir.path().join("run.inp")).unwrap();
    assert_eq!((run.steps.len(), run.steps[1].time), (2, Some(1.0)));
    assert_eq!(quantity(&run, 1, "u").values[9..], [0.2, 0.4, 0.6]);
    assert_eq!(quantity(&run, 1, "mises").values, [5.0, 6.0, 7.0, 8.0]);
    let stack = dir.path().join("stack");
    fs::create_dir(&stack).unwrap();
    let save = |name: &str, shape: &[usize], values: &[f32]| {
        formats::npy::write_f32(&stack.join(name), shape, values).unwrap();
    };
    save("points.npy", &[4, 3], &[0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.]);
    save("tetra.npy", &[1, 4], &[0., 1., 2., 3.]);
    let u = |k: f32| [0., 0., 0., 0., 0., 0., 0., 0., 0., 0.1 * k, 0.2 * k, 0.3 * k];
    save("u.npy", &[2, 4, 3], &[u(1.0), u(2.0)].concat());
    save("mises.npy", &[2, 4], &[1., 2., 3., 4., 5., 6., 7., 8.]);
    let stacked = results::read(&stack).unwrap();
    assert_eq!((&stacked.points, &stacked.blocks), (&run.points, &run.blocks));
    assert_eq!(quantity(&stacked, 1, "mises").values, quantity(&run, 1, "mises").values);
    let archive = dir.path().join("stack.npz");
    let mut zip = zip::ZipWriter::new(fs::File::create(&archive).unwrap());
    for (at, name) in ["points", "tetra", "u", "mises"].iter().enumerate() {
        let method = [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated][at % 2];
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(&fs::read(stack.join(format!("{name}.npy"))).unwrap()).unwrap();
    }
    zip.finish().unwrap();
    assert_eq!(results::read(&archive).unwrap(), stacked);
    let bytes = fs::read(&archive).unwrap();
    fs::write(&archive, &bytes[..bytes.len() / 2]).unwrap();
    let text = results::read(&archive).unwrap_err().to_string();
    assert!(text.contains("stack.npz: archive: "), "{text}");
    fs::write(dir.path().join("run.csv"), csv.replace("1,0.5,14", "1,0.6,14")).unwrap();
    let text = results::read(&dir.path().join("run.inp")).unwrap_err().to_string();
    assert!(text.contains("run.csv: line 5, column time: "), "{text}");
    fs::write(dir.path().join("run.csv"), csv.replace("1,0.5,14", "1,0.5,15")).unwrap();
    let text = results::read(&dir.path().join("run.inp")).unwrap_err().to_string();
    assert!(text.contains("run.csv: line 5, column node: ") && text.ends_with("found `15`"), "{text}");
}

/// The same node or column twice, with another value or with the same; a second instance; a part without stress.
#[test]
fn repeated_nodes_are_refused_unless_equal_and_instances_told_apart() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let part = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n";
    let rows = "node,u1,u2,u3,mises\n1,0,0,0,1\n2,0,0,0,2\n3,0,0,0,3\n4,.1,.2,.3,4\n";
    let read = || results::read(&dir.path().join("run.inp"));
    write("run.inp", part);
    write("run.csv", &format!("{rows}4,.1,.2,.3,4.000000001\n"));
    assert_eq!(quantity(&read().unwrap(), 0, "mises").values[..3], [1.0, 2.0, 3.0]);
    write("run.csv", &format!("{rows}4,.1,.2,.3,5\n"));
    let text = read().unwrap_err().to_string();
    assert!(text.contains("line 6, column mises") && text.contains("line 5"), "{text}");
    write("run.csv", &rows.replace("u3", "u2"));
    assert!(read().unwrap_err().to_string().contains("`u2`"));
    let assembly = "*ASSEMBLY,NAME=A\n*INSTANCE,NAME=L,PART=P\n*END INSTANCE\n*INSTANCE,NAME=R,PART=P\n0,0,9\n*END INSTANCE\n*END ASSEMBLY\n";
    write("run.inp", &format!("*PART,NAME=P\n{part}*END PART\n{assembly}"));
    write("run.csv", rows);
    assert!(read().unwrap_err().to_string().contains("instance"));
    let of = |name: &str| rows.lines().skip(1).map(|row| format!("{name},{row}\n")).collect::<String>();
    write(
        "run.csv",
        &format!("instance,node,u1,u2,u3,mises\n{}{}", of("r"), of("l").replace(",4\n", ",8\n")),
    );
    let run = read().unwrap();
    assert_eq!(quantity(&run, 0, "mises").values, [1.0, 2.0, 3.0, 8.0, 1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn parts_without_values_and_steps_without_a_quantity_are_left_out_and_named() {
    let run = results::read(&data("cutback.frd")).unwrap();
    let nodes = run.points.len();
    // A second block far away, without stress, as a rigid plate.
    let mut two = run.clone();
    two.points.extend(run.points.iter().map(|p| [p[0] + 1e3, p[1], p[2]]));
    for block in &mut two.blocks {
        let moved: Vec<u32> = block.nodes.iter().map(|node| node + nodes as u32).collect();
        block.nodes.extend(moved);
    }
    for step in &mut two.steps {
        for quantity in &mut step.quantities {
            let blank = if quantity.name == "STRESS" { f64::NAN } else { 0.0 };
            quantity.values.extend(vec![blank; nodes * quantity.components.len()]);
        }
    }
    let path = data("cutback.frd");
    let mut assembly = Assembly::new(wanted());
    let mut bare = two.steps[0].clone();
    bare.quantities.retain(|quantity| quantity.name != "DISP");
    let reason = assembly.add(&path, &two, &bare, at_rest("bare")).unwrap();
    assert!(reason.is_some_and(|reason| reason.contains("displacement")));
    assert_eq!(assembly.add(&path, &two, &two.steps[0], at_rest("a")).unwrap(), None);
    assert_eq!((assembly.nodes(), assembly.parts_left_out().len()), (nodes, 1));
    assert!(assembly.parts_left_out()[0].contains("STRESS"));
    let mut alone = Assembly::new(wanted());
    alone.add(&path, &run, &run.steps[0], at_rest("a")).unwrap();
    let [(both, cells), (one, expected)] =
        [assembly, alone].map(|assembly| assembly.finish("block".into(), vec![]).unwrap());
    assert_eq!((both.snapshots, cells), (one.snapshots, expected));
}

#[test]
fn a_quantity_twice_in_a_step_is_no_state_unless_equal() {
    let mut run = results::read(&data("cutback.frd")).unwrap();
    let path = data("cutback.frd");
    let mut stress = quantity(&run, 0, "STRESS").clone();
    run.steps[0].quantities.push(stress.clone());
    let add =
        |run: &results::Run| Assembly::new(wanted()).add(&path, run, &run.steps[0], at_rest("a")).unwrap();
    assert_eq!(add(&run), None);
    stress.values[0] += 1.0;
    run.steps[0].quantities.push(stress);
    assert!(add(&run).is_some_and(|reason| reason.contains("STRESS")));
}

/// The names of files in a list are XML: `&amp;` is `&`.
#[test]
fn names_in_a_list_are_unescaped() {
    let entry = |file: &str| {
        format!("<VTKFile><Collection><DataSet timestep=\"1\" file=\"{file}\"/></Collection></VTKFile>")
    };
    let listed = results::parse_pvd(&entry("a &amp; b/&lt;1&gt; &#39;x&#x27;.vtu")).unwrap();
    assert_eq!(listed, [(1.0, "a & b/<1> 'x'.vtu".to_owned())]);
    let set = |time: &str| format!("<DataSet timestep=\"{time}\" file=\"a.vtu\"/>");
    let list =
        |times: [&str; 3]| format!("<VTKFile><Collection>{}</Collection></VTKFile>", times.map(set).concat());
    assert_eq!(results::parse_pvd(&list(["0", "1", "2"])).unwrap().len(), 3);
    assert!(results::parse_pvd(&list(["0", "1", "-0"])).is_err(), "two parts at one time");
}

proptest! {
    /// Columns and rows in any order, with rows repeated to rounding: every value is at its node. One repeated with another value is
    /// refused, as is a column twice.
    #[test]
    fn tables_have_their_values_at_their_nodes(
        order in Just((0..6).collect::<Vec<usize>>()).prop_shuffle(),
        rows in prop::collection::vec(0_usize..4, 0..6),
        rest in Just(vec![0_usize, 1, 2, 3]).prop_shuffle(),
        upper in any::<bool>(),
        seed in prop::collection::vec(-1e3_f64..1e3, 16),
        changed in 0_usize..4,
    ) {
        let names = ["node", "step", "u1", "u2", "u3", "mises"];
        let value = |node: usize, column: usize| match column {
            0 => (11 + node) as f64,
            1 => 1.0,
            _ => seed[4 * node + column - 2],
        };
        let row = |node: usize, add: f64| {
            let cells = order.iter().map(|c| if *c == 5 { value(node, *c) + add } else { value(node, *c) });
            cells.map(|cell| cell.to_string()).collect::<Vec<_>>().join(",") + "\n"
        };
        let header: Vec<String> =
            order.iter().map(|c| if upper { names[*c].to_uppercase() } else { names[*c].to_owned() }).collect();
        let nodes: Vec<usize> = rows.iter().chain(&rest).copied().collect();
        let table = header.join(",") + "\n" + &nodes.iter().map(|node| row(*node, 0.0)).collect::<String>();
        let dir = tempfile::tempdir().unwrap();
        let inp = "*NODE\n11,0,0,0\n12,1,0,0\n13,0,1,0\n14,0,0,1\n*ELEMENT,TYPE=C3D4\n1,11,12,13,14\n";
        fs::write(dir.path().join("run.inp"), inp).unwrap();
        let read = |table: &str| {
            fs::write(dir.path().join("run.csv"), table).unwrap();
            results::read(&dir.path().join("run.inp"))
        };
        let run = read(&table).unwrap();
        let named = |name: &str| if upper { name.to_uppercase() } else { name.to_owned() };
        for node in 0..4 {
            let u = quantity(&run, 0, &named("u"));
            prop_assert_eq!(&u.values[3 * node..3 * node + 3], &seed[4 * node..4 * node + 3]);
            prop_assert_eq!(quantity(&run, 0, &named("mises")).values[node], seed[4 * node + 3]);
        }
        prop_assert!(read(&(table.clone() + &row(changed, 1.0))).is_err());
        let twice = table.lines().map(|line| format!("{line},{}\n", line.split(',').next().unwrap_or("")));
        prop_assert!(read(&twice.collect::<String>()).is_err());
        prop_assert!(read(&table.replacen(&named("u2"), &named("U1"), 1)).is_err());
    }

    #[test]
    fn damaged_results_are_read_or_refused(at in 0_usize..9000, bytes in prop::collection::vec(any::<u8>(), 0..20)) {
        let mut file = fs::read(data("cutback.frd")).unwrap();
        file.splice(at..(at + bytes.len()).min(file.len()), bytes);
        if let Ok(run) = parse_frd(&file) {
            let nodes = run.points.len();
            prop_assert!(run.blocks.iter().all(|block| block.nodes.iter().all(|node| (*node as usize) < nodes)));
            let sized = |q: &NodalQuantity| q.values.len() == nodes * q.components.len();
            prop_assert!(run.steps.iter().all(|step| step.quantities.iter().all(sized)));
        }
    }
}
