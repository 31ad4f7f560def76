//! The only place that names bincode: a header to bytes and back, fixed-width little-endian, bounded.
//!
//! A test below holds the bytes of a known value: an encoding that changed by accident is found there, not in
//! users' files.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest header that is written or read, in bytes: node sets and weights of thousands of cases fit a hundred times.
pub(crate) const MAX_HEADER_BYTES: usize = 256 << 20;

/// Headers up to this size may claim 25 % of the memory that the largest may: a string is allocated with its claimed length.
const USUAL_HEADER_BYTES: usize = 2 << 20;
const USUAL_CLAIM_BYTES: usize = MAX_HEADER_BYTES / 4;

fn config<const LIMIT: usize>() -> impl bincode::config::Config {
    bincode::config::standard().with_fixed_int_encoding().with_little_endian().with_limit::<LIMIT>()
}

/// Encodes a value.
pub(crate) fn encode(value: &impl Serialize) -> Result<Vec<u8>, String> {
    bincode::serde::encode_to_vec(value, config::<MAX_HEADER_BYTES>()).map_err(|e| e.to_string())
}

/// Decodes a value that must fill the bytes exactly. Claimed lengths beyond the limit are refused before allocation.
pub(crate) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let decoded = if bytes.len() <= USUAL_HEADER_BYTES {
        bincode::serde::decode_from_slice(bytes, config::<USUAL_CLAIM_BYTES>())
    } else {
        bincode::serde::decode_from_slice(bytes, config::<MAX_HEADER_BYTES>())
    };
    let (value, used) = decoded.map_err(|e| e.to_string())?;
    if used == bytes.len() { Ok(value) } else { Err(format!("{} bytes left over", bytes.len() - used)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::halfwidths::HalfWidths;
    use crate::hull::TrainingRange;
    use crate::inputs::{InputAxis, InputConstant, InputMap, InputSpec};
    use crate::interpolant::{Interpolant, Metric, Slope};
    use crate::model::header::{FarOnset, ForceModel, GroupModel, ModelHeader, OutputField, RegimeModel};
    use crate::radial::{KernelKind, Tail};
    use crate::regime::OnsetTable;
    use crate::snapshots::{FieldKind, FieldSpec, NodeSet, RegimeKind};

    /// Bytes of a known value, written out by hand: lengths and indices u64, variants u32, options one byte, all
    /// little-endian.
    #[test]
    fn encoding_of_primitive_values_is_fixed() {
        let spec = FieldSpec { name: "y".into(), unit: "mm".into(), kind: FieldKind::Coordinate(1) };
        let field = OutputField { spec, magnitude_of: Some([0, 1, 258]) };
        let golden: Vec<u8> = [
            &[1, 0, 0, 0, 0, 0, 0, 0, b'y'][..],
            &[2, 0, 0, 0, 0, 0, 0, 0, b'm', b'm'],
            &[0, 0, 0, 0, 1],
            &[1],
            &[0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0],
        ]
        .concat();
        assert_eq!(encode(&field).expect("encodes"), golden);
        assert_eq!(decode::<OutputField>(&golden).expect("decodes"), field);
    }

    #[test]
    fn kernels_and_tails_keep_their_numbers() {
        let interpolant = |kernel, tail| Interpolant {
            kernel,
            tail,
            dimensions: 1,
            metric: Metric::IDENTITY,
            centres: vec![],
            weights: vec![],
            tail_weights: vec![],
            outputs: 0,
            smoothing: 0.0,
            condition: 0.0,
            residual: 0.0,
            slopes: vec![],
        };
        let kernels = [
            (KernelKind::Linear, 0.0),
            (KernelKind::ThinPlate, 0.0),
            (KernelKind::Cubic, 0.0),
            (KernelKind::Quintic, 0.0),
            (KernelKind::Gaussian { shape: 1.5 }, 1.5),
            (KernelKind::Matern72 { length: 2.5 }, 2.5),
            (KernelKind::CubicQuintic { crossover: 3.5 }, 3.5),
        ];
        let tails = [Tail::None, Tail::Constant, Tail::Linear, Tail::Quadratic];
        for (number, (kernel, parameter)) in (0_u32..).zip(kernels) {
            for (tail_number, tail) in (0_u32..).zip(tails) {
                let fit = interpolant(kernel, tail);
                let bytes = encode(&fit).expect("encodes");
                assert_eq!(bytes[..4], number.to_le_bytes(), "{kernel:?}");
                assert_eq!(bytes[4..12], f64::to_le_bytes(parameter), "{kernel:?}");
                assert_eq!(bytes[12..16], tail_number.to_le_bytes(), "{tail:?}");
                assert_eq!(decode::<Interpolant>(&bytes).expect("decodes"), fit);
            }
        }
        let mut unknown = encode(&interpolant(KernelKind::Linear, Tail::None)).expect("encodes");
        unknown[0] = 7;
        assert!(decode::<Interpolant>(&unknown).is_err_and(|e| e.contains("kernel 7")));
    }

    /// A header with one of everything: its bytes change only with the version of the file.
    #[test]
    fn header_bytes_are_those_of_version_2() {
        let fit = Interpolant {
            kernel: KernelKind::Cubic,
            tail: Tail::Linear,
            dimensions: 1,
            metric: Metric::IDENTITY.stretched(0, 0.5),
            centres: vec![0.0, 1.0],
            weights: vec![1.0, 2.0, 3.0],
            tail_weights: vec![4.0, 5.0],
            outputs: 1,
            smoothing: 1e-9,
            condition: 10.0,
            residual: 1e-16,
            slopes: vec![Slope { centre: 1, axis: 0 }],
        };
        let axis = InputAxis { input: 0, min: 0.0, max: 0.1 };
        let regime = RegimeModel {
            kind: RegimeKind::Contact,
            inputs: InputMap { axes: vec![axis], constants: vec![InputConstant { input: 1, value: 20.0 }] },
            groups: vec![GroupModel {
                name: "x".into(),
                fields: vec![0],
                coefficients: 0..1,
                surrogate: fit.clone(),
                singular_values: vec![2.0, 1.0],
            }],
            force: Some(ForceModel { surrogate: fit, times_excess_pressure: true }),
            domain: TrainingRange::Interval([0.0, 1.0]),
            halfwidths: HalfWidths { coverage: 0.9, displacement_mm: 0.1, stress_mpa: 0.2, force_n: 0.3 },
            local_halfwidths: None,
            far_onset: Some(FarOnset { gap_mm: vec![1.0, 2.0], corrections: vec![0.0, 0.5] }),
            difference: None,
        };
        let spec = FieldSpec { name: "x".into(), unit: "mm".into(), kind: FieldKind::Coordinate(0) };
        let input =
            |name: &str, value| InputSpec { name: name.into(), unit: "MPa".into(), range: [0.0, 1.0], value };
        let header = ModelHeader {
            actuator: "finger".into(),
            inputs: vec![input("pressure", None), input("gap", None), input("mu", Some(0.8))],
            fields: vec![OutputField { spec, magnitude_of: None }],
            node_count: 3,
            regimes: vec![regime],
            onset: Some(OnsetTable::new(vec![0.0, 1.0, 2.0], vec![0.0, 0.1, 0.3])),
            hysteresis_mpa: 2e-4,
            node_sets: vec![NodeSet { name: "tip".into(), nodes: vec![2] }],
            database_hash: [7; 32],
            clearance: None,
            limit: None,
            body: None,
            learned: None,
        };
        let bytes = encode(&header).expect("encodes");
        assert_eq!(decode::<ModelHeader>(&bytes).expect("decodes"), header);
        let hash = blake3::hash(&bytes).to_hex();
        assert_eq!(
            (bytes.len(), &hash.as_str()[..16]),
            (982, "6a76f5eea0c1a3f0"),
            "another version of the file"
        );
    }

    #[test]
    fn lengths_beyond_the_limit_and_trailing_bytes_are_refused() {
        assert!(decode::<Vec<u64>>(&u64::MAX.to_le_bytes()).is_err());
        assert!(decode::<Vec<u64>>(&(1_u64 << 40).to_le_bytes()).is_err());
        let claim = |bytes: u64| decode::<String>(&bytes.to_le_bytes()).expect_err("no text behind it");
        assert_ne!(claim(144 << 20), claim(16 << 20), "refused before it is allocated");
        assert!(decode::<u32>(&[1, 0, 0, 0, 9]).is_err_and(|e| e.contains("1 bytes left over")));
    }
}
