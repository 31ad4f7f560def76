//! The tables of docs/scale.md.

use super::Study;
use softtwin::output;

/// Prints all of them.
pub fn print(study: &Study) -> anyhow::Result<()> {
    output!("caches of this core: {}", study.caches)?;
    output!("")?;
    output!(
        "| nodes | basis f32 | f32, us | i16, us | reading alone, us | f32 GB/s | us a 1000 nodes | actuators a core at 1 kHz |"
    )?;
    output!("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")?;
    for row in &study.nodes {
        output!(
            "| {} | {} | {:.2} | {:.2} | {:.2} | {:.1} | {:.2} | {} |",
            row.nodes,
            bytes(row.bytes),
            row.f32_us,
            row.i16_us,
            row.read_us,
            row.gbps,
            1e3 * row.f32_us / row.nodes as f64,
            row.actuators_at_1khz
        )?;
    }
    output!("")?;
    output!("| modes a field | basis f32 | f32, us | i16, us | f32 GB/s |")?;
    output!("| ---: | ---: | ---: | ---: | ---: |")?;
    for row in &study.modes {
        output!(
            "| {} | {} | {:.1} | {:.1} | {:.1} |",
            row.modes,
            bytes(row.bytes),
            row.f32_us,
            row.i16_us,
            row.gbps
        )?;
    }
    output!("")?;
    output!(
        "| actuators in one twin | bases together | full field, us each | tip and force, us each | share of a core, tips at 1 kHz |"
    )?;
    output!("| ---: | ---: | ---: | ---: | ---: |")?;
    for row in &study.actuators {
        let share = row.actuators as f64 * row.tip_us / 10.0;
        output!(
            "| {} | {} | {:.1} | {:.2} | {share:.1} % |",
            row.actuators,
            bytes(row.bytes),
            row.full_us,
            row.tip_us
        )?;
    }
    output!("")?;
    output!("| subscribers of a full field | loan, us | send and wake, us |")?;
    output!("| ---: | ---: | ---: |")?;
    for row in &study.subscribers {
        output!("| {} | {:.2} | {:.2} |", row.subscribers, row.loan_us, row.send_us)?;
    }
    Ok(())
}

/// Bytes in the unit that reads best.
fn bytes(count: usize) -> String {
    let count = count as f64;
    match count {
        c if c < 1e6 => format!("{:.0} kB", c / 1e3),
        c if c < 1e9 => format!("{:.1} MB", c / 1e6),
        c => format!("{:.2} GB", c / 1e9),
    }
}
