//! Tests of `src/resources.rs`.

use super::*;

#[test]
fn processor_time_and_memory_are_parsed_for_any_process_name() {
    let stat = "12 (a b) c) S 1 12 12 0 -1 4194304 500 0 0 0 250 50 0 0 20 0 2 0 100 0 0";
    assert_eq!(cpu_of(stat), Some(3.0));
    assert_eq!(cpu_of("12 (cut"), None);
    assert_eq!(status_of("VmPeak:\t 9 kB\nVmHWM:\t  2048 kB\n", "VmHWM"), Some(2048));
    assert_eq!(status_of("", "VmHWM"), None);
}
