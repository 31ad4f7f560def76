//! A twin that is awake when a reading is expected: nothing is lost, the share of a core is kept, and it is off on request.

use softtwin::resources::cpu_s;
use tests::wait::{states, wait_for};
use tests::{Program, Stage};

const READINGS: u64 = 3000;
/// Readings left out at the start: first turns touch cold memory.
const WARM_UP: u64 = 200;

/// What a twin did with readings at 1 kHz.
struct Served {
    /// Processor time of its process over the time of the readings.
    share: f64,
    said: Vec<String>,
}

/// Has a twin with these real-time settings answer readings at 1 kHz, and takes every answer.
fn serve(stage: &Stage, realtime: &str) -> Served {
    let scene = stage.whole_finger("kind = \"simulate\"\nrate_hz = 1000.0\ngap_mm = 25.0");
    // Every reading is answered, also after an interruption.
    let text = std::fs::read_to_string(&scene).expect("just written");
    let scene = stage.write("scene.toml", &text.replace("model =", "backlog = 1024\nmodel ="));
    let settings = stage.write("twin.toml", &format!("[realtime]\n{realtime}")).display().to_string();
    let scene_path = scene.display().to_string();
    let mut twin = Program::daemon(stage, &["twin", "--scene", &scene_path, "--config", &settings]);
    twin.wait_for("ready:");
    let bus = stage.bus();
    let reader = states(&bus);
    let bridge = Program::bridge(stage, &scene);
    let process = twin.id().to_string();
    let used_s = || cpu_s(&process).expect("the twin lives");
    let (mut begin, mut last_seq) = (None, 0);
    let (begin, end) = wait_for(&reader, "answers", |reader| {
        while let Some(state) = reader.next().expect("readable") {
            if state.sensor_seq == 0 || state.sensor_seq == last_seq {
                continue; // sent by the clock: no reading stands behind it
            }
            if last_seq > 0 {
                assert_eq!(state.sensor_seq, last_seq + 1, "a reading was lost");
            }
            last_seq = state.sensor_seq;
            let now = (state.t_sensor_ns, used_s());
            if last_seq >= WARM_UP {
                begin.get_or_insert(now);
            }
            if last_seq >= WARM_UP + READINGS {
                return Some((begin.expect("earlier"), now));
            }
        }
        None
    });
    drop(bridge);
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:?}");
    Served { share: (end.1 - begin.1) / ((end.0 - begin.0) as f64 * 1e-9), said }
}

/// The line that tells what spinning came to: share in %, readings that came meanwhile.
fn spun(said: &[String]) -> Option<(f64, u64)> {
    let line = said.iter().find(|line| line.contains("% of a core for expected readings"))?;
    let after = |text: &str| line.split_once(text).expect(text).1.split(' ').next().expect("a word");
    Some((after("spun ").parse().expect("a number"), after("readings: ").parse().expect("a number")))
}

#[test]
fn a_twin_that_expects_readings_answers_all_within_its_share_of_a_core() {
    let stage = Stage::new("asleep");
    let asleep = serve(&stage, "spin_share = 0.0");
    assert!(asleep.said.iter().any(|line| line.contains("between readings it sleeps until woken")));
    assert_eq!(spun(&asleep.said), None, "it is off on request");

    let stage = Stage::new("expects");
    let expecting = serve(&stage, "spin_share = 0.2");
    let waits = "it sleeps, then spins before each expected one, at most 20 % of a core";
    assert!(expecting.said.iter().any(|line| line.contains(waits)), "{:?}", expecting.said);
    let (percent, meanwhile) = spun(&expecting.said).expect("it says what spinning came to");
    // How many depends on what else the machine does.
    assert!(meanwhile > 0, "no reading came while it spun: {:?}", expecting.said);
    assert!(percent > 0.0 && percent < 20.1, "{percent} %");
    // What answering costs differs between the two runs, so some room is left beside the share.
    let most = 0.2 + 1.5 * asleep.share + 0.05;
    assert!(expecting.share < most, "{} of a core, asleep {}", expecting.share, asleep.share);
    println!(
        "of a core: asleep {:.3}, expecting {:.3}, of them spun {percent} %",
        asleep.share, expecting.share
    );
}
