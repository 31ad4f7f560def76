//! Tests of `src/tracks.rs` that need its private parts.

use super::*;
use crate::message::EncodeJson;
use wire::Payload;

#[test]
fn thinned_list_is_bounded_and_even() {
    let mut list = Thinned::new(100);
    (0..100_000).for_each(|k| list.offer(|| Some(k)));
    assert!(list.len() <= 100 && list.len() > 40, "{}", list.len());
    let step = list[1] - list[0];
    assert!(list[0] == 0 && list.windows(2).all(|pair| pair[1] - pair[0] == step), "{:?}", &list[..]);
}

#[test]
fn thinned_states_keep_every_peak() {
    let state =
        |k: usize| RecordedState { t_s: k as f64, values: State { gap_mm: 30.0, ..State::default() } };
    let mut states: Vec<RecordedState> = (0..10_000).map(state).collect();
    for (k, force_n) in [(777, 5.0), (778, -1.0), (9_999, 3.0)] {
        states[k].values.contact_force_n = force_n;
    }
    states[5_000].values.pressure_mpa = 0.09;
    keep_peaks(&mut states);
    assert!(states.len() <= 10_000 / 4 + GROUP, "{}", states.len());
    for (t_s, force_n) in [(777.0, 5.0), (778.0, -1.0), (9_999.0, 3.0)] {
        assert!(states.iter().any(|s| s.t_s == t_s && s.values.contact_force_n == force_n), "{t_s}");
    }
    assert!(states.iter().any(|s| s.values.pressure_mpa == 0.09));
    assert!(states.windows(2).all(|pair| pair[0].t_s < pair[1].t_s));
}

#[test]
fn reading_a_recording_ends_at_the_stop_flag() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = crate::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let topic = crate::message::channel(State::LAYOUT, "softtwin/finger/state");
    let channel = writer.channel(&topic).unwrap();
    let mut bytes = Vec::new();
    State::default().view().encode(&mut bytes);
    writer.message(channel, 0, 0, 0, &bytes).unwrap();
    writer.finish().unwrap();
    let read =
        |stop: bool| RecordingData::read(&RecordingFiles::open(&path).unwrap(), None, &AtomicBool::new(stop));
    assert!(read(false).is_ok());
    assert!(matches!(read(true), Err(ReadError::Stopped { .. })));
}
