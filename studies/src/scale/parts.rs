//! The measurements of the scale study.

use crate::bench::measure::{Durations, gbps};
use crate::bench::{compute, full_size};
use anyhow::Context;
use rom::inputs::Inputs;
use rom::kernel::{Affine, Field, FieldSource, Modes, Precision, Role, Spec};
use rom::model::{Nodes, Selection};
use rom::model_state::ModelState;
use rom::reconstructor::Basis;
use serde::Serialize;
use wire::{Bus, Domain, FieldHeader, FieldReader, FieldWriter, Topic};

/// Medians of one basis.
#[derive(Debug, Serialize)]
pub struct Cost {
    /// Bytes of the f32 basis.
    pub bytes: usize,
    /// Reconstruction, us.
    pub f32_us: f64,
    /// The same with an i16 basis, us.
    pub i16_us: f64,
    /// Basis bytes over `f32_us`.
    pub gbps: f64,
}

/// Cost of a number of actuators in turn.
#[derive(Debug, Serialize)]
pub struct ActuatorsRow {
    /// Actuators.
    pub actuators: usize,
    /// Bytes of their full bases.
    pub bytes: usize,
    /// Input to full field, us an actuator.
    pub full_us: f64,
    /// Input to force and the fields of 500 nodes, us an actuator.
    pub tip_us: f64,
}

/// Cost of a number of readers.
#[derive(Debug, Serialize)]
pub struct SubscribersRow {
    /// Readers of the topic.
    pub subscribers: usize,
    /// Taking a free sample, us, median.
    pub loan_us: f64,
    /// Sending it and waking all readers, us, median.
    pub send_us: f64,
}

/// Values touched per size of basis, so that small ones are measured often and large ones end.
const WORK: usize = 300_000_000;

/// X, Y, Z, |U| and S of a synthetic body.
pub fn kernel(nodes: usize, modes: usize) -> anyhow::Result<Cost> {
    let wave =
        |len: usize, scale: f32| (0..len).map(|i| scale * (0.37 * i as f32).sin()).collect::<Vec<f32>>();
    let (rest, basis) = (wave(nodes, 100.0), wave(nodes * modes, 0.01));
    let stored = |precision| {
        let value = |mode: usize, node: usize| f64::from(basis[mode * nodes + node]);
        Modes::new(precision, nodes, modes, value).map_err(|found| anyhow::anyhow!("{found:?}"))
    };
    // One copy per field, as in a model.
    let all = [(); 4].map(|()| stored(Precision::F32));
    let [x, y, z, stress] = all;
    let of_field = [x?, y?, z?, stress?];
    let field = |index: usize, role| Field {
        source: FieldSource::Affine(Affine {
            mean: Some(&rest),
            modes: &of_field[index],
            coefficients: index * modes..(index + 1) * modes,
        }),
        role,
        published: true,
    };
    let magnitude = FieldSource::Magnitude { coordinates: [0, 1, 2], rest: [&rest; 3], shifts: Vec::new() };
    let displacement = Field { source: magnitude, role: Role::Displacement, published: true };
    let mut fields: Vec<Field<'_>> = (0..3).map(|axis| field(axis, Role::Plain)).collect();
    fields.extend([displacement, field(3, Role::Stress)]);
    let spec = Spec { node_count: nodes, nodes: None, fields };
    let wide = Basis::build(&spec, None)?;
    let narrow = Basis::build(&spec, Some(Precision::Integers))?;

    let coefficients: Vec<f64> = (0..4 * modes).map(|j| (j as f64).cos()).collect();
    let mut out = vec![0.0; wide.output_len()];
    let samples = (WORK / (nodes * modes * 4)).clamp(7, 2000);
    let mut series = [(); 2].map(|()| Durations::new(""));
    let [f32, i16] = &mut series;
    for _ in 0..samples {
        wide.reconstruct(&coefficients, &mut out)?;
        f32.time(|| wide.reconstruct(&coefficients, &mut out));
        narrow.reconstruct(&coefficients, &mut out)?;
        i16.time(|| narrow.reconstruct(&coefficients, &mut out));
    }
    let (bytes, f32_us) = (wide.bytes(), f32.p50());
    Ok(Cost { bytes, f32_us, i16_us: i16.p50(), gbps: gbps(bytes, f32_us) })
}

