//! The domain of a regime in parts, so that each has a basis of its own: over a part fewer local modes say as much as all of them say
//! over the whole domain, and a reconstruction reads one part's basis only.
//!
//! Again and again that part is halved, at the median of its states, which takes most bits to tell its states apart; of the inputs along the
//! one for which both halves together then take least:
//!
//! ```text
//! log2 det(I + C) / 2      C the covariance of the coefficients over the states, in units of the least that counts
//! ```

use crate::accepted::Typical;
use crate::dense::Dense;
use crate::inputs::{InputMap, MAX_INPUTS, Point};

/// How far beyond its bounds a part's basis looks, in scaled inputs: about the distance of two samples of the shipped model, so that
/// states at the bound lie between states that the basis was made for.
const MARGIN: f64 = 0.06;
/// A part is not halved below twice so many states.
const MIN_STATES: usize = 80;

/// States that a part's bits are worked out from, at most.
const LOOKED_AT: usize = 200;

/// Where states lie apart.
#[derive(Clone, Debug)]
struct Halving {
    /// Position in the model's inputs.
    input: usize,
    /// In the input's unit.
    at: f64,
    /// Below and above: further halvings, or a part.
    to: [Place; 2],
}

#[derive(Clone, Copy, Debug)]
enum Place {
    Halving(usize),
    Part(usize),
}

/// The parts of a regime's domain. What lies beyond the domain belongs to the part on its side.
#[derive(Clone, Debug)]
pub(crate) struct Parts {
    first: Place,
    halvings: Vec<Halving>,
    /// Bounds of each part by axis, scaled; infinite where the domain ends.
    bounds: Vec<Vec<[f64; 2]>>,
}

/// A part while parts are being made.
struct Growing {
    states: Vec<usize>,
    bounds: Vec<[f64; 2]>,
    bits: f64,
    /// The halving, and the side of it, that leads here; none for the whole domain.
    from: Option<(usize, usize)>,
}

impl Parts {
    /// The whole domain.
    pub fn one(map: &InputMap) -> Self {
        let everywhere = vec![[f64::NEG_INFINITY, f64::INFINITY]; map.dimensions()];
        Self { first: Place::Part(0), halvings: Vec::new(), bounds: vec![everywhere] }
    }

    /// So many parts at most, fewer where there are few states. Cost `O(parts x axes x states x (log states + coefficients))`.
    pub fn new(map: &InputMap, typical: &Typical, least: &[f64], most: usize) -> Self {
        let mut parts = Self::one(map);
        let (states, bounds) = ((0..typical.states.len()).collect(), parts.bounds.remove(0));
        let mut growing = vec![Growing { states, bounds, bits: f64::INFINITY, from: None }];
        let mut grown = Vec::new();
        while growing.len() + grown.len() < most {
            let largest = growing.iter().enumerate().max_by(|a, b| a.1.bits.total_cmp(&b.1.bits));
            let Some((at, _)) = largest else { break };
            let part = growing.swap_remove(at);
            let halves = (0..map.dimensions()).filter_map(|axis| halves(typical, least, &part.states, axis));
            match halves.min_by(|a, b| a.bits().total_cmp(&b.bits())) {
                Some(best) => growing.extend(parts.halve(map, part, best)),
                None => grown.push(part),
            }
        }
        grown.extend(growing);
        for (number, part) in grown.into_iter().enumerate() {
            parts.lead(part.from, Place::Part(number));
            parts.bounds.push(part.bounds);
        }
        parts
    }

    fn halve(&mut self, map: &InputMap, part: Growing, halves: Halves) -> [Growing; 2] {
        let Halves { axis, at, halves } = halves;
        let of_model = map.axes[axis];
        let in_unit = of_model.min + at * (of_model.max - of_model.min);
        let number = self.halvings.len();
        self.halvings.push(Halving { input: of_model.input, at: in_unit, to: [Place::Part(0); 2] });
        self.lead(part.from, Place::Halving(number));
        let mut side = 0;
        halves.map(|(states, bits)| {
            let (mut bounds, from) = (part.bounds.clone(), Some((number, side)));
            bounds[axis][1 - side] = at;
            side += 1;
            Growing { states, bounds, bits, from }
        })
    }

