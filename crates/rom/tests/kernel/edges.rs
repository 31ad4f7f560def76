//! Refused descriptions, and inputs at the limits.

use super::cases::{Body, available};
use rom::kernel::{
    Affine, BasisError, Field, FieldSource, Isa, MAX_ROWS, Modes, NotFinite, Precision, Role, Spec,
};
use rom::reconstructor::{Basis, ReconstructError};

const ALL: [bool; 5] = [true; 5];

fn error(spec: &Spec<'_>) -> BasisError {
    Basis::build(spec, Some(Precision::F32)).unwrap_err()
}

/// One plain field of one node with the first `count` of these modes.
fn single(modes: &Modes, count: usize) -> Spec<'_> {
    let source = FieldSource::Affine(Affine { mean: None, modes, coefficients: 0..count });
    Spec { node_count: 1, nodes: None, fields: vec![Field { source, role: Role::Plain, published: true }] }
}

/// Modes of one node, all 1.
fn ones(count: usize) -> Modes {
    Modes::new(Precision::F32, 1, count, |_, _| 1.0).unwrap()
}

#[test]
fn invalid_node_sets_are_refused() {
    let body = Body::new(20, 2, 1, Precision::F32);
    assert_eq!(error(&body.spec(ALL, Some(&[]))), BasisError::NodeCount { found: 0 });
    assert_eq!(error(&body.spec(ALL, Some(&[3, 20]))), BasisError::NodeIndex { node: 20, node_count: 20 });
    assert_eq!(error(&body.spec([false; 5], None)), BasisError::NothingPublished);
}

#[test]
fn slices_of_wrong_length_are_refused_with_their_field() {
    let mut body = Body::new(20, 2, 1, Precision::F32);
    body.bases[3] = Modes::new(Precision::F32, 19, 2, |_, _| 1.0).unwrap();
    let refused = error(&body.spec(ALL, None));
    assert_eq!(refused, BasisError::Length { field: 4, what: "a mode", found: 19, expected: 20 });
    body.bases[3] = Modes::new(Precision::F32, 20, 1, |_, _| 1.0).unwrap();
    let refused = error(&body.spec(ALL, None));
    assert_eq!(refused, BasisError::Length { field: 4, what: "the list of modes", found: 1, expected: 2 });
    body.means[1].push(0.0);
    assert!(matches!(error(&body.spec(ALL, None)), BasisError::Length { field: 1, what: "the mean", .. }));
}

#[test]
fn contradictory_magnitudes_and_roles_are_refused() {
    let body = Body::new(20, 2, 1, Precision::F32);
    for coordinates in [[0, 1, 1], [0, 1, 3], [0, 1, 9]] {
        let mut spec = body.spec(ALL, None);
        if let FieldSource::Magnitude { coordinates: c, .. } = &mut spec.fields[3].source {
            *c = coordinates;
        }
        assert_eq!(error(&spec), BasisError::Magnitude { field: 3 });
    }
    let mut spec = body.spec(ALL, None);
    spec.fields[0].role = Role::Stress;
    assert_eq!(error(&spec), BasisError::DuplicateRole { field: 4, role: Role::Stress });
}

#[test]
fn values_outside_f32_are_refused_with_their_node() {
    for value in [f64::NAN, f64::INFINITY, 1e300] {
        for precision in [Precision::F32, Precision::Integers] {
            let at = |mode: usize, node: usize| if (mode, node) == (1, 17) { value } else { 0.0 };
            let NotFinite { node, .. } = Modes::new(precision, 40, 2, at).unwrap_err();
            assert_eq!(node, 17);
        }
    }
    let mut body = Body::new(40, 2, 1, Precision::F32);
    body.means[1][17] = f32::NAN;
    let refused = error(&body.spec(ALL, None));
    assert!(matches!(refused, BasisError::NotFinite { field: 1, node: 17, .. }), "{refused}");
}

#[test]
fn too_many_rows_are_refused() {
    let modes = ones(MAX_ROWS + 1);
    assert!(Basis::build(&single(&modes, MAX_ROWS), Some(Precision::F32)).is_ok());
    let refused = error(&single(&modes, MAX_ROWS + 1));
    assert_eq!(refused, BasisError::Rows { found: MAX_ROWS + 1 });
}

#[test]
fn missing_instruction_set_is_refused() {
    let modes = ones(1);
    for isa in Isa::ALL {
        let built = Basis::build_for(&single(&modes, 1), Some(Precision::F32), isa);
        assert_eq!(built.is_ok(), isa.is_available());
    }
}

#[test]
fn wrong_lengths_write_nothing() {
    let body = Body::new(20, 2, 1, Precision::F32);
    let basis = Basis::build(&body.spec(ALL, None), Some(Precision::F32)).unwrap();
    let mut out = vec![7.0; 99];
    let refused = basis.reconstruct(&body.coefficients, &mut out).unwrap_err();
    assert_eq!(refused, ReconstructError::Output { found: 99, expected: 100 });
    let mut out = vec![7.0; 100];
    let refused = basis.reconstruct(&body.coefficients[..7], &mut out).unwrap_err();
    assert_eq!(refused, ReconstructError::Coefficients { found: 7, expected: 10 });
    assert!(out.iter().all(|&v| v == 7.0));
}

