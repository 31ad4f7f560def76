//! Model from arrays: two nodes of an actuator without an obstacle, eight pressures.

use rom::inputs::Inputs;
use rom::model::Selection;
use rom::model_state::ModelState;
use rom::snapshots::{Database, FieldKind, FieldSpec};
use train::config::TrainConfig;
use train::train;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // One row per state: the deflection of both nodes in mm, computed elsewhere.
    let pressures_mpa: Vec<f64> = (0..8).map(|i| 0.01 * f64::from(i)).collect();
    let snapshots = pressures_mpa.iter().flat_map(|p| [600.0 * p, 300.0 * p - 900.0 * p * p]);
    let field = FieldSpec { name: "deflection".into(), unit: "mm".into(), kind: FieldKind::Other };
    let database = Database::free("beam", vec![field], &pressures_mpa, snapshots.map(|v| v as f32).collect());

    let (model, _sheet) = train(&database, &TrainConfig::default(), &mut |_step| {})?;
    let mut state = ModelState::new(&model, &Selection::default())?;
    state.update(Inputs::new(0.035, f64::INFINITY))?;
    println!("0.035 MPa: {:?} mm, {:?}", state.fields(), state.evaluation().domain);
    Ok(())
}