    fn lead(&mut self, from: Option<(usize, usize)>, to: Place) {
        match from {
            Some((halving, side)) => self.halvings[halving].to[side] = to,
            None => self.first = to,
        }
    }

    /// How many there are, at least one.
    pub fn count(&self) -> usize {
        self.bounds.len()
    }

    /// The part in which a state lies.
    pub fn of(&self, inputs: &[f64; MAX_INPUTS]) -> usize {
        let mut place = self.first;
        loop {
            match place {
                Place::Part(part) => return part,
                Place::Halving(at) => {
                    let Halving { input, at, to } = &self.halvings[at];
                    place = to[usize::from(inputs[*input] > *at)];
                }
            }
        }
    }

    /// What the basis of a part is made for: the coefficients at the states in it and near it.
    pub fn near<'a>(&self, part: usize, typical: &'a Typical) -> impl Iterator<Item = &'a Vec<f64>> {
        let bounds = self.bounds[part].clone();
        let is_near = move |state: &Point| {
            let inside = |(x, [low, high]): (&f64, &[f64; 2])| *x >= low - MARGIN && *x <= high + MARGIN;
            state.iter().zip(&bounds).all(inside)
        };
        typical
            .states
            .iter()
            .zip(&typical.coefficients)
            .filter(move |(state, _)| is_near(state))
            .map(|(_, a)| a)
    }
}

/// States halved along an axis.
struct Halves {
    axis: usize,
    at: f64,
    /// Below and above: the states, and the bits that they take.
    halves: [(Vec<usize>, f64); 2],
}

impl Halves {
    fn bits(&self) -> f64 {
        self.halves.iter().map(|(_, bits)| bits).sum()
    }
}

/// None where there are few states, or too many have the median's value to lie apart there.
fn halves(typical: &Typical, least: &[f64], states: &[usize], axis: usize) -> Option<Halves> {
    if states.len() < 2 * MIN_STATES {
        return None;
    }
    let of = |state: &usize| typical.states[*state][axis];
    let mut sorted: Vec<f64> = states.iter().map(of).collect();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let at = 0.5 * (sorted[middle - 1] + sorted[middle]);
    let (above, below): (Vec<usize>, Vec<usize>) = states.iter().partition(|state| of(state) > at);
    let states = [below, above];
    if states.iter().any(|half| half.len() < MIN_STATES) {
        return None;
    }
    let halves = states.map(|half| {
        let bits = bits(typical, least, &half);
        (half, bits)
    });
    Some(Halves { axis, at, halves })
}

