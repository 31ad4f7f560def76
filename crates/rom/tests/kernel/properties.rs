//! The kernel equals the reference to the last bits the arithmetic allows, on every instruction set.

use std::mem::MaybeUninit;

use proptest::prelude::*;

use super::cases::{Body, available};
use super::reference::{self, Reference};
use rom::kernel::{Basis, Budget, Isa, Peak, Precision, Spec};

/// Unit roundoff of f32.
const U: f64 = 1.0 / (1u64 << 24) as f64;

/// `(k + 10) u` times the sum of the magnitudes of the terms: each term carries the rounding of mode, coefficient and
/// product, the sum one rounding an addition (at most k), and the magnitude that of rest shape, difference, three
/// squares and root. For i16 and for rows of different widths the bound of the storage comes on
/// top (a little more of it: the terms of the stored modes may be that much larger).
fn bound(body: &Body, basis: &Basis, slot: usize, terms: f64) -> f64 {
    let factor = (body.modes + 10) as f64 * U;
    match basis.precision() {
        Some(Precision::F32) => factor * terms,
        _ => factor * terms + 1.001 * basis.error_bound(slot, &body.coefficients),
    }
}

fn check(body: &Body, spec: &Spec<'_>, basis: &Basis) -> Result<Vec<f32>, TestCaseError> {
    let expected = reference::reconstruct(spec, &body.coefficients);
    prop_assert_eq!(basis.output_len(), expected.len());
    // Elements that the kernel forgets stay NaN and fail the comparison.
    let mut out = vec![f32::NAN; expected.len()];
    let peaks = basis.reconstruct(&body.coefficients, &mut out).unwrap();
    for (k, (&found, expected)) in out.iter().zip(&expected).enumerate() {
        let bound = bound(body, basis, k / basis.nodes(), expected.terms);
        let error = (f64::from(found) - expected.value).abs();
        prop_assert!(
            error <= bound,
            "{} {:?} entry {k}: {found} for {expected:?}, bound {bound}",
            basis.isa(),
            basis.precision()
        );
    }
    // The peaks are those of the values written, at the first node that has them.
    let mut slot = 0;
    for (field, peak) in spec.fields.iter().zip([None, None, None, peaks.displacement_mm, peaks.stress_mpa]) {
        if field.published {
            let values = &out[slot * basis.nodes()..][..basis.nodes()];
            if let Some(Peak { value, node }) = peak {
                let (first, largest) = values
                    .iter()
                    .enumerate()
                    .fold((0, f32::MIN), |best, (i, &v)| if v > best.1 { (i, v) } else { best });
                prop_assert_eq!(value, largest);
                prop_assert_eq!(node as usize, spec.source_node(first));
            }
            slot += 1;
        }
    }
    Ok(out)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn every_instruction_set_is_within_the_rounding_of_the_reference(
        nodes in 1usize..200,
        modes in 0usize..9,
        seed: u64,
        mut published: [bool; 5],
        subset in prop::option::of(prop::collection::vec(any::<prop::sample::Index>(), 1..60)),
    ) {
        published[seed as usize % 5] |= published == [false; 5];
        let body = Body::new(nodes, modes, seed);
        let subset = subset.map(|set| set.iter().map(|i| i.index(nodes) as u32).collect::<Vec<_>>());
        let spec = body.spec(published, subset.as_deref());
        for precision in [Precision::F32, Precision::I16] {
            let mut fused: Option<Vec<f32>> = None;
            for isa in available() {
                let out = check(&body, &spec, &Basis::build_for(&spec, precision, isa).unwrap())?;
                // Fused arithmetic in one order: not close, equal.
                if isa != Isa::Portable {
                    prop_assert_eq!(fused.get_or_insert_with(|| out.clone()), &out);
                }
            }
        }
    }

    #[test]
    fn rows_of_every_width_are_within_their_steps_of_the_reference(
        nodes in 1usize..200,
        modes in 0usize..9,
        seed: u64,
        mut published: [bool; 5],
        octaves in 0..24,
        subset in prop::option::of(prop::collection::vec(any::<prop::sample::Index>(), 1..60)),
    ) {
        published[seed as usize % 5] |= published == [false; 5];
        let body = Body::new(nodes, modes, seed);
        let subset = subset.map(|set| set.iter().map(|i| i.index(nodes) as u32).collect::<Vec<_>>());
        let spec = body.spec(published, subset.as_deref());
        let typical = body.typical();
        let accepted = [200.0, 200.0, 200.0, 0.0, 20.0].map(|size| size / f64::from(1 << octaves));
        let budget = Budget { typical: &typical, accepted: &accepted, or_f32: false };
        let mut fused: Option<Vec<f32>> = None;
        for isa in available() {
            // Where f32 adds more than is accepted there is nothing to compare.
            let Ok(basis) = Basis::build_within_for(&spec, &budget, isa) else { continue };
            let out = check(&body, &spec, &basis)?;
            if isa != Isa::Portable {
                prop_assert_eq!(fused.get_or_insert_with(|| out.clone()), &out);
            }
        }
        prop_assert!(octaves > 20 || Basis::build_within(&spec, &budget).is_ok());
    }

    #[test]
    fn what_storage_adds_is_what_was_accepted_at_most(
        nodes in 300usize..600,
        modes in 1usize..9,
        seed: u64,
        octaves in 0..16,
    ) {
        let body = Body::new(nodes, modes, seed);
        let spec = body.spec([true, true, true, false, true], None);
        let typical = body.typical();
        let accepted = [20.0, 20.0, 20.0, 0.0, 20.0].map(|size| size / f64::from(1 << octaves));
        let basis = Basis::build_within(&spec, &Budget { typical: &typical, accepted: &accepted, or_f32: false }).unwrap();
        let (mut squares, mut rounding) = ([0.0; 4], [0.0_f64; 4]);
        let mut out = vec![0.0; basis.output_len()];
        for coefficients in &typical {
            let exact = reference::reconstruct(&spec, coefficients);
            basis.reconstruct(coefficients, &mut out).unwrap();
            for slot in 0..4 {
                let (found, exact) = (&out[slot * nodes..][..nodes], &exact[slot * nodes..][..nodes]);
                let error = |(found, exact): (&f32, &Reference)| (f64::from(*found) - exact.value).powi(2);
                squares[slot] += found.iter().zip(exact).map(error).sum::<f64>();
                let terms = exact.iter().fold(0.0, |most: f64, of| most.max(of.terms));
                rounding[slot] = rounding[slot].max((modes + 10) as f64 * U * terms);
            }
        }
        for (slot, square) in squares.into_iter().enumerate() {
            let added = (square / (nodes * typical.len()) as f64).sqrt();
            // What is rounded to few steps is not spread evenly over them.
            prop_assert!(added <= 1.1 * accepted[0] + rounding[slot], "slot {slot}: {added} for {}", accepted[0]);
        }
    }

    #[test]
    fn a_node_set_gives_the_rows_of_the_whole(nodes in 1usize..200, seed: u64, stride in 1usize..7) {
        let body = Body::new(nodes, 6, seed);
        let subset: Vec<u32> = (0..nodes as u32).rev().step_by(stride).collect();
        let all = Basis::build(&body.spec([true; 5], None), Precision::F32).unwrap();
        let some = Basis::build(&body.spec([true; 5], Some(&subset)), Precision::F32).unwrap();
        let mut whole = vec![0.0; all.output_len()];
        let mut part = vec![0.0; some.output_len()];
        all.reconstruct(&body.coefficients, &mut whole).unwrap();
        some.reconstruct(&body.coefficients, &mut part).unwrap();
        for (k, value) in part.iter().enumerate() {
            let (field, i) = (k / subset.len(), k % subset.len());
            prop_assert_eq!(*value, whole[field * nodes + subset[i] as usize]);
        }
    }

    #[test]
    fn unwritten_memory_ends_as_the_same_values(nodes in 1usize..100, seed: u64) {
        let body = Body::new(nodes, 4, seed);
        let basis = Basis::build(&body.spec([true; 5], None), Precision::F32).unwrap();
        let mut initialised = vec![f32::NAN; basis.output_len()];
        let mut loaned = vec![MaybeUninit::new(f32::NAN); basis.output_len()];
        let first = basis.reconstruct(&body.coefficients, &mut initialised).unwrap();
        let second = basis.reconstruct_uninit(&body.coefficients, &mut loaned).unwrap();
        // SAFETY: every element was initialised above, before the call.
        let loaned: Vec<f32> = loaned.into_iter().map(|value| unsafe { value.assume_init() }).collect();
        prop_assert_eq!(initialised, loaned);
        prop_assert_eq!(first, second);
    }
}
