//! The scene file of a new twin.

use super::plan::Plan;
use super::pressures::Pressures;
use fem::actuator::Actuator;

/// Its text: readings by formula through the whole range of pressures, until a sensor takes their place.
pub fn text(actuator: &Actuator, plan: &Plan, pressures: &Pressures) -> String {
    let name = &actuator.name;
    // On the sheet, where every mesh has a node if it has one on the middle line.
    let tip = [actuator.base.length_mm, actuator.base.lower_mm, 0.5 * actuator.base.width_mm];
    let middle = 0.5 * pressures.largest_mpa();
    let gap = (5.0 * (plan.gaps_mm[0] + plan.gaps_mm[1])).round() / 10.0;
    format!(
        "# Scene of {name}, made by `softtwin build`. Every key is explained in OPERATIONS.md.\n\
         #   softtwind twin --scene scene.toml, and the same with bridge; softtwin view --scene scene.toml\n\
         name = \"{name}\"\n\n\
         [[actuator]]\n\
         name = \"{name}\"\n\
         model = \"{name}.twin\"\n\
         plate = {{ x_mm = {:?}, z_mm = {:?} }} # mm, its extent in actuator.toml\n\
         queries = \"fields\"\n\n\
         [actuator.source]                # readings by formula; for a device: [actuator.sensors.NAME]\n\
         kind = \"simulate\"\n\
         rate_hz = 100.0\n\
         gap_mm = {gap:?}\n\
         profile = {{ shape = \"sine\", mean_mpa = {middle:?}, amplitude_mpa = {middle:?}, frequency_hz = 0.25 }}\n\n\
         [[actuator.output]]              # softtwin/{name}/field\n\
         nodes = \"all\"\n\n\
         [[actuator.output]]              # softtwin/{name}/field/tip: the middle of the base's free end\n\
         name = \"tip\"\n\
         nodes = {{ box = {{ min = {:?}, max = {:?} }} }}\n\
         fields = [\"x\", \"y\", \"z\"]\n",
        actuator.obstacle.x_mm,
        actuator.obstacle.z_mm,
        tip.map(|mm| mm - 0.01),
        tip.map(|mm| mm + 0.01),
    )
}
