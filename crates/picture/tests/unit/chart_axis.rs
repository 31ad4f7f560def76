//! Tests of `src/chart/axis.rs`.

use super::*;

#[test]
fn decades_enclose_the_positive_values() {
    let axis = Axis::log("mse");
    assert_eq!(axis.range([3e-4, 0.0, f64::NAN, 2.0].into_iter()), -4.0..1.0);
    assert_eq!(axis.text(-4.0, 1), "1e-4");
    assert_eq!(axis.text(-2.0, 1), "0.01");
    assert_eq!(axis.text(0.5, 1), "");
}

#[test]
fn touching_names_are_omitted() {
    let names: Vec<String> = (1..=16).map(|k| format!("check{k:02}")).collect();
    let axis = Axis::names("case", names);
    let written = |length: u32| {
        let stride = axis.stride(length, 50);
        (0..16).map(|k| axis.text(f64::from(k), stride)).filter(|text| !text.is_empty()).count()
    };
    assert_eq!((written(800), written(799), written(1)), (16, 8, 1));
}

#[test]
fn numbers_are_short() {
    assert_eq!(number(0.05), "0.05");
    assert_eq!(number(-0.0), "0");
    assert_eq!(number(1.0), "1");
    assert_eq!(number(2e-7), "2.0e-7");
}

#[test]
fn axis_without_values_has_a_range() {
    assert_eq!(Axis::linear("x").range(std::iter::empty()), 0.0..1.0);
    assert_eq!(Axis::linear("gap").range([40.0, 40.0].into_iter()), 38.0..42.0);
}
