//! Damaged inputs at every entrance: the bodies of the fuzz targets, on stable, with every allocation watched.
//!
//! `SOFTTWIN_INPUTS=10000000 cargo test --workspace --test inputs -- --nocapture` tries 10000000 inputs over all entrances
//! and says how many it tried, the largest allocation and the slowest input of each entrance. `SOFTTWIN_ENTRANCES=frd,xplt` tries
//! these only, each as often.

use rom::rng::Rng;
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tests::inputs::{ENTRANCES, Entrance, MAX_INPUT, damage};

/// No input of at most [`MAX_INPUT`] bytes may make a reader ask for more than this at once.
const LARGEST_ALLOCATION: usize = 64 << 20;

/// The system's allocator, with the largest request noted.
struct Watching;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator unchanged; noting a number allocates nothing.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc_zeroed`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `realloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watching = Watching;

/// Share of an entrance in thousandths: a model file takes longer than a key expression.
fn share(entrance: &Entrance) -> usize {
    match entrance.name {
        "model" | "model_header" => 5,
        "npy" | "npz" => 20,
        "config" => 45,
        "recording" => 90,
        "key" => 120,
        "frd" | "vtu" | "pvd" | "inp" | "dat" | "msh" | "chunk" => 20,
        "npz_arrays" | "vtu_arrays" => 20,
        "selector" | "websocket" => 30,
        _ => 220,
    }
}

/// Default number of inputs; takes seconds.
const USUAL_TOTAL: usize = 120_000;

#[test]
fn damaged_inputs_panic_at_no_entrance() {
    let asked: Option<usize> =
        std::env::var("SOFTTWIN_INPUTS").ok().map(|count| count.parse().expect("a number"));
    let wanted = asked.unwrap_or(USUAL_TOTAL);
    let chosen = std::env::var("SOFTTWIN_ENTRANCES").ok();
    let chosen: Option<Vec<&str>> = chosen.as_ref().map(|names| names.split(',').collect());
    let unknown = |name: &&&str| ENTRANCES.iter().all(|entrance| entrance.name != **name);
    assert_eq!(chosen.iter().flatten().find(unknown), None, "no such entrance");
    let mut total = 0;
    for entrance in
        ENTRANCES.iter().filter(|one| chosen.as_ref().is_none_or(|names| names.contains(&one.name)))
    {
        let count = chosen.as_ref().map_or_else(|| (wanted * share(entrance)).div_ceil(1000), |_| wanted);
        let (largest, slowest) = try_all(entrance, count);
        assert!(largest <= LARGEST_ALLOCATION, "{}: {largest} bytes at once", entrance.name);
        println!(
            "{}: {count} inputs, largest allocation {largest} bytes, slowest {slowest:?}",
            entrance.name
        );
        total += count;
    }
    println!("{total} inputs over {} entrances", ENTRANCES.len());
    assert!(total >= wanted, "{total} of {wanted}");
}

/// Tries `count` damaged inputs; returns the largest allocation and the longest time. An input that makes the entrance panic is kept.
fn try_all(entrance: &Entrance, count: usize) -> (usize, Duration) {
    let seed = (entrance.seed)();
    assert!(seed.len() <= MAX_INPUT, "{}", entrance.name);
    (entrance.body)(&seed);
    let mut random = Rng::new(seed.len() as u64);
    let mut slowest = Duration::ZERO;
    LARGEST.store(0, Ordering::Relaxed);
    for _ in 0..count {
        let input = damage(&seed, &mut random);
        let begin = Instant::now();
        if let Err(panic) = std::panic::catch_unwind(|| (entrance.body)(&input)) {
            keep(entrance, &input);
            std::panic::resume_unwind(panic);
        }
        slowest = slowest.max(begin.elapsed());
    }
    (LARGEST.load(Ordering::Relaxed), slowest)
}

/// Where found cases are kept.
fn corpus(entrance: &Entrance) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(entrance.name)
}

fn keep(entrance: &Entrance, input: &[u8]) {
    let path = corpus(entrance).join(format!(
        "found-{:016x}",
        input.iter().fold(7u64, |hash, byte| hash.wrapping_mul(31) ^ u64::from(*byte))
    ));
    let kept = std::fs::create_dir_all(corpus(entrance)).and_then(|()| std::fs::write(&path, input));
    println!("this input broke {}: {} ({kept:?})", entrance.name, path.display());
}

/// Inputs of earlier failures.
#[test]
fn inputs_of_earlier_failures_are_handled() {
    let mut tried = 0;
    for entrance in &ENTRANCES {
        for entry in std::fs::read_dir(corpus(entrance)).into_iter().flatten().flatten() {
            (entrance.body)(&std::fs::read(entry.path()).unwrap());
            tried += 1;
        }
    }
    println!("{tried} found cases tried");
}
