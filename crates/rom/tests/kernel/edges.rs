//! What the description refuses, and inputs at the edge.

use super::cases::{Body, available};
use rom::kernel::{
    Affine, Basis, BasisError, Budget, Field, Isa, MAX_ROWS, Precision, ReconstructError, Role, Source, Spec,
    Values,
};

const ALL: [bool; 5] = [true; 5];

fn error(spec: &Spec<'_>) -> BasisError {
    Basis::build(spec, Precision::F32).unwrap_err()
}

/// One plain field of one node with these modes.
fn single<'a>(modes: &'a [f64], count: usize, stride: usize) -> Spec<'a> {
    let source =
        Source::Affine(Affine { mean: None, modes: Values::F64(modes), stride, coefficients: 0..count });
    Spec { node_count: 1, nodes: None, fields: vec![Field { source, role: Role::Plain, published: true }] }
}

#[test]
fn node_sets_that_do_not_fit_are_refused() {
    let body = Body::new(20, 2, 1);
    assert_eq!(error(&body.spec(ALL, Some(&[]))), BasisError::NodeCount { found: 0 });
    assert_eq!(error(&body.spec(ALL, Some(&[3, 20]))), BasisError::NodeIndex { node: 20, node_count: 20 });
    assert_eq!(error(&body.spec([false; 5], None)), BasisError::NothingPublished);
}

#[test]
fn slices_that_do_not_fit_are_refused_with_their_field() {
    let mut body = Body::new(20, 2, 1);
    body.bases[3].pop();
    let refused = error(&body.spec(ALL, None));
    assert_eq!(refused, BasisError::Length { field: 4, what: "the mode matrix", found: 39, expected: 40 });
    body.means[1].push(0.0);
    assert!(matches!(error(&body.spec(ALL, None)), BasisError::Length { field: 1, what: "the mean", .. }));
    assert!(matches!(
        error(&single(&[1.0], 1, 0)),
        BasisError::Length { what: "the stride between modes", .. }
    ));
}

#[test]
fn magnitudes_and_roles_that_make_no_sense_are_refused() {
    let body = Body::new(20, 2, 1);
    for coordinates in [[0, 1, 1], [0, 1, 3], [0, 1, 9]] {
        let mut spec = body.spec(ALL, None);
        if let Source::Magnitude { coordinates: c, .. } = &mut spec.fields[3].source {
            *c = coordinates;
        }
        assert_eq!(error(&spec), BasisError::Magnitude { field: 3 });
    }
    let mut spec = body.spec(ALL, None);
    spec.fields[0].role = Role::Stress;
    assert_eq!(error(&spec), BasisError::DuplicateRole { field: 4, role: Role::Stress });
}

#[test]
fn values_that_are_no_f32_are_refused_with_their_node() {
    for value in [f64::NAN, f64::INFINITY, 1e300] {
        let mut body = Body::new(40, 2, 1);
        body.bases[1][40 + 17] = value;
        let refused = error(&body.spec(ALL, None));
        assert!(matches!(refused, BasisError::NotFinite { field: 1, node: 17, .. }), "{refused}");
    }
}

#[test]
fn more_rows_than_the_stack_takes_are_refused() {
    let modes = vec![1.0; MAX_ROWS + 1];
    assert!(Basis::build(&single(&modes, MAX_ROWS, 1), Precision::F32).is_ok());
    let refused = error(&single(&modes, MAX_ROWS + 1, 1));
    assert_eq!(refused, BasisError::Rows { found: MAX_ROWS + 1 });
}

#[test]
fn an_instruction_set_that_is_missing_is_refused() {
    for isa in Isa::ALL {
        let built = Basis::build_for(&single(&[1.0], 1, 1), Precision::F32, isa);
        assert_eq!(built.is_ok(), isa.is_available());
    }
}

#[test]
fn wrong_lengths_write_nothing() {
    let body = Body::new(20, 2, 1);
    let basis = Basis::build(&body.spec(ALL, None), Precision::F32).unwrap();
    let mut out = vec![7.0; 99];
    let refused = basis.reconstruct(&body.coefficients, &mut out).unwrap_err();
    assert_eq!(refused, ReconstructError::Output { found: 99, expected: 100 });
    let mut out = vec![7.0; 100];
    let refused = basis.reconstruct(&body.coefficients[..7], &mut out).unwrap_err();
    assert_eq!(refused, ReconstructError::Coefficients { found: 7, expected: 10 });
    assert!(out.iter().all(|&v| v == 7.0));
}

