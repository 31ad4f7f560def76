//! A loop in C allocates nothing for a sample: neither for states nor for fields, waiting and time-outs included.

use capi::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::{CString, c_int};
use std::ptr::null_mut;
use tests::{Program, Stage};

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counted;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

const OK: softtwin_status = softtwin_status::SOFTTWIN_OK;

/// A reader that is attached before the twin exists.
fn attach(bus: *mut softtwin_bus, kind: &str, wakes: c_int) -> *mut softtwin_reader {
    let (name, kind) = (CString::new("finger").unwrap(), CString::new(kind).unwrap());
    let mut reader = null_mut();
    // SAFETY: the bus is live, the strings live across the call, the place is ours.
    let status = unsafe {
        softtwin_reader_attach(bus, name.as_ptr(), kind.as_ptr(), std::ptr::null(), wakes, &mut reader)
    };
    assert_eq!(status, OK);
    reader
}

#[test]
fn a_loop_over_two_readers_allocates_nothing_of_its_own() {
    let stage = Stage::new("capialloc");
    let domain = CString::new(stage.domain_name.clone()).unwrap();
    let root = CString::new(stage.root().display().to_string()).unwrap();
    let (mut bus, mut waiter, mut descriptor) = (null_mut(), null_mut(), -1);
    // SAFETY: strings and places live across the calls; handles are live, and used by this thread, until they are closed.
    unsafe {
        assert_eq!(softtwin_bus_open(domain.as_ptr(), root.as_ptr(), &mut bus), OK);
        let (states, fields) = (attach(bus, "state", 1), attach(bus, "field", 0));
        let mut readers = [states, fields];
        assert_eq!(softtwin_waiter_open(readers.as_mut_ptr(), 2, &mut waiter), OK);
        assert_eq!(softtwin_waiter_descriptor(waiter, &mut descriptor), OK);
        assert_eq!(softtwin_waiter_wait(waiter, 1000), softtwin_status::SOFTTWIN_TIMEOUT, "no twin yet");

        let scene = stage.finger("kind = \"simulate\"\nrate_hz = 500.0\ngap_mm = 25.0");
        let _twin = Program::twin(&stage, &scene);
        let _bridge = Program::bridge(&stage, &scene);
        let (mut received, mut lost, mut seen_fields, mut before) = (0u64, 0u64, 0u64, 0);
        let mut state = wire::State::default();
        // The first samples connect the ports: what that takes is no part of the loop.
        while received < 600 {
            if received < 100 {
                before = COUNT.get();
                seen_fields = 0;
            }
            let mut event = libc::pollfd { fd: descriptor, events: libc::POLLIN, revents: 0 };
            assert_eq!(libc::poll(&mut event, 1, 30_000), 1, "the descriptor does not tell");
            softtwin_waiter_wait(waiter, 0);
            let place = (&raw mut state).cast();
            while softtwin_reader_read(states, 0, 0, place, size_of::<wire::State>()) == OK {}
            let mut field = null_mut();
            if softtwin_reader_read_field(fields, 1, 0, &mut field) == OK {
                seen_fields += 1;
                softtwin_field_release(field);
            }
            assert_eq!(softtwin_reader_counts(states, &mut received, &mut lost), OK);
        }
        let allocated = COUNT.get() - before;
        assert!(seen_fields > 100, "{seen_fields} fields");
        println!(
            "{allocated} allocations for {} states and {seen_fields} fields, {lost} lost",
            received - 100
        );
        assert_eq!(allocated, 0);
        softtwin_waiter_close(waiter);
        softtwin_reader_close(states);
        softtwin_reader_close(fields);
        softtwin_bus_close(bus);
    }
}

#[test]
fn a_control_cycle_allocates_nothing() {
    let stage = Stage::new("capicontrolalloc");
    let path = CString::new(stage.path("beam.twin").display().to_string()).unwrap();
    let (mut model, mut control) = (null_mut(), null_mut());
    // SAFETY: strings and places live across the calls, a reading is four numbers, a cycle is 56 bytes.
    unsafe {
        assert_eq!(softtwin_model_open(path.as_ptr(), &mut model), OK);
        let held = c"force_n".as_ptr();
        let status = softtwin_control_open(model, std::ptr::null(), std::ptr::null(), held, &mut control);
        assert_eq!(status, OK);
        let (reading, mut cycle) = ([0.04, 25.0, 0.02, f64::NAN], [0u64; 7]);
        let before = COUNT.get();
        for k in 1..100 {
            let place = (&raw mut cycle).cast();
            let status =
                softtwin_control_step(control, k * 5_000_000, 0.03, 0.0, reading.as_ptr().cast(), place);
            assert_eq!(status, OK);
            let (ahead, reading) = ([0.03, 0.04], reading.as_ptr().cast());
            let t_ns = k * 5_000_000 + 1;
            let status = softtwin_control_step_ahead(control, t_ns, ahead.as_ptr(), 2, 0.1, reading, place);
            assert_eq!(status, OK);
        }
        assert_eq!(COUNT.get() - before, 0);
        softtwin_control_close(control);
        softtwin_model_close(model);
    }
}
