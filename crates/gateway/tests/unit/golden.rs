//! Messages that `rosbags` writes (test_ros2_golden.py), as hexadecimal digits.

/// The bytes of a file of digits.
pub fn bytes(digits: &str) -> Vec<u8> {
    let digits: String = digits.lines().collect();
    (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect()
}
