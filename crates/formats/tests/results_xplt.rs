//! FEBio's plot files. No FEBio was at hand: `scripts/checks/xplt_fixtures.py` wrote `data/*.xplt` in the form that FEBio Studio
//! reads, and febio-python, which nobody here wrote, read the plain one as it was meant.

use crate::common::{data, quantity};
use formats::cells::surface;
use formats::results::{self, Quantity, parse_xplt};
use proptest::prelude::*;
use std::fs;

#[test]
fn states_that_converged_are_read_with_means_at_the_nodes() {
    let run = results::read(&data("plain.xplt")).unwrap();
    let kinds: Vec<(u8, usize)> = run.blocks.iter().map(|block| (block.kind, block.count())).collect();
    assert_eq!(
        (run.points.len(), run.points[13], kinds),
        (29, [1.0, 0.5, 3.0], vec![(12, 2), (13, 1), (24, 1)])
    );
    let times: Vec<Option<f64>> = run.steps.iter().map(|step| step.time).collect();
    assert_eq!(times, [Some(0.0), Some(0.5), Some(1.0)]);
    assert_eq!(run.left_out, ["step 3: not converged (status 1)"]);
    let u = quantity(&run, 2, "displacement");
    let expected = [2.8, -1.4, 7.84_f32].map(f64::from);
    assert_eq!((u.components.len(), &u.values[3 * 28..]), (3, &expected[..]));
    let stress = quantity(&run, 2, "stress");
    assert_eq!(stress.components, ["xx", "yy", "zz", "xy", "yz", "xz"]);
    // One element, two of a domain, two of two domains, the tetrahedron with a node within it.
    let along = |node: usize| stress.values[6 * node];
    assert_eq!([0, 4, 8, 13, 28].map(along), [1.0, 1.5, 2.0, 2.0, 3.0]);
    // Given at the nodes of a domain in the order of its elements, and at the corners of each element under a name of the user's.
    let density = &quantity(&run, 1, "density").values;
    assert!((0..29).all(|node| density[node] == 10.0 * node as f64), "{density:?}");
    let flux = &quantity(&run, 1, "own flux").values;
    assert!((0..29).all(|node| flux[3 * node] == node as f64), "{flux:?}");
    assert_eq!((flux[3 * 4 + 1], flux[3 * 4 + 2], flux[3 * 8 + 1]), (0.0, 0.5, 0.5));
    assert!(
        run.steps[0].quantities.iter().all(|quantity| quantity.name != "strain energy"),
        "a number a domain is no field"
    );
    assert!(!surface(&run.points, &run.blocks).is_empty());
}

#[test]
fn compressed_states_are_the_same() {
    assert_eq!(results::read(&data("compressed.xplt")).unwrap(), results::read(&data("plain.xplt")).unwrap());
}

#[test]
fn the_other_byte_order_is_read() {
    let bytes = fs::read(data("plain.xplt")).unwrap();
    // All but texts is made of words.
    let swapped: Vec<u8> =
        bytes.chunks(4).flat_map(|word| word.iter().rev().copied().collect::<Vec<u8>>()).collect();
    let run = parse_xplt(&swapped[..swapped.len() / 4 * 4]);
    assert!(run.is_ok_and(|run| run.points.len() == 29 && run.steps.len() == 3));
}

#[test]
fn a_file_that_was_cut_short_keeps_its_whole_states() {
    for name in ["plain.xplt", "compressed.xplt"] {
        let bytes = fs::read(data(name)).unwrap();
        let run = parse_xplt(&bytes[..bytes.len() - 10]).unwrap();
        assert_eq!(run.steps.len(), 2, "{name}");
        assert!(run.left_out[1].contains("step 4: the file ends within it"), "{:?}", run.left_out);
    }
}

