//! Constants of a law from homogeneous tests, and the choice of a law.
//!
//! The constants minimise `sum_t w_t^2 (mean_i ((P(l_i) - P_i) / max|P_t|)^2 + v^2 mean_j ((P(l_j) - P_j) / S_t)^2)` over the tests `t`, where
//! `i` are all rows, `j` those at working strains and `S_t` the RMS stress there. Without the second sum (`v = 0`) a strip pulled to a strain
//! of 3 would tell nothing about strains of 10 %, where its stress is a hundredth of the largest. Each test counts by its weight, whatever
//! its number of rows and its unit. A test of the shape only is divided by its specimen's modulus, another constant. Linear constants follow
//! from normal equations, the others (`jm`, exponents) from a grid and a simplex search.
//!
//! A law is chosen by what it predicts: fitted to the rows below a strain, it is compared with those beyond.

use super::law::Hyperelastic;
use super::least_squares::{Gram, inverse, minimum};
use super::tension::{Deformation, invariant, stretch_at};
use rom::statistics::mean;

/// A test: stretches and nominal stresses (MPa), in any order.
#[derive(Clone, Debug)]
pub struct Test {
    /// How the specimen was deformed.
    pub deformation: Deformation,
    /// Stretch and nominal stress (MPa).
    pub points: Vec<[f64; 2]>,
    /// Weight of the test's RMS error.
    pub weight: f64,
    /// True if the specimen has another modulus than the law: the test tells the law's shape, and the ratio of the moduli is fitted.
    pub shape_only: bool,
    /// How much the error at [`WORKING_STRAINS`], relative to the stress there, counts beside that relative to the largest stress.
    pub working_weight: f64,
}

/// Engineering strains, tension or compression, at which most of an actuator's material works.
pub const WORKING_STRAINS: [f64; 2] = [0.02, 0.30];
/// Fewest rows at working strains that are weighted.
const FEWEST_WORKING: usize = 3;

impl Test {
    /// Largest magnitude of the stress, MPa.
    pub fn largest_mpa(&self) -> f64 {
        self.points.iter().map(|p| p[1].abs()).fold(0.0, f64::max)
    }

    /// RMS and largest difference between a law and the test, MPa; infinite beyond the law's limit.
    pub fn error_mpa(&self, law: &Hyperelastic) -> [f64; 2] {
        let off = |p: &[f64; 2]| {
            law.nominal_stress_mpa(self.deformation, p[0]).map_or(f64::INFINITY, |s| (s - p[1]).abs())
        };
        let (sum, largest) =
            self.points.iter().map(off).fold((0.0, 0.0_f64), |(s, m), e| (s + e * e, m.max(e)));
        [(sum / self.points.len().max(1) as f64).sqrt(), largest]
    }

    /// [`Self::error_mpa`] in % of the largest stress.
    pub fn error_percent(&self, law: &Hyperelastic) -> [f64; 2] {
        self.error_mpa(law).map(|mpa| 100.0 * mpa / self.largest_mpa())
    }

    /// Rows at [`WORKING_STRAINS`]; none if they are too few or carry no load.
    fn working(&self) -> Self {
        let [low, high] = WORKING_STRAINS;
        let mut part = self.part(|strain| (low..=high).contains(&strain));
        if part.points.len() < FEWEST_WORKING || part.largest_mpa() == 0.0 {
            part.points.clear();
        }
        part
    }

    /// The rows whose strain's magnitude satisfies a condition.
    fn part(&self, is_in: impl Fn(f64) -> bool) -> Self {
        let points = self.points.iter().copied().filter(|p| is_in((p[0] - 1.0).abs())).collect();
        Self { points, ..self.clone() }
    }

    fn rms_mpa(&self) -> f64 {
        mean(self.points.iter().map(|p| p[1] * p[1])).sqrt()
    }

    /// RMS difference between a law and the test at [`WORKING_STRAINS`] in % of the RMS stress there; `None` with too few rows there.
    pub fn working_error_percent(&self, law: &Hyperelastic) -> Option<f64> {
        let part = self.working();
        (!part.points.is_empty()).then(|| 100.0 * part.error_mpa(law)[0] / part.rms_mpa())
    }

    /// Modulus of the specimen over that of a law.
    fn modulus(&self, law: &Hyperelastic) -> f64 {
        let products = |p: &[f64; 2]| {
            let of_law = law.nominal_stress_mpa(self.deformation, p[0]).unwrap_or(f64::INFINITY);
            [of_law * p[1], of_law * of_law]
        };
        let [mixed, squared] =
            self.points.iter().map(products).fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
        mixed / squared
    }

