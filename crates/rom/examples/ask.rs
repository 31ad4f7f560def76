//! Asks a model file for force and fields: `cargo run -p rom --example ask -- models/pneunet/pneunet.twin`.

use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("expected the path of a model file")?;
    let (model, _) = Model::read(path)?;
    let mut state = ModelState::new(&model, &Selection::default())?;
    state.update(Inputs::new(0.06, 17.0))?; // MPa, mm
    let answer = state.evaluation();
    println!(
        "0.06 MPa, 17 mm: {:.4} N, {:?}, {} values",
        answer.contact_force_n,
        answer.domain,
        state.fields().len()
    );
    Ok(())
}
