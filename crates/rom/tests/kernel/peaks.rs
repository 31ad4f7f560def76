//! The search for a peak finds what the sweep over all nodes finds, on every instruction set.

use proptest::prelude::*;

use super::cases::{Lcg, available};
use rom::kernel::{Affine, Basis, Field, Isa, PeakSearch, Precision, Role, Source, Spec, Values};

/// A field over `nodes` whose rows are multiples of `step` (0: any numbers), so that values and bounds are equal where they may be.
struct Case {
    nodes: usize,
    modes: usize,
    step: f64,
    values: Vec<f64>,
}

impl Case {
    fn new(nodes: usize, modes: usize, step: f64, seed: u64) -> Self {
        let values = Lcg(seed).vector((1 + modes) * nodes, 0.3);
        let round = |value: &f64| if step > 0.0 { (value / step).round() * step } else { *value };
        Self { nodes, modes, step, values: values.iter().map(round).collect() }
    }

    fn field(&self) -> Affine<'_> {
        let (mean, modes) = self.values.split_at(self.nodes);
        let (mean, modes) = (Some(Values::F64(mean)), Values::F64(modes));
        // Coefficients of another field stand before its own.
        Affine { mean, modes, stride: self.nodes, coefficients: 2..2 + self.modes }
    }

    fn coefficients(&self, scale: f64, random: &mut Lcg) -> Vec<f64> {
        let mut all = random.vector(2 + self.modes, scale);
        if self.step > 0.0 {
            all.iter_mut().for_each(|a| *a = (*a / self.step).round() * self.step);
        }
        all
    }

    /// The search and the sweep, each with its bits.
    fn both(&self, isa: Isa, of: &[f64]) -> [(u32, u32); 2] {
        let fields =
            vec![Field { source: Source::Affine(self.field()), role: Role::Stress, published: true }];
        let spec = Spec { node_count: self.nodes, nodes: None, fields };
        let mut out = vec![0.0; self.nodes];
        let basis = Basis::build_for(&spec, Precision::F32, isa).unwrap();
        let sweep = basis.reconstruct(of, &mut out).unwrap().stress_mpa.unwrap();
        let largest: Vec<f64> = of.iter().map(|a| a.abs()).collect();
        let mut search = PeakSearch::build_for(&self.field(), self.nodes, &largest, isa).unwrap();
        [search.find(of).unwrap(), sweep].map(|peak| (peak.value.to_bits(), peak.node))
    }
}

proptest! {
    #[test]
    fn the_peak_is_that_of_the_sweep(
        nodes in 1..600_usize,
        modes in 0..30_usize,
        step in prop::sample::select(vec![0.0, 0.05, 0.15]),
        scale in prop::sample::select(vec![0.0, 1e-30, 0.4, 30.0, 1e30]),
        seed in any::<u64>(),
    ) {
        let case = Case::new(nodes, modes, step, seed);
        let of = case.coefficients(scale, &mut Lcg(seed ^ 1));
        for isa in available() {
            let [found, wanted] = case.both(isa, &of);
            prop_assert_eq!(found, wanted, "{} {:?}", isa, of);
        }
    }

    #[test]
    fn what_is_no_number_bounds_nothing(
        nodes in 1..600_usize,
        at in 0..20_usize,
        odd in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e39, 3e38, -3e38]),
        step in prop::sample::select(vec![0.0, 0.15]),
        seed in any::<u64>(),
    ) {
        let case = Case::new(nodes, 20, step, seed);
        let mut of = case.coefficients(1.0, &mut Lcg(seed ^ 1));
        of[2 + at] = odd;
        for isa in available() {
            let [found, wanted] = case.both(isa, &of);
            prop_assert_eq!(found, wanted, "{} {:?}", isa, of);
        }
    }
}

/// One stress concentration: the bounds leave out all tiles but the one with it.
#[test]
fn tiles_that_cannot_have_the_peak_are_not_swept() {
    let nodes = 64 * 20;
    let mut case = Case::new(nodes, 1, 0.0, 7);
    case.values.iter_mut().for_each(|value| *value *= 0.1);
    case.values[777] = 1.0;
    let mut search = PeakSearch::build(&case.field(), nodes, &[1.0; 3]).unwrap();
    let peak = search.find(&[0.0, 0.0, 0.1]).unwrap();
    assert_eq!((peak.node, search.swept()), (777, (1, 20)));
    // Everything below 0 is 0 everywhere: then any node may be the first of the equals.
    case.values[..nodes].iter_mut().for_each(|value| *value = -value.abs() - 0.1);
    let mut search = PeakSearch::build(&case.field(), nodes, &[1.0; 3]).unwrap();
    let peak = search.find(&[0.0; 3]).unwrap();
    assert_eq!((peak.value, peak.node, search.swept()), (0.0, 0, (20, 20)));
}

#[test]
fn too_few_coefficients_and_damaged_rows_are_refused() {
    let mut case = Case::new(100, 3, 0.0, 5);
    let mut search = PeakSearch::build(&case.field(), 100, &[1.0; 5]).unwrap();
    assert!(search.find(&[0.0; 4]).is_err() && search.find(&[0.0; 5]).is_ok());
    assert!(PeakSearch::build(&case.field(), 101, &[1.0; 5]).is_err());
    case.values[130] = f64::NAN;
    let refused = PeakSearch::build(&case.field(), 100, &[1.0; 5]).unwrap_err();
    assert!(refused.to_string().contains("node 30"), "{refused}");
}