    /// The test with its stresses divided by a modulus ratio.
    #[must_use]
    pub fn divided(&self, modulus: f64) -> Self {
        Self { points: self.points.iter().map(|p| [p[0], p[1] / modulus]).collect(), ..self.clone() }
    }

    /// Means of consecutive rows by stretch, at most [`BINS`].
    fn thinned(&self) -> Self {
        let mut points = self.points.clone();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let size = points.len().div_ceil(BINS).max(1);
        let mean =
            |rows: &[[f64; 2]]| [0, 1].map(|k| rows.iter().map(|p| p[k]).sum::<f64>() / rows.len() as f64);
        Self { points: points.chunks(size).map(mean).collect(), ..self.clone() }
    }
}

/// Most points of a test that enter the search.
const BINS: usize = 250;
/// Fractions of a test's largest strain below which a law is fitted, to be compared with the rows beyond.
const FITTED_BELOW: [f64; 3] = [0.5, 0.65, 0.8];
/// Half-width of a constant's interval, as a fraction of the constant, above which the tests do not determine it.
const UNDETERMINED: f64 = 1.0;
/// Largest magnitude of an exponent.
const LARGEST_EXPONENT: f64 = 12.0;
/// Difference of exponents below which two terms are one.
const SAME_EXPONENT: f64 = 0.1;
/// Rounds of law and moduli in turn, and relative change of a modulus at which they end.
const ROUNDS: usize = 200;
const MODULUS_TOLERANCE: f64 = 1.0e-5;
/// Grid of the exponents.
const GRID_STEP: f64 = 0.5;

/// Laws that can be fitted, by their terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// One constant.
    NeoHookean,
    /// Two constants.
    MooneyRivlin,
    /// Two constants.
    Gent,
    /// The first two constants, the third is zero.
    Yeoh2,
    /// Three constants.
    Yeoh3,
    /// One term, two constants.
    Ogden1,
    /// Two terms, four constants.
    Ogden2,
    /// Three terms, six constants.
    Ogden3,
}

impl Family {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NeoHookean,
        Self::MooneyRivlin,
        Self::Gent,
        Self::Yeoh2,
        Self::Yeoh3,
        Self::Ogden1,
        Self::Ogden2,
        Self::Ogden3,
    ];
}

/// Fitted law.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The law whose constants were fitted.
    pub family: Family,
    /// Law with its constants.
    pub law: Hyperelastic,
    /// Half-widths of the 95 % confidence intervals, in the order of [`Hyperelastic::constants`]; `None` where the tests leave a constant
    /// open or it is at a bound.
    pub half_widths: Vec<Option<f64>>,
    /// Modulus of each specimen over that of the law; 1 but for tests of the shape only.
    pub moduli: Vec<f64>,
    /// RMS error as a fraction of the largest stress, over all tests by weight, each divided by its modulus.
    pub error: f64,
    /// RMS error at [`WORKING_STRAINS`] as a fraction of the RMS stress there, over the tests with rows there; `None` if none has.
    pub working_error: Option<f64>,
    /// RMS error, as a fraction of the largest stress, of the rows beyond a strain for a law fitted below it; mean square over several
    /// strains.
    pub beyond_error: f64,
    /// Weighted sum of the three that the choice compares.
    score: f64,
    /// Stretch of a bar from which the law is unstable ([`Hyperelastic::stable_to`]).
    pub stable_to: Option<f64>,
}

/// Fits families. Left out are those without stable constants, and those that come out as an earlier one: a third term that is not needed,
/// a second constant that is zero.
pub fn fit_all(families: &[Family], tests: &[Test]) -> Vec<Fitted> {
    let mut all: Vec<Fitted> = Vec::new();
    for fitted in families.iter().filter_map(|family| fit(*family, tests)) {
        let kind = |other: &Fitted| (other.law.name(), other.constants());
        if all.iter().all(|other| kind(other) != kind(&fitted)) {
            all.push(fitted);
        }
    }
    all
}

