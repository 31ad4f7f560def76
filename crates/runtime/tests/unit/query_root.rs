//! Tests of `src/query/solve.rs` that need its private parts.

use super::*;

fn solve(f: impl Fn(f64) -> f64, range: [f64; 2], value: f64) -> Option<Root> {
    let at = |i: i32| range[0] + (range[1] - range[0]) * f64::from(i) / 8.0;
    let samples: Vec<Sample> = (0..=8).map(|i| (at(i), f(at(i)))).collect();
    first_root(&samples, SearchTarget { value, tolerance: 1e-12 }, &mut |x| f(x))
}

#[test]
fn a_root_gives_the_value_back_or_there_is_none() {
    let cube = |x: f64| x * x * x - x;
    for value in [-0.3, 0.0, 0.37, 5.9] {
        let root = solve(cube, [0.0, 2.0], value).expect("within the range");
        assert!((cube(root.at()) - value).abs() <= 1e-12);
    }
    assert_eq!(solve(cube, [2.0, 0.0], 6.1), None, "beyond the range");
    assert_eq!(solve(cube, [0.0, 2.0], f64::NAN), None);
    assert_eq!(solve(|x| if x < 0.7 { 0.0 } else { 1.0 }, [0.0, 2.0], 0.5), None, "a jump is no root");
    assert_eq!(solve(|x| if x < 0.7 { 0.0 } else { f64::NAN }, [0.0, 2.0], 0.5), None);
}