/// The file with one word of it replaced.
fn with(at: &[u32], offset: usize, word: u32) -> Vec<u8> {
    let mut bytes = fs::read(data("plain.xplt")).unwrap();
    let words: Vec<u8> = at.iter().flat_map(|word| word.to_le_bytes()).collect();
    let place =
        bytes.windows(words.len()).position(|window| window == words).expect("these words") + 4 * offset;
    bytes[place..place + 4].copy_from_slice(&word.to_le_bytes());
    bytes
}

#[test]
fn what_cannot_be_read_is_refused_with_its_place_and_what_helps() {
    let refused = |bytes: &[u8]| parse_xplt(bytes).expect_err("refused").to_string();
    assert!(refused(b"BFE\0").contains("byte 0: expected FEBio's tag"));
    let text = refused(&with(&[0x0101_0001, 4, 0x34], 2, 8));
    assert!(text.contains("version 0.8") && text.contains("FEBio Studio"), "{text}");
    let text = refused(&with(&[0x0104_2102, 4, 8], 2, 14));
    assert!(text.contains("mesh, domain 3: expected tet4") && text.contains("elements tet20"), "{text}");
    let text = refused(&with(&[0x0104_2201, 36, 1], 3, 99));
    assert!(
        text.contains("mesh, domain 1: expected elements of 8 nodes, each below 29, found node 99"),
        "{text}"
    );
    let text = refused(&with(&[0x0104_2201, 36, 1], 3, 1));
    assert!(text.contains("a node several times in element 1 of the domain"), "{text}");
    let text = refused(&with(&[0x0104_1101, 4, 29], 2, 28));
    assert!(text.contains("mesh, nodes: expected 28 nodes of 3 coordinates, found 116 numbers"), "{text}");
    let text = refused(&with(&[0x0202_0002, 4, 2], 2, 3));
    assert!(
        text.contains("step 1: expected a quantity from 1 to 2, as many as the dictionary has, found 3"),
        "{text}"
    );
    let text = refused(&with(&[0x0102_0002, 4, 1], 2, 2));
    assert!(text.contains("step 1, quantity displacement: expected 174 numbers, found 87"), "{text}");
    let bytes = fs::read(data("plain.xplt")).unwrap();
    assert!(refused(&bytes[..700]).contains("expected a whole section (was the job stopped at its start?)"));
}

/// A state that would expand beyond what mesh and dictionary allow is not expanded.
#[test]
fn a_state_longer_than_its_mesh_allows_is_left_out() {
    let plain = fs::read(data("compressed.xplt")).unwrap();
    let head = plain.windows(2).rposition(|pair| pair == [0x78, 0x9c]).expect("a zlib stream");
    let mut encoder = flate2::write::ZlibEncoder::new(plain[..head].to_vec(), flate2::Compression::best());
    for _ in 0..100 {
        std::io::Write::write_all(&mut encoder, &[0; 1 << 20]).unwrap();
    }
    let run = parse_xplt(&encoder.finish().unwrap()).unwrap();
    assert!(run.left_out.last().is_some_and(|reason| reason.contains("it is damaged")), "{:?}", run.left_out);
}

proptest! {
    #[test]
    fn damaged_plot_files_are_read_or_refused(
        compressed in any::<bool>(),
        at in 0_usize..7600,
        bytes in prop::collection::vec(any::<u8>(), 0..20),
    ) {
        let mut file = fs::read(data(if compressed { "compressed.xplt" } else { "plain.xplt" })).unwrap();
        let at = at.min(file.len());
        file.splice(at..(at + bytes.len()).min(file.len()), bytes);
        if let Ok(run) = parse_xplt(&file) {
            let nodes = run.points.len();
            prop_assert!(run.blocks.iter().all(|block| block.nodes.iter().all(|node| (*node as usize) < nodes)));
            let sized = |q: &Quantity| q.values.len() == nodes * q.components.len();
            prop_assert!(run.steps.iter().all(|step| step.quantities.iter().all(sized)));
        }
    }
}