/// Rounds over all actuators.
const ROUNDS: usize = 300;

/// Actuators in turn in one thread, each with its own model in memory.
pub fn actuators(counts: &[usize]) -> anyhow::Result<Vec<ActuatorsRow>> {
    let model = full_size::model()?;
    let input = compute::inputs(&model)?[0];
    let most = counts.iter().copied().max().unwrap_or(1);
    let tip = Selection { fields: None, nodes: Nodes::List(compute::tip_nodes(&model)) };
    let make = |selection: &Selection| {
        (0..most).map(|_| ModelState::new(&model, selection)).collect::<Result<Vec<_>, _>>()
    };
    let (mut full, mut tips) = (make(&Selection::default())?, make(&tip)?);
    let regime = model.header.regimes.last().context("the model has no regime")?.kind;
    let bytes = full[0].reconstructor().basis(regime).map_or(0, Basis::bytes);
    let mut rows = Vec::new();
    for &actuators in counts {
        let full_us = round(&mut full[..actuators], input)?;
        let tip_us = round(&mut tips[..actuators], input)?;
        rows.push(ActuatorsRow { actuators, bytes: actuators * bytes, full_us, tip_us });
    }
    Ok(rows)
}

/// Median over rounds of the time of one actuator, each writing its own output.
fn round(states: &mut [ModelState], inputs: Inputs) -> anyhow::Result<f64> {
    let mut series = Durations::new("");
    for _ in 0..ROUNDS {
        let mut failed = None;
        series.time(|| {
            for state in states.iter_mut() {
                failed = state.update(inputs).err().or(failed);
            }
        });
        failed.map_or(Ok(()), Err)?;
    }
    Ok(series.p50() / states.len() as f64)
}

/// Loan and send of a full field with several readers in this process, which take each sample.
pub fn subscribers(counts: &[usize]) -> anyhow::Result<Vec<SubscribersRow>> {
    let mut rows = Vec::new();
    for &subscribers in counts {
        let bus = Bus::open(&Domain::isolated("bench"))?;
        let topic = Topic::field("bench", None)?;
        let entries = 5 * full_size::NODES;
        let writer = FieldWriter::create(&bus, &topic, entries)?;
        let readers =
            (0..subscribers).map(|_| FieldReader::open(&bus, &topic)).collect::<Result<Vec<_>, _>>()?;
        let mut header =
            FieldHeader { node_count: full_size::NODES as u32, field_count: 5, ..FieldHeader::default() };
        header.field_ids[..5].copy_from_slice(&[0, 1, 2, 3, 4]);
        let [mut loans, mut sends] = [(); 2].map(|()| Durations::new(""));
        for _ in 0..ROUNDS {
            let mut loan = None;
            loans.time(|| loan = Some(writer.loan()));
            let loan = loan.context("no loan was tried")??;
            let mut sent = None;
            sends.time(|| sent = Some(loan.send(header)));
            sent.context("no send was tried")??;
            for reader in &readers {
                reader.newest()?;
            }
        }
        rows.push(SubscribersRow { subscribers, loan_us: loans.p50(), send_us: sends.p50() });
    }
    Ok(rows)
}

/// Sizes of the first core's data caches, as the system reports them.
pub fn caches() -> String {
    let read = |index: usize, file: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{file}");
        std::fs::read_to_string(path).map(|text| text.trim().to_owned())
    };
    let cache = |index: usize| {
        let (level, kind, size) =
            (read(index, "level").ok()?, read(index, "type").ok()?, read(index, "size").ok()?);
        (kind != "Instruction").then(|| format!("L{level} {size}"))
    };
    let known: Vec<String> = (0..8).filter_map(cache).collect();
    if known.is_empty() { "unknown".into() } else { known.join(", ") }
}
