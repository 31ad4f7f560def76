//! Checkpoints: bit-identical after reading; damaged, foreign and incomplete files count as absent.

use fem::run::{Sizes, Solved, Store};
use fem::{Load, Obstacle, SolveReport, State};

const SIZES: Sizes = Sizes { nodes: 3, tets: 2, sheet: 1 };

fn solved(pressure_mpa: f64) -> Solved {
    let load = Load {
        pressure_mpa,
        obstacle: Obstacle::Plate { gap_mm: 40.0 },
        gravity_mm_s2: [0.0, -9810.0, 0.0],
        ..Load::default()
    };
    Solved {
        state: State {
            displacement_mm: vec![[0.1, -0.2, 1e-300], [f64::MIN_POSITIVE, 2.0, 3.0], [4.0, 5.0, 6.0]],
            element_pressure_mpa: vec![0.5, -0.25],
            sheet_resultants_n_per_mm: vec![[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]],
            load,
        },
        von_mises_mpa: vec![0.1, 0.2, 0.3],
        contact_force_n: 0.3,
        cavity_volume_mm3: 6711.6,
        clearance_mm: 27.4,
        report: SolveReport {
            factorisations: 5,
            steps: 2,
            cuts: 1,
            residual_n: 1e-9,
            residual: 1e-8,
            seconds: 3.5,
        },
    }
}

#[test]
fn checkpoint_is_bit_identical_and_bound_to_its_loads() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::new(folder.path(), [7; 32]).unwrap();
    let state = solved(0.05);
    assert_eq!(store.load(&state.state.load, SIZES), None);
    store.save(&state).unwrap();
    assert_eq!(store.load(&state.state.load, SIZES), Some(state.clone()));
    assert_eq!(store.load(&solved(0.06).state.load, SIZES), None);
    assert_eq!(store.load(&state.state.load, Sizes { nodes: 4, ..SIZES }), None);
    let other = Store::new(folder.path(), [8; 32]).unwrap();
    assert_eq!(other.load(&state.state.load, SIZES), None, "a checkpoint of another problem");
}

#[test]
fn incomplete_checkpoint_counts_as_absent() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::new(folder.path(), [7; 32]).unwrap();
    let state = solved(0.05);
    store.save(&state).unwrap();
    let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().path()).collect();
    let [file] = &files[..] else { panic!("one file per state, found {files:?}") };
    let whole = std::fs::read(file).unwrap();
    for cut in 0..whole.len() {
        std::fs::write(file, &whole[..cut]).unwrap();
        assert_eq!(store.load(&state.state.load, SIZES), None, "cut at {cut}");
    }
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1;
        std::fs::write(file, &damaged).unwrap();
        assert_eq!(store.load(&state.state.load, SIZES), None, "bit flipped at {at}");
    }
    std::fs::write(file, &whole).unwrap();
    assert_eq!(store.load(&state.state.load, SIZES), Some(state));
}