/// Bits that tell the coefficients of these states apart: `log2 det(I + C) / 2` with their covariance `C`, in units of the least that
/// counts. Of at most [`LOOKED_AT`] states, by the products of the states with each other: `O(states^2 (states + coefficients))`.
fn bits(typical: &Typical, least: &[f64], states: &[usize]) -> f64 {
    let each = states.len().div_ceil(LOOKED_AT).max(1);
    let scaled = |state: &usize| typical.coefficients[*state].iter().zip(least).map(|(a, least)| a / least);
    let mut rows: Vec<Vec<f64>> = states.iter().step_by(each).map(|state| scaled(state).collect()).collect();
    let count = rows.len() as f64;
    for j in 0..least.len() {
        let mean = rows.iter().map(|row| row[j]).sum::<f64>() / count;
        rows.iter_mut().for_each(|row| row[j] -= mean);
    }
    let product = |a: usize, b: usize| rows[a].iter().zip(&rows[b]).map(|(a, b)| a * b).sum::<f64>() / count;
    let one = |a, b| if a == b { 1.0 } else { 0.0 };
    0.5 * Dense::from_fn(rows.len(), |a, b| one(a, b) + product(a, b)).log2_determinant()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::InputAxis;
    use proptest::prelude::*;

    fn map() -> InputMap {
        let axis = |input, min, max| InputAxis { input, min, max };
        InputMap { axes: vec![axis(0, 0.0, 0.1), axis(1, 10.0, 70.0)], constants: Vec::new() }
    }

    /// Coefficients that follow the first axis more closely than the second.
    fn coefficients_at(states: Vec<[f64; 2]>) -> Typical {
        let point = |[x, y]: &[f64; 2]| std::array::from_fn(|i| [*x, *y].get(i).copied().unwrap_or(0.0));
        let of = |[x, y]: &[f64; 2]| (0..6).map(|j| (f64::from(j) * 3.0 * x).sin() + 0.01 * y).collect();
        Typical { states: states.iter().map(point).collect(), coefficients: states.iter().map(of).collect() }
    }

    fn in_units(map: &InputMap, state: &Point) -> [f64; MAX_INPUTS] {
        let mut inputs = [f64::NAN; MAX_INPUTS];
        for (x, axis) in state.iter().zip(&map.axes) {
            inputs[axis.input] = axis.min + x * (axis.max - axis.min);
        }
        inputs
    }

    proptest! {
        #[test]
        fn every_state_has_one_part_and_its_basis_was_made_for_it(
            states in proptest::collection::vec([0.0..1.0_f64, 0.0..1.0_f64], 1..500),
            most in 0_usize..12,
        ) {
            let (map, typical) = (map(), coefficients_at(states));
            let parts = Parts::new(&map, &typical, &[1e-3; 6], most);
            prop_assert!((1..=most.max(1)).contains(&parts.count()));
            let mut found = vec![0; parts.count()];
            for (state, coefficients) in typical.states.iter().zip(&typical.coefficients) {
                let part = parts.of(&in_units(&map, state));
                found[part] += 1;
                prop_assert!(parts.near(part, &typical).any(|near| near == coefficients), "{state:?} in {part}");
            }
            prop_assert!(parts.count() == 1 || found.iter().all(|states| *states >= MIN_STATES - 1), "{found:?}");
            for beyond in [-9.0, 9.0, f64::NAN] {
                let beyond = std::array::from_fn(|_| beyond);
                prop_assert!(parts.of(&beyond) < parts.count());
            }
        }
    }

    #[test]
    fn domains_are_halved_where_that_tells_most_apart_and_not_below_the_least_number_of_states() {
        let grid: Vec<[f64; 2]> =
            (0..400).map(|i| [f64::from(i % 20) / 19.0, f64::from(i / 20) / 19.0]).collect();
        let (map, typical) = (map(), coefficients_at(grid));
        let parts = Parts::new(&map, &typical, &[1e-3; 6], 4);
        assert_eq!(parts.count(), 4);
        let at = |pressure: f64, gap: f64| {
            parts.of(&std::array::from_fn(|i| [pressure, gap].get(i).copied().unwrap_or(0.0)))
        };
        for gap in [10.0, 40.0, 70.0] {
            let along: Vec<usize> = [0.0, 0.04, 0.06, 0.1].map(|pressure| at(pressure, gap)).to_vec();
            assert!(along.windows(2).all(|two| two[0] != two[1]), "{along:?} at {gap} mm");
            assert_eq!(
                along,
                [0.0, 0.04, 0.06, 0.1].map(|pressure| at(pressure, 10.0)),
                "one axis alone is halved"
            );
        }
        assert_eq!(Parts::new(&map, &typical, &[1e-3; 6], 1000).count(), 4, "of 100 states each");
        let same = coefficients_at(vec![[0.5, 0.5]; 400]);
        assert_eq!(Parts::new(&map, &same, &[1e-3; 6], 8).count(), 1, "states that are all the same");
    }
}
