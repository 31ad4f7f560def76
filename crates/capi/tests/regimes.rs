//! Names of models' own regimes in C: from a running twin, also after a reload, and from a model in this process.

use capi::softtwin_status::{SOFTTWIN_ABSENT, SOFTTWIN_ARGUMENT, SOFTTWIN_OK};
use capi::{softtwin_bus, softtwin_model, softtwin_status};
use std::ffi::{CStr, CString, c_char};
use std::path::Path;
use std::ptr::null_mut;
use tests::strip::{self, Loads};
use tests::wait::wait_state;
use tests::{Program, Stage};
use wire::layout::regime;
use wire::{StateReader, Topic};

/// `SOFTTWIN_REGIME_NAME_SIZE` of the header.
const SIZE: usize = 33;

/// Status and text of a call that writes a name.
fn written(call: impl FnOnce(*mut c_char, usize) -> softtwin_status) -> (softtwin_status, String) {
    let mut room = [0x55_u8; SIZE];
    let status = call(room.as_mut_ptr().cast(), room.len());
    let text = CStr::from_bytes_until_nul(&room).expect("an end").to_str().expect("UTF-8");
    (status, text.to_owned())
}

fn told(bus: *mut softtwin_bus, hash: &[u8; 16], number: u32) -> (softtwin_status, String) {
    // SAFETY: the bus is live, the hash has 16 bytes, the room as many as are said.
    written(|room, size| unsafe { capi::softtwin_regime_name(bus, hash.as_ptr(), number, room, size) })
}

fn of_model(model: *const softtwin_model, number: u32) -> (softtwin_status, String) {
    // SAFETY: the model is live, the room has as many bytes as are said.
    written(|room, size| unsafe { capi::softtwin_model_regime_name(model, number, room, size) })
}

fn open_bus(stage: &Stage) -> *mut softtwin_bus {
    let [domain, root] = [stage.domain_name.clone(), stage.root().display().to_string()]
        .map(|text| CString::new(text).unwrap());
    let mut bus = null_mut();
    // SAFETY: texts and place live across the call.
    assert_eq!(unsafe { capi::softtwin_bus_open(domain.as_ptr(), root.as_ptr(), &mut bus) }, SOFTTWIN_OK);
    bus
}

#[test]
fn a_running_twin_tells_the_names_and_a_reload_brings_those_of_the_other_model() {
    let stage = Stage::with_model("capiregimes", &[]);
    let scene = strip::scene(&stage, &strip::model_bytes(["straight", "up", "down"]));
    let mut twin = Program::twin(&stage, &scene);
    let (local, bus) = (stage.bus(), open_bus(&stage));
    let states = StateReader::open(&local, &Topic::state("strip").unwrap()).unwrap();
    let mut loads = Loads::new(&local);
    loads.send(13.0);
    let first = wait_state(&states, "the first state", |state| state.regime == regime::NAMED2);
    let name = |text: &str| text.to_owned();
    assert_eq!(told(bus, &first.model_hash, first.regime), (SOFTTWIN_OK, name("up")));
    for (number, text) in [(regime::UNKNOWN, "unknown"), (regime::FREE, "free"), (regime::CONTACT, "contact")]
    {
        assert_eq!(told(bus, &first.model_hash, number), (SOFTTWIN_OK, name(text)));
    }
    assert_eq!(told(bus, &first.model_hash, 18), (SOFTTWIN_ABSENT, name("regime 18")), "it has three");
    assert_eq!(told(bus, &[7; 16], regime::NAMED1), (SOFTTWIN_ABSENT, name("regime 3")), "no such twin");
    // SAFETY: the text lives until the next call of this thread.
    let said = unsafe { CStr::from_ptr(capi::softtwin_last_error()) }.to_str().unwrap();
    assert!(said.contains("no running twin") && said.contains("0707"), "{said}");
    std::fs::write(stage.path("strip.twin"), strip::model_bytes(["rest", "high", "low"])).unwrap();
    twin.signal(libc::SIGHUP);
    twin.wait_for("reloaded");
    loads.send(13.0);
    let after = |state: &wire::State| state.model_hash != first.model_hash && state.regime == first.regime;
    let second = wait_state(&states, "a state of the other model", after);
    assert_eq!(told(bus, &second.model_hash, second.regime), (SOFTTWIN_OK, name("high")));
    assert!(twin.stop().0.success());
    assert_eq!(told(bus, &second.model_hash, second.regime), (SOFTTWIN_OK, name("high")), "it stays known");
    // SAFETY: nulls are what is asked about; the bus is live until it is closed.
    unsafe {
        let mut room = [0; 4];
        let at = room.as_mut_ptr();
        let hash = second.model_hash.as_ptr();
        assert_eq!(capi::softtwin_regime_name(bus, std::ptr::null(), 3, at, 4), SOFTTWIN_ARGUMENT);
        assert_eq!(capi::softtwin_regime_name(bus, hash, 4, null_mut(), SIZE), SOFTTWIN_ARGUMENT);
        assert_eq!(
            capi::softtwin_regime_name(bus, hash, 4, at, 4),
            SOFTTWIN_ARGUMENT,
            "`high` has five bytes"
        );
        assert_eq!(capi::softtwin_regime_name(bus, hash, 1, null_mut(), 0), SOFTTWIN_ARGUMENT);
        assert_eq!(room, [0; 4], "nothing is written without room");
        capi::softtwin_bus_close(bus);
    }
}

#[test]
fn a_model_without_a_daemon_has_its_names() {
    let stage = Stage::new("capinames");
    let longest = "n".repeat(32);
    std::fs::write(stage.path("strip.twin"), strip::model_bytes(["straight", &longest, "down"])).unwrap();
    let models = ["strip.twin", "beam.twin"].map(|name| {
        let path = CString::new(stage.path(name).display().to_string()).unwrap();
        let mut model = null_mut();
        // SAFETY: the path and the place live across the call.
        assert_eq!(unsafe { capi::softtwin_model_open(path.as_ptr(), &mut model) }, SOFTTWIN_OK);
        model
    });
    let [strip, beam] = models;
    assert_eq!(of_model(strip, 3), (SOFTTWIN_OK, "straight".into()));
    assert_eq!(of_model(strip, 4), (SOFTTWIN_OK, longest));
    assert_eq!(of_model(strip, 6), (SOFTTWIN_ABSENT, "regime 6".into()));
    assert_eq!(of_model(beam, 2), (SOFTTWIN_OK, "contact".into()));
    assert_eq!(of_model(beam, 3), (SOFTTWIN_ABSENT, "regime 3".into()));
    // SAFETY: both are live and closed once.
    models.into_iter().for_each(|model| unsafe { capi::softtwin_model_close(model) });
}

#[test]
fn the_size_of_the_header_holds_the_longest_name() {
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/softtwin.h");
    let text = std::fs::read_to_string(header).unwrap();
    assert!(text.contains(&format!("#define SOFTTWIN_REGIME_NAME_SIZE {SIZE}\n")));
    assert_eq!(SIZE, rom::names::MAX_LENGTH + 1);
}