#[test]
fn nan_comes_out_as_nan_and_wins_no_peak() {
    let mut body = Body::new(20, 2, 1);
    body.coefficients[7] = f64::NAN; // the last mode of the stress
    for isa in available() {
        let basis = Basis::build_for(&body.spec(ALL, None), Precision::F32, isa).unwrap();
        let mut out = vec![0.0; 100];
        let peaks = basis.reconstruct(&body.coefficients, &mut out).unwrap();
        assert!(out[80..].iter().all(|v| v.is_nan()) && out[..80].iter().all(|v| v.is_finite()), "{isa}");
        assert_eq!(peaks.stress_mpa.unwrap().value, f32::NEG_INFINITY);
        assert!(peaks.displacement_mm.unwrap().value > 0.0);
    }
}

#[test]
fn fields_of_a_joint_pod_share_coefficients() {
    // Two fields of two nodes stacked in each mode, as the paper stacks X, Y, Z, U, S.
    let modes = [1.0, 2.0, 3.0, 4.0, 10.0, 20.0, 30.0, 40.0];
    let field = |offset: usize| Field {
        source: Source::Affine(Affine {
            mean: None,
            modes: Values::F64(&modes[offset..]),
            stride: 4,
            coefficients: 1..3,
        }),
        role: Role::Plain,
        published: true,
    };
    let spec = Spec { node_count: 2, nodes: None, fields: vec![field(0), field(2)] };
    let basis = Basis::build(&spec, Precision::F32).unwrap();
    let mut out = [0.0; 4];
    let peaks = basis.reconstruct(&[9.0, 1.0, 0.5], &mut out).unwrap();
    assert_eq!(out, [6.0, 12.0, 18.0, 24.0]);
    assert_eq!((peaks.displacement_mm, peaks.stress_mpa), (None, None));
}

#[test]
fn a_coordinate_that_only_the_magnitude_needs_costs_no_rest_row() {
    let body = Body::new(64, 3, 1);
    let bytes = |published| Basis::build(&body.spec(published, None), Precision::F32).unwrap().bytes();
    let row = 256;
    assert_eq!(bytes([false, false, false, true, false]), 3 * (1 + 3 + 1) * row); // one moves it
    assert_eq!(bytes([true, true, true, true, false]), 3 * (1 + 3 + 1 + 1) * row);
    assert_eq!(bytes([true, true, true, false, false]), 3 * (1 + 3) * row);
    assert_eq!(bytes([false, false, false, false, true]), (1 + 3) * row);
}

#[test]
fn i16_halves_the_bytes_and_states_its_error() {
    let body = Body::new(1600, 6, 3);
    let spec = body.spec(ALL, None);
    let wide = Basis::build(&spec, Precision::F32).unwrap();
    let narrow = Basis::build(&spec, Precision::I16).unwrap();
    // Four means, three rest coordinates, what moves each of them, four times six modes.
    assert_eq!(wide.bytes(), 1600 * (10 + 24) * 4);
    assert_eq!(narrow.bytes(), 1600 * (10 + 24) * 2);
    assert_eq!(wide.error_bound(0, &body.coefficients), 0.0);
    // Half a step of: a mean within 10 of the rest shape, a rest shape within 115, six modes of 0.02 times 500 at most.
    let bound = |terms: f64| terms / 32767.0 / 2.0;
    let coordinate = narrow.error_bound(0, &body.coefficients);
    assert!(
        coordinate > bound(100.0) && coordinate < bound(10.0 + 115.0 + 6.0 * 0.02 * 500.0),
        "{coordinate}"
    );
    // The displacement is summed before the rest shape comes in, so it does not carry its step.
    let displacement = narrow.error_bound(3, &body.coefficients);
    assert!(
        displacement > 0.0 && displacement < 3f64.sqrt() * bound(10.0 + 2.0 + 6.0 * 0.02 * 500.0),
        "{displacement}"
    );
}

/// A budget over the coefficients of a body, the same for all fields.
fn within(body: &Body, spec: &Spec<'_>, accepted: f64) -> Result<Basis, BasisError> {
    let typical = body.typical();
    Basis::build_within(spec, &Budget { typical: &typical, accepted: &[accepted; 5], or_f32: false })
}