/// Fits a family; `None` if no constants are stable over the tests' first invariants.
pub fn fit(family: Family, tests: &[Test]) -> Option<Fitted> {
    let thinned: Vec<Test> = tests.iter().map(Test::thinned).collect();
    let reach = reach(tests);
    let (law, moduli) = solve_with_moduli(family, &thinned, reach)?;
    let law = simplest(law);
    let [tests, thinned] = [tests, &thinned].map(|tests| divided(tests, &moduli));
    let error =
        combined(tests.iter().map(|test| (test.weight, test.error_percent(&law)[0] / 100.0))).unwrap_or(0.0);
    let working = |test: &Test| Some((test.weight, test.working_error_percent(&law)? / 100.0));
    let working_error = combined(tests.iter().filter_map(working));
    let beyond_error = beyond(family, &thinned, reach).unwrap_or(f64::INFINITY);
    let working_weight = tests.iter().map(|test| test.working_weight).fold(0.0, f64::max);
    let score = error.hypot(working_weight * working_error.unwrap_or(0.0)).hypot(beyond_error);
    Some(Fitted {
        family,
        law,
        half_widths: half_widths(&law, &thinned),
        moduli,
        error,
        working_error,
        beyond_error,
        score,
        stable_to: law.stable_to(),
    })
}

fn divided(tests: &[Test], moduli: &[f64]) -> Vec<Test> {
    tests.iter().zip(moduli).map(|(test, modulus)| test.divided(*modulus)).collect()
}

/// Law, and modulus of each test of the shape only: one is solved for the others in turn, which lowers the sum of squares each time.
fn solve_with_moduli(family: Family, tests: &[Test], reach: f64) -> Option<(Hyperelastic, Vec<f64>)> {
    let mut moduli = vec![1.0; tests.len()];
    for _ in 0..ROUNDS {
        let law = solve(family, &Rows::of(&divided(tests, &moduli)), reach)?;
        let next = tests.iter().map(|test| if test.shape_only { test.modulus(&law) } else { 1.0 });
        let last = std::mem::replace(&mut moduli, next.collect());
        let changes = moduli.iter().zip(&last).map(|(is, was)| (is / was - 1.0).abs());
        if changes.fold(0.0, f64::max) <= MODULUS_TOLERANCE {
            return Some((law, moduli));
        }
    }
    None
}

/// The law by the name of a simpler one where its further constants are zero.
fn simplest(law: Hyperelastic) -> Hyperelastic {
    match law {
        Hyperelastic::MooneyRivlin { c10_mpa, c01_mpa: 0.0 }
        | Hyperelastic::Yeoh { c10_mpa, c20_mpa: 0.0, c30_mpa: 0.0 } => {
            Hyperelastic::NeoHookean { mu_mpa: 2.0 * c10_mpa }
        }
        law => law,
    }
}

/// Error below which laws count as equal: the repeatability of such tests.
const EQUAL: f64 = 0.001;
/// Error by which a law may be worse on the tests and still be chosen for what it predicts beyond.
const COMPARABLE: f64 = 0.01;

impl Fitted {
    /// Up to which stretch the law is stable, in words.
    pub fn stability(&self) -> String {
        let at_all = || "at every stretch".into();
        self.stable_to.map_or_else(at_all, |stretch| format!("to a stretch of {stretch:.2}"))
    }

    /// Number of constants that are not zero.
    pub fn constants(&self) -> usize {
        self.law.constants().iter().filter(|(_, value)| *value != 0.0).count()
    }

    /// The first constant that the tests do not determine: its interval is unknown or exceeds the constant itself.
    pub fn undetermined(&self) -> Option<&'static str> {
        let mut constants = self.law.constants().into_iter().zip(&self.half_widths);
        let is_open = |value: f64, half_width: Option<f64>| {
            value != 0.0 && half_width.is_none_or(|half_width| half_width > UNDETERMINED * value.abs())
        };
        constants.find(|((_, value), half_width)| is_open(*value, **half_width)).map(|((name, _), _)| name)
    }

    /// Of the laws that describe the tests (up to twice the least error, or 1 % of the largest stress more), the one that describes them,
    /// their working strains and what lies beyond best. Among them, one with a constant that the tests do not determine is no candidate
    /// if there is another, so a term without evidence is dropped. Among equals (10 %, or 0.1 % of the largest stress) the law that is
    /// stable everywhere is preferred, then the one with fewer constants.
    pub fn best(mut fitted: Vec<Self>) -> Option<Self> {
        let least_error = fitted.iter().map(|f| f.error).min_by(f64::total_cmp)?;
        fitted.retain(|f| f.error <= (2.0 * least_error).max(least_error + COMPARABLE));
        if fitted.iter().any(|f| f.undetermined().is_none()) {
            fitted.retain(|f| f.undetermined().is_none());
        }
        let least = fitted.iter().map(|f| f.score).min_by(f64::total_cmp)?;
        fitted.retain(|f| f.score <= (1.1 * least).max(least + EQUAL));
        fitted.into_iter().min_by(|a, b| {
            let key = |f: &Self| (f.stable_to.is_some(), f.constants());
            key(a).cmp(&key(b)).then(a.score.total_cmp(&b.score))
        })
    }
}

