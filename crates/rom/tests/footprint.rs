//! The plate that the paper's actuator presses.

use rom::snapshots::Footprint;

#[test]
fn plate_below_the_papers_actuator_has_the_papers_extent() {
    let corners = [[0.0, 0.0, 0.0], [115.0, 19.0, 32.0]];
    assert_eq!(Footprint::plate_below(&corners), Some(Footprint::PLATE));
    assert_eq!(Footprint::plate_below(&[]), None);
}
