//! The kernel equals the reference to the last bits the arithmetic allows, on every instruction set.

use std::mem::MaybeUninit;

use proptest::prelude::*;

use super::cases::{Body, Lcg, available};
use super::reference;
use rom::kernel::{FieldSource, Isa, Modes, Precision, Spec};
use rom::reconstructor::{Basis, Peak};

/// Unit roundoff of f32.
const U: f64 = 1.0 / (1u64 << 24) as f64;

/// `(k + 11) u` times the sum of the magnitudes of the terms: each term carries the rounding of the stored value's conversion,
/// coefficient and product, the sum one rounding per addition (at most k), and the magnitude that of rest shape, difference,
/// three squares and root. What was stored is the reference, so that the steps of i16 do not count.
fn bound(body: &Body, terms: f64) -> f64 {
    (body.modes + 11) as f64 * U * terms
}

fn check(body: &Body, spec: &Spec<'_>, basis: &Basis) -> Result<Vec<f32>, TestCaseError> {
    let expected = reference::reconstruct(spec, &body.coefficients);
    prop_assert_eq!(basis.output_len(), expected.len());
    // Elements that the kernel forgets stay NaN and fail the comparison.
    let mut out = vec![f32::NAN; expected.len()];
    let peaks = basis.reconstruct(&body.coefficients, &mut out).unwrap();
    for (k, (&found, expected)) in out.iter().zip(&expected).enumerate() {
        let bound = bound(body, expected.terms);
        let error = (f64::from(found) - expected.value).abs();
        prop_assert!(error <= bound, "{} entry {k}: {found} for {expected:?}, bound {bound}", basis.isa());
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
    fn all_instruction_sets_agree_with_the_reference_to_rounding(
        nodes in 1usize..200,
        modes in 0usize..9,
        seed: u64,
        mut published: [bool; 5],
        subset in prop::option::of(prop::collection::vec(any::<prop::sample::Index>(), 1..60)),
    ) {
        published[seed as usize % 5] |= published == [false; 5];
        let subset = subset.map(|set| set.iter().map(|i| i.index(nodes) as u32).collect::<Vec<_>>());
        let mixed: Vec<u8> = (0..modes).map(|mode| [4, 8, 16, 32][(seed >> (2 * mode)) as usize % 4]).collect();
        for bits in [vec![32; modes], vec![16; modes], mixed] {
            let body = Body::with_bits(nodes, seed, &bits);
            // A node set has separate steps as integers: in f32 it has the values of the whole.
            let wanted = subset.as_ref().map(|_| Precision::F32);
            let spec = body.spec(published, subset.as_deref());
            let mut fused: Option<Vec<f32>> = None;
            for isa in available() {
                let out = check(&body, &spec, &Basis::build_for(&spec, wanted, isa).unwrap())?;
                // Fused arithmetic in one order: not close, equal.
                if isa != Isa::Portable {
                    prop_assert_eq!(fused.get_or_insert_with(|| out.clone()), &out);
                }
            }
        }
    }

    #[test]
    fn stored_modes_are_within_half_a_step(
        nodes in 1usize..300,
        bits in prop::collection::vec(prop::sample::select(vec![4_u8, 8, 16]), 0..9),
        seed: u64,
        octaves in -40..40,
    ) {
        let modes = bits.len();
        let scale = f64::from(octaves).exp2();
        let values = Lcg(seed).vector(nodes * modes, scale);
        let exact = |mode: usize, node: usize| values[mode * nodes + node];
        let narrow = Modes::with_bits(nodes, bits, exact).unwrap();
        let wide = Modes::new(Precision::F32, nodes, modes, exact).unwrap();
        let bytes = narrow.bits().iter().map(|bits| usize::from(*bits)).sum::<usize>() * nodes.div_ceil(64) * 8;
        prop_assert_eq!((narrow.bytes().len(), narrow.steps().len()), (bytes, modes));
        for (mode, node) in (0..modes).flat_map(|mode| (0..nodes).map(move |node| (mode, node))) {
            let error = (narrow.value(mode, node) - exact(mode, node)).abs();
            // The integers of a word share half a step of rounding.
            prop_assert!(error <= 0.5001 * narrow.steps()[mode], "{error}");
            prop_assert_eq!(wide.value(mode, node), f64::from(exact(mode, node) as f32));
        }
    }

    #[test]
    fn a_prefix_of_the_modes_is_a_basis_of_fewer_modes(nodes in 1usize..200, used in 0usize..6, seed: u64) {
        let body = Body::new(nodes, 6, seed, Precision::Integers);
        let mut spec = body.spec([true; 5], None);
        for field in &mut spec.fields {
            if let FieldSource::Affine(affine) = &mut field.source {
                affine.coefficients.end = affine.coefficients.start + used;
            }
        }
        for isa in available() {
            check(&body, &spec, &Basis::build_for(&spec, Some(Precision::Integers), isa).unwrap())?;
        }
    }

    #[test]
    fn node_set_has_the_rows_of_the_whole_mesh(nodes in 1usize..200, seed: u64, stride in 1usize..7) {
        let body = Body::new(nodes, 6, seed, Precision::Integers);
        let subset: Vec<u32> = (0..nodes as u32).rev().step_by(stride).collect();
        let all = Basis::build(&body.spec([true; 5], None), Some(Precision::F32)).unwrap();
        let some = Basis::build(&body.spec([true; 5], Some(&subset)), Some(Precision::F32)).unwrap();
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
    fn uninitialised_memory_receives_the_same_values(nodes in 1usize..100, seed: u64) {
        let body = Body::new(nodes, 4, seed, Precision::F32);
        let basis = Basis::build(&body.spec([true; 5], None), Some(Precision::F32)).unwrap();
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