/// Smallest and largest stretch of a bar whose first invariant the tests reach; the smallest is 1 unless a bar was compressed.
pub fn stretch_range(tests: &[Test]) -> [f64; 2] {
    let low = tests.iter().filter(|test| test.deformation == Deformation::Uniaxial);
    let low = low.flat_map(|test| &test.points).map(|p| p[0]).fold(1.0, f64::min);
    let high = stretch_at(tests.iter().flat_map(invariants).fold(3.0, f64::max));
    // A bar's compression has the invariant of a larger tension.
    let tension = tests.iter().any(|test| test.points.iter().any(|p| p[0] > 1.0));
    [low, if tension || low == 1.0 { high } else { 1.0 }]
}

fn invariants(test: &Test) -> impl Iterator<Item = f64> {
    test.points.iter().map(|p| test.deformation.invariant(p[0]))
}

/// Largest first invariant of the tests.
fn reach(tests: &[Test]) -> f64 {
    let [low, high] = stretch_range(tests);
    invariant(low).max(invariant(high))
}

fn is_stable(law: &Hyperelastic, reach: f64) -> bool {
    law.stable_to().is_none_or(|stretch| invariant(stretch) >= reach)
}

/// RMS of weighted relative errors; `None` without any.
fn combined(errors: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let (sum, weights) = errors.fold((0.0, 0.0), |(sum, weights), (weight, error)| {
        (sum + (weight * error).powi(2), weights + weight * weight)
    });
    (weights > 0.0).then(|| (sum / weights).sqrt())
}

/// Weighted rows of all tests.
struct Rows {
    points: Vec<(Deformation, f64)>,
    factor: Vec<f64>,
    stress: Vec<f64>,
}

impl Rows {
    fn of(tests: &[Test]) -> Self {
        let mut rows = Self { points: Vec::new(), factor: Vec::new(), stress: Vec::new() };
        for test in tests {
            let over_all = test.weight / (test.largest_mpa() * (test.points.len() as f64).sqrt());
            let working = test.working();
            let at_work = test.weight * test.working_weight
                / (working.rms_mpa() * (working.points.len() as f64).sqrt());
            for p in &test.points {
                let factor = if working.points.contains(p) { over_all.hypot(at_work) } else { over_all };
                rows.points.push((test.deformation, p[0]));
                rows.factor.push(factor);
                rows.stress.push(factor * p[1]);
            }
        }
        rows
    }

    /// Column of a law with unit constants.
    fn column(&self, law: &Hyperelastic) -> Vec<f64> {
        let value = |((deformation, stretch), factor): (&(Deformation, f64), &f64)| {
            factor * law.nominal_stress_mpa(*deformation, *stretch).unwrap_or(f64::INFINITY)
        };
        self.points.iter().zip(&self.factor).map(value).collect()
    }

    fn gram(&self, laws: &[Hyperelastic]) -> Gram {
        Gram::new(&laws.iter().map(|law| self.column(law)).collect::<Vec<_>>(), &self.stress)
    }
}

fn yeoh(c: &[f64]) -> Hyperelastic {
    Hyperelastic::Yeoh { c10_mpa: c[0], c20_mpa: c[1], c30_mpa: c.get(2).copied().unwrap_or(0.0) }
}

fn mooney_rivlin(c: &[f64]) -> Hyperelastic {
    Hyperelastic::MooneyRivlin { c10_mpa: c[0], c01_mpa: c[1] }
}

fn power(alpha: f64) -> Hyperelastic {
    ogden(&[1.0], &[alpha])
}

