//! After its start the twin's loop allocates nothing of its own: an allocator that counts is watching. What is counted is
//! exactly the transport's small handle for each loaned sample, and nothing else.

use runtime::config::{Scene, Settings};
use runtime::load::load_scene;
use runtime::twin::{Twin, event_channel};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;
use tests::Stage;
use wire::{FieldReader, SensorSample, SensorWriter, StateReader, Topic, now_ns};

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator unchanged; the counter does not allocate (const-initialised,
// without a destructor).
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: the caller's promises are the ones that `System` asks for.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn the_loop_allocates_nothing_but_the_transports_sample_handles() {
    let stage = Stage::new("alloc");
    let path = stage.finger("kind = \"simulate\"");
    let scene = Scene::load(&path).unwrap();
    let bus = stage.bus();
    let loaded = load_scene(&scene, &path).unwrap();
    let (events, _reporter) = event_channel();
    let mut twin = Twin::start(&bus, loaded, &Settings::default(), &events).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let fields = FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let mut send_and_turn = |seq: u64| {
        // Rises through the onset, with every tenth reading a bad one.
        let pressure_mpa = if seq % 10 == 7 { f64::NAN } else { 0.06 * seq as f64 / 400.0 };
        let t_sensor_ns = now_ns();
        let sample =
            SensorSample { boot_id: 5, seq, t_sensor_ns, pressure_mpa, gap_mm: 30.0, ..Default::default() };
        sensor.publish(sample).unwrap();
        let before = COUNT.get();
        twin.turn(Duration::from_millis(100));
        let allocations = COUNT.get() - before;
        assert!(states.newest().unwrap().is_some());
        drop(fields.newest().unwrap());
        allocations
    };
    // The first rounds connect the ports that were opened after the twin.
    let warm_up: u64 = (1..=20).map(&mut send_and_turn).sum();
    let steady: u64 = (21..=400).map(&mut send_and_turn).sum();
    // 342 good readings with a state and two fields each, 38 held ones with a state.
    let samples = 342 * 3 + 38;
    assert_eq!(steady, samples, "{steady} allocations for {samples} samples ({warm_up} while warming up)");
    let health = twin.health().next().unwrap();
    assert_eq!(health.received, 400);
    assert_eq!(health.count(wire::Outcome::HeldNotFinite), 40);
    assert_eq!(health.count(wire::Outcome::Published), 360);
}