#[test]
fn nan_is_written_and_ignored_by_peaks() {
    let mut body = Body::new(20, 2, 1, Precision::F32);
    body.coefficients[7] = f64::NAN; // the last mode of the stress
    for isa in available() {
        let basis = Basis::build_for(&body.spec(ALL, None), Some(Precision::F32), isa).unwrap();
        let mut out = vec![0.0; 100];
        let peaks = basis.reconstruct(&body.coefficients, &mut out).unwrap();
        assert!(out[80..].iter().all(|v| v.is_nan()) && out[..80].iter().all(|v| v.is_finite()), "{isa}");
        assert_eq!(peaks.stress_mpa.unwrap().value, f32::NEG_INFINITY);
        assert!(peaks.displacement_mm.unwrap().value > 0.0);
    }
}

#[test]
fn fields_of_a_joint_pod_share_coefficients() {
    // Two fields of two nodes, as the paper stacks X, Y, Z, U, S.
    let values = [[1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0, 40.0]];
    let of_field = |field: usize| Modes::new(Precision::F32, 2, 2, |k, i| values[k][2 * field + i]).unwrap();
    let modes = [of_field(0), of_field(1)];
    let field = |at: usize| Field {
        source: FieldSource::Affine(Affine { mean: None, modes: &modes[at], coefficients: 1..3 }),
        role: Role::Plain,
        published: true,
    };
    let spec = Spec { node_count: 2, nodes: None, fields: vec![field(0), field(1)] };
    let basis = Basis::build(&spec, Some(Precision::F32)).unwrap();
    let mut out = [0.0; 4];
    let peaks = basis.reconstruct(&[9.0, 1.0, 0.5], &mut out).unwrap();
    assert_eq!(out, [6.0, 12.0, 18.0, 24.0]);
    assert_eq!((peaks.displacement_mm, peaks.stress_mpa), (None, None));
}

#[test]
fn bytes_are_those_of_the_modes_in_use_and_of_means_shifts_and_rest_shape() {
    let bytes = |precision, published| {
        let body = Body::new(64, 3, 1, precision);
        let basis = Basis::build(&body.spec(published, None), Some(precision)).unwrap();
        (basis.bytes(), basis.memory_bytes())
    };
    let constant = 256;
    for (precision, mode) in [(Precision::F32, 256), (Precision::Integers, 128)] {
        let cases = [
            // One shift per coordinate; a coordinate that only the magnitude needs has no rest row.
            ([false, false, false, true, false], 3 * (3 * mode + 2 * constant)),
            ([true, true, true, true, false], 3 * (3 * mode + 3 * constant)),
            ([true, true, true, false, false], 3 * (3 * mode + constant)),
            ([false, false, false, false, true], 3 * mode + constant),
        ];
        for (published, expected) in cases {
            assert_eq!(bytes(precision, published), (expected, expected), "{published:?}");
        }
    }
    let body = Body::new(64, 3, 1, Precision::Integers);
    let mut spec = body.spec([false, false, false, false, true], None);
    if let FieldSource::Affine(affine) = &mut spec.fields[4].source {
        affine.coefficients.end -= 2;
    }
    let basis = Basis::build(&spec, Some(Precision::Integers)).unwrap();
    assert_eq!((basis.bytes(), basis.memory_bytes()), (128 + 256, 3 * 128 + 256));
}

#[test]
fn a_basis_in_another_format_has_its_values() {
    let body = Body::new(100, 4, 7, Precision::Integers);
    let spec = body.spec(ALL, None);
    let mut out = [vec![0.0; 500], vec![0.0; 500]];
    for (precision, out) in [Precision::Integers, Precision::F32].into_iter().zip(&mut out) {
        let basis = Basis::build(&spec, Some(precision)).unwrap();
        basis.reconstruct(&body.coefficients, out).unwrap();
    }
    let [narrow, wide] = out;
    for (narrow, wide) in narrow.iter().zip(&wide) {
        assert!((narrow - wide).abs() < 1e-4 * (1.0 + wide.abs()), "{narrow} {wide}");
    }
}

#[test]
fn modes_of_zeros_and_no_modes_give_the_mean() {
    for count in [0, 2] {
        let modes = Modes::new(Precision::Integers, 70, count, |_, _| 0.0).unwrap();
        let mean = vec![1.5; 70];
        let source = FieldSource::Affine(Affine { mean: Some(&mean), modes: &modes, coefficients: 0..count });
        let field = Field { source, role: Role::Plain, published: true };
        let spec = Spec { node_count: 70, nodes: None, fields: vec![field] };
        for isa in available() {
            let basis = Basis::build_for(&spec, Some(Precision::Integers), isa).unwrap();
            let mut out = vec![0.0; 70];
            basis.reconstruct(&[3.0; 2][..count], &mut out).unwrap();
            assert_eq!(out, mean);
        }
    }
}