fn ogden(mu: &[f64], alpha: &[f64]) -> Hyperelastic {
    // Terms with a factor are written first; terms with nearly the same exponent are one.
    let mut terms: Vec<(f64, f64)> = Vec::new();
    for (mu, alpha) in mu.iter().copied().zip(alpha.iter().copied()).filter(|term| term.0 != 0.0) {
        match terms.iter_mut().find(|term| (term.1 - alpha).abs() < SAME_EXPONENT) {
            Some(term) => *term = (term.0 + mu, (term.0 * term.1 + mu * alpha) / (term.0 + mu)),
            None => terms.push((mu, alpha)),
        }
    }
    terms.resize(3, (0.0, 0.0));
    let [(mu1_mpa, alpha1), (mu2_mpa, alpha2), (mu3_mpa, alpha3)] = [terms[0], terms[1], terms[2]];
    Hyperelastic::Ogden { mu1_mpa, alpha1, mu2_mpa, alpha2, mu3_mpa, alpha3 }
}

fn solve(family: Family, rows: &Rows, reach: f64) -> Option<Hyperelastic> {
    let stable = |law: &Hyperelastic| law.shear_modulus_mpa() > 0.0 && is_stable(law, reach);
    // Linear laws: least squares where that is stable, otherwise with constants that are not negative.
    let linear = |units: &[Hyperelastic], law: fn(&[f64]) -> Hyperelastic| {
        let gram = rows.gram(units);
        let free = gram.solve().map(|(c, _)| law(&c)).filter(stable);
        free.or_else(|| gram.solve_signed(&vec![1.0; units.len()]).map(|(c, _)| law(&c)).filter(stable))
    };
    match family {
        Family::NeoHookean => {
            linear(&[Hyperelastic::NeoHookean { mu_mpa: 1.0 }], |c| Hyperelastic::NeoHookean { mu_mpa: c[0] })
        }
        Family::MooneyRivlin => linear(&[[1.0, 0.0], [0.0, 1.0]].map(|c| mooney_rivlin(&c)), mooney_rivlin),
        Family::Yeoh2 => linear(&[[1.0, 0.0], [0.0, 1.0]].map(|c| yeoh(&c)), yeoh),
        Family::Yeoh3 => linear(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|c| yeoh(&c)), yeoh),
        Family::Gent => {
            // Within 95 % of the limit, where the element accepts states.
            let least = (reach - 3.0) / 0.95;
            let limit = |x: f64| least * (1.0 + x.exp());
            let modulus_and_cost =
                |x: f64| rows.gram(&[Hyperelastic::Gent { mu_mpa: 1.0, jm: limit(x) }]).solve_signed(&[1.0]);
            let cost = |x: f64| modulus_and_cost(x).map_or(f64::INFINITY, |(_, sum)| sum);
            let start =
                (-12..=14).map(|k| 0.5 * f64::from(k)).min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
            let x = minimum(&[start], 0.2, |x| cost(x[0].clamp(-8.0, 10.0)))[0].clamp(-8.0, 10.0);
            Some(Hyperelastic::Gent { mu_mpa: modulus_and_cost(x)?.0[0], jm: limit(x) })
        }
        Family::Ogden1 => exponents(rows, 1),
        Family::Ogden2 => exponents(rows, 2),
        Family::Ogden3 => exponents(rows, 3),
    }
}

/// Sums of powers with `mu alpha >= 0`, stable at every stretch.
fn exponents(rows: &Rows, terms: usize) -> Option<Hyperelastic> {
    let count = (LARGEST_EXPONENT / GRID_STEP) as i32;
    let grid: Vec<f64> = (-count..=count).filter(|k| *k != 0).map(|k| GRID_STEP * f64::from(k)).collect();
    let gram = rows.gram(&grid.iter().map(|alpha| power(*alpha)).collect::<Vec<_>>());
    let mut best: Vec<(f64, Vec<usize>)> = Vec::new();
    let mut consider = |chosen: Vec<usize>| {
        let signs: Vec<f64> = chosen.iter().map(|k| grid[*k].signum()).collect();
        if let Some((_, sum)) = gram.part(&chosen).solve_signed(&signs) {
            best.push((sum, chosen));
        }
    };
    for i in 0..grid.len() {
        match terms {
            1 => consider(vec![i]),
            2 => (i + 1..grid.len()).for_each(|j| consider(vec![i, j])),
            // A coarser grid for three terms.
            _ => {
                for j in (i + 1..grid.len()).filter(|j| i % 3 == 0 && j % 3 == 1) {
                    (j + 1..grid.len()).filter(|k| k % 3 == 2).for_each(|k| consider(vec![i, j, k]));
                }
            }
        }
    }
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    let law_and_cost = |x: &[f64]| {
        let alpha: Vec<f64> = x.iter().map(|a| a.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT)).collect();
        if alpha.iter().any(|a| a.abs() < 0.05) {
            return None;
        }
        let signs: Vec<f64> = alpha.iter().map(|a| a.signum()).collect();
        let gram = rows.gram(&alpha.iter().map(|a| power(*a)).collect::<Vec<_>>());
        gram.solve_signed(&signs).map(|(mu, sum)| (ogden(&mu, &alpha), sum))
    };
    let refine = |(_, chosen): &(f64, Vec<usize>)| {
        let start: Vec<f64> = chosen.iter().map(|k| grid[*k]).collect();
        law_and_cost(&minimum(&start, 0.3, |x| law_and_cost(x).map_or(f64::INFINITY, |(_, sum)| sum)))
    };
    best.iter().take(2).filter_map(refine).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(law, _)| law)
}

