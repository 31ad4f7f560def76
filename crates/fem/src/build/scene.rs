//! The scene file of a new twin.

use crate::family::Family;
use crate::plan::{Plan, Pressures, TOGETHER};

/// Its text: readings by formula through the pressures of the contact states, until a sensor takes their place.
pub(super) fn text(family: &Family, plan: &Plan, pressures: &Pressures) -> String {
    let name = &family.actuator.name;
    // Of boxes a point on the sheet, where every mesh has a node if it has one on the middle line; of another shape the end face.
    let tip = family.actuator.shape().map_or_else(
        || "\"tip\"".to_owned(),
        |shape| {
            let point_mm =
                [shape.base.length_mm, shape.base_mm() + shape.base.lower_mm, 0.5 * shape.base.width_mm];
            let [min, max] = [-0.01, 0.01].map(|off| point_mm.map(|mm| mm + off));
            format!("{{ box = {{ min = {min:?}, max = {max:?} }} }}")
        },
    );
    let middle = 0.5 * plan.contact_mpa;
    let gap = plan
        .gaps_mm
        .map_or(String::new(), |[low, high]| format!("gap_mm = {:?}\n", (5.0 * (low + high)).round() / 10.0));
    let plate = family.actuator.obstacle.as_ref().map_or(String::new(), |obstacle| {
        let (x_mm, z_mm) = (obstacle.x_mm, obstacle.z_mm);
        format!("plate = {{ x_mm = {x_mm:?}, z_mm = {z_mm:?} }} # mm, its extent in actuator.toml\n")
    });
    let cavities: String = plan
        .cavities
        .iter()
        .map(|name| {
            format!(
                "\"{name}\" = 0.0   # given, to {} MPa; \"measured\" with a sensor of it\n",
                TOGETHER * pressures.largest_mpa()
            )
        })
        .collect();
    let inputs = if cavities.is_empty() { String::new() } else { format!("\n[actuator.inputs]\n{cavities}") };
    format!(
        "# Scene of {name}, made by `softtwin build`. Every key is explained in OPERATIONS.md.\n\
         #   softtwind twin --scene scene.toml, and the same with bridge; softtwin view --scene scene.toml\n\
         name = \"{name}\"\n\n\
         [[actuator]]\n\
         name = \"{name}\"\n\
         model = \"{name}.twin\"\n\
         {plate}\
         queries = \"fields\"\n{inputs}\n\
         [actuator.source]                # readings by formula; for a device: [actuator.sensors.NAME]\n\
         kind = \"simulate\"\n\
         rate_hz = 100.0\n\
         {gap}\
         profile = {{ shape = \"sine\", mean_mpa = {middle:?}, amplitude_mpa = {middle:?}, frequency_hz = 0.25 }}\n\n\
         [[actuator.output]]              # softtwin/{name}/field\n\
         nodes = \"all\"\n\n\
         [[actuator.output]]              # softtwin/{name}/field/tip: the free end\n\
         name = \"tip\"\n\
         nodes = {tip}\n\
         fields = [\"x\", \"y\", \"z\"]\n",
    )
}
