//! Tests of `src/readings.rs`.

use super::*;

fn reading(k: u64) -> Reading {
    let state = State { t_publish_ns: 1_000_000 * k, pressure_mpa: k as f64, ..State::default() };
    Reading::of_state(&state)
}

fn header(message: &[u8]) -> serde_json::Value {
    let length = u32::from_le_bytes(message[..4].try_into().expect("four bytes")) as usize;
    serde_json::from_slice(&message[4..4 + length]).expect("JSON")
}

#[test]
fn estimates_are_sent_by_name_with_the_readings() {
    let (mut readings, mut page) = (Readings::default(), Cursors::new());
    let mut estimate = Estimate { unknown_count: 2, ..Estimate::default() };
    ["gap_mm", "pressure_bias_mpa"].iter().enumerate().for_each(|(at, name)| estimate.set_name(at, name));
    estimate.values[..2].copy_from_slice(&[40.0, 0.001]);
    estimate.sigmas[..2].copy_from_slice(&[1.0, 0.002]);
    readings.push("left", reading(1));
    readings.push("left", Reading::of_estimate(&estimate));
    let messages = readings.since(&mut page);
    let columns: Vec<_> = messages.iter().map(|message| header(message)["columns"].clone()).collect();
    assert_eq!(columns[0], serde_json::json!(COLUMNS));
    let named = ["estimate gap_mm", "estimate pressure_bias_mpa", "sigma gap_mm", "sigma pressure_bias_mpa"];
    assert_eq!(columns[1], serde_json::json!(named));
    assert!(readings.since(&mut page).is_empty(), "nothing twice");
}

#[test]
fn client_gets_every_reading_once_and_a_late_one_the_newest() {
    let (mut readings, mut page) = (Readings::default(), Cursors::new());
    (1..=3).for_each(|k| readings.push("left", reading(k)));
    let messages = readings.since(&mut page);
    assert_eq!(messages.len(), 1);
    assert_eq!(header(&messages[0])["count"], 3);
    assert!(readings.since(&mut page).is_empty(), "nothing twice");
    (4..4 + 2 * KEPT as u64).for_each(|k| readings.push("left", reading(k)));
    let messages = readings.since(&mut page);
    assert_eq!(header(&messages[0])["count"], KEPT, "what a page missed for long is gone");
    let end = messages[0].len();
    let newest = f32::from_le_bytes(
        messages[0][end - 4 * 5 * KEPT - 4..end - 4 * 5 * KEPT].try_into().expect("four bytes"),
    );
    assert_eq!(newest, (3 + 2 * KEPT) as f32, "the last pressure is the newest one");
}