/// RMS error beyond a strain of a law that is fitted below it, over several strains; `None` if a part has too few rows for the law.
fn beyond(family: Family, tests: &[Test], reach: f64) -> Option<f64> {
    let mut squares = Vec::new();
    for fraction in FITTED_BELOW {
        let split = |test: &Test, is_below: bool| {
            let largest = test.points.iter().map(|p| (p[0] - 1.0).abs()).fold(0.0, f64::max);
            test.part(|strain| (strain <= fraction * largest) == is_below)
        };
        let below: Vec<Test> = tests.iter().map(|test| split(test, true)).collect();
        let law = solve(family, &Rows::of(&below), reach)?;
        let errors = tests
            .iter()
            .map(|test| (test.weight, split(test, false).error_mpa(&law)[0] / test.largest_mpa()));
        squares.push(combined(errors)?.powi(2));
    }
    Some(mean(squares).sqrt())
}

/// Half-widths of the 95 % intervals from the Jacobian at the solution. Residuals of neighbouring stretches are correlated: the number of
/// independent ones is `n (1 - r) / (1 + r)` with the correlation `r` of neighbours.
fn half_widths(law: &Hyperelastic, tests: &[Test]) -> Vec<Option<f64>> {
    let rows = Rows::of(tests);
    let constants = law.constants();
    let residuals: Vec<f64> = rows.column(law).iter().zip(&rows.stress).map(|(a, b)| a - b).collect();
    let open: Vec<usize> = (0..constants.len()).filter(|k| constants[*k].1 != 0.0).collect();
    let mut columns: Vec<Vec<f64>> = open
        .iter()
        .map(|k| {
            let step = 1.0e-5 * constants[*k].1;
            let (up, down) = (rows.column(&law.with(*k, step)), rows.column(&law.with(*k, -step)));
            up.iter().zip(&down).map(|(up, down)| (up - down) / 2.0e-5).collect()
        })
        .collect();
    let mut begin = 0;
    for test in tests {
        let rows_of_test = begin..begin + test.points.len();
        begin = rows_of_test.end;
        if test.shape_only {
            let stress_of_test =
                |(row, stress): (usize, &f64)| if rows_of_test.contains(&row) { *stress } else { 0.0 };
            columns.push(rows.stress.iter().enumerate().map(stress_of_test).collect());
        }
    }
    let sum: f64 = residuals.iter().map(|r| r * r).sum();
    let neighbours: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let correlation = if sum > 0.0 { (neighbours / sum).clamp(0.0, 0.99) } else { 0.0 };
    let n = residuals.len() as f64;
    let independent = (n * (1.0 - correlation) / (1.0 + correlation)).max(2.0);
    let free = (independent - columns.len() as f64).max(1.0);
    let product = |a: usize, b: usize| columns[a].iter().zip(&columns[b]).map(|(x, y)| x * y).sum::<f64>();
    let matrix: Vec<Vec<f64>> =
        (0..columns.len()).map(|a| (0..columns.len()).map(|b| product(a, b)).collect()).collect();
    let mut half_widths = vec![None; constants.len()];
    if let Some(inverse) = inverse(&matrix) {
        // Relative to the constants: the columns are derivatives with respect to their logarithms.
        for (index, k) in open.iter().enumerate() {
            let relative = 1.96 * (inverse[index][index] * sum / free).sqrt();
            half_widths[*k] = Some(relative * constants[*k].1.abs());
        }
    }
    half_widths
}
