//! Publishes one reading and receives it, in a separate shared-memory domain: `cargo run -p wire --example first`.

use wire::{Bus, Domain, SensorReader, SensorSample, SensorWriter, Topic, WireError};

fn main() -> Result<(), WireError> {
    let bus = Bus::open(&Domain::isolated("first"))?;
    let topic = Topic::sensor("finger")?;
    let reader = SensorReader::attach(&bus, &topic)?;
    let mut writer = SensorWriter::create(&bus, &topic)?;
    writer.publish(SensorSample { pressure_mpa: 0.03, gap_mm: 40.0, ..SensorSample::default() })?;
    let received = reader.newest()?.map(|sample| (sample.pressure_mpa, sample.gap_mm));
    assert_eq!(received, Some((0.03, 40.0)));
    Ok(())
}