#[test]
fn the_more_error_is_accepted_the_fewer_bytes_are_read() {
    let body = Body::new(1600, 6, 3);
    let spec = body.spec(ALL, None);
    let bytes = [1e-4, 1e-3, 1e-2, 1e-1, 1.0].map(|accepted| within(&body, &spec, accepted).unwrap().bytes());
    assert!(bytes.is_sorted_by(|more, less| more > less), "{bytes:?}");
    assert!(bytes[0] < Basis::build(&spec, Precision::F32).unwrap().bytes());
    let nothing = within(&body, &spec, 1e6).unwrap();
    assert_eq!(nothing.widths(), [0.0, 0.0, 0.0, 1.0]);
    let mut out = vec![7.0; 5 * 1600];
    nothing.reconstruct(&body.coefficients, &mut out).unwrap();
    assert!(out.iter().all(|&value| value == 0.0), "a basis without rows is 0 everywhere");
}

#[test]
fn a_row_below_what_is_accepted_is_left_out_and_others_keep_their_bits() {
    let mut body = Body::new(640, 3, 5);
    body.bases[3][640..1280].iter_mut().for_each(|value| *value *= 1e-6);
    body.coefficients[9..12].copy_from_slice(&[100.0, 100.0, 100.0]);
    let spec = body.spec([false, false, false, false, true], None);
    let [wide, half, quarter, none] = within(&body, &spec, 1e-3).unwrap().widths();
    assert_eq!((wide, none), (0.0, 0.25), "one of the mean and three modes");
    assert_eq!(half + quarter, 0.75);
}

#[test]
fn a_budget_that_f32_does_not_keep_is_refused_by_field() {
    let body = Body::new(100, 2, 1);
    let spec = body.spec(ALL, None);
    let refused = within(&body, &spec, 1e-9).unwrap_err();
    let BasisError::Budget(short) = &refused else { panic!("{refused}") };
    assert_eq!(short.iter().map(|s| s.field).collect::<Vec<_>>(), [0, 1, 2, 4]);
    assert!(short.iter().all(|s| s.accepted == 1e-9 && s.least > 1e-9 && s.least < 1e-4), "{short:?}");
    let least = short.iter().fold(0.0, |most: f64, s| most.max(s.least));
    assert!(within(&body, &spec, 1.001 * least).is_ok(), "the least that it names can be kept");
    assert!(within(&body, &spec, f64::NAN).is_err());
}

#[test]
fn a_field_that_no_budget_keeps_stays_in_f32_where_that_is_asked_for() {
    let body = Body::new(640, 2, 1);
    let spec = body.spec([false, false, false, false, true], None);
    let typical = body.typical();
    let budget = Budget { typical: &typical, accepted: &[0.0; 5], or_f32: true };
    let basis = Basis::build_within(&spec, &budget).unwrap();
    assert_eq!(basis.widths(), [1.0, 0.0, 0.0, 0.0]);
    let (mut found, mut full) = (vec![0.0; 640], vec![0.0; 640]);
    basis.reconstruct(&body.coefficients, &mut found).unwrap();
    Basis::build(&spec, Precision::F32).unwrap().reconstruct(&body.coefficients, &mut full).unwrap();
    assert_eq!(found, full);
}

#[test]
fn every_instruction_set_reads_the_same_bytes() {
    let body = Body::new(333, 5, 9);
    let (spec, typical) = (body.spec(ALL, None), body.typical());
    let budget = Budget { typical: &typical, accepted: &[0.1; 5], or_f32: false };
    let read = |isa| {
        let uniform = Basis::build_for(&spec, Precision::I16, isa).unwrap();
        let local = Basis::build_within_for(&spec, &budget, isa).unwrap();
        [uniform.read_once(), local.read_once()]
    };
    let sums: Vec<[u32; 2]> = available().into_iter().map(read).collect();
    assert!(!sums[0].contains(&0) && sums.iter().all(|&sum| sum == sums[0]), "{sums:?}");
}

#[test]
fn a_basis_is_read_ahead_as_a_whole_in_steps_of_half_a_mebibyte() {
    let body = Body::new(8000, 40, 9);
    let (spec, typical) = (body.spec(ALL, None), body.typical());
    let budget = Budget { typical: &typical, accepted: &[0.1; 5], or_f32: false };
    let uniform = Basis::build(&spec, Precision::I16).unwrap();
    let local = Basis::build_within(&spec, &budget).unwrap();
    for basis in [uniform, local] {
        let steps: Vec<usize> =
            (0..).map(|step| basis.read_ahead(step)).take_while(|&bytes| bytes > 0).collect();
        let (last, whole) = steps.split_last().unwrap();
        assert!(whole.len() > 1 && whole.iter().all(|&bytes| bytes == 512 * 1024), "{steps:?}");
        assert_eq!(whole.len() * 512 * 1024 + last, basis.bytes());
        assert_eq!(basis.read_ahead(usize::MAX), 0);
    }
}
