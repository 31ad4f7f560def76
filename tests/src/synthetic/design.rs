//! The beam of formulas with two parameters: the stiffness of its silicone and the length of its chambers.
//! Derivatives with respect to all inputs are differences of the formulas in f64, good to 1e-8.

use super::{NODES, mesh};
use rom::inputs::Parameter;
use rom::snapshots::{
    Case, Database, FieldSpec, Footprint, NodeSet, RegimeKind, Sensitivities, Sensitivity, Split,
};

/// Pressure in MPa, gap in mm (infinite: no plate), stiffness in MPa, length in mm.
pub type State = [f64; 4];

/// Fields x, y, z, von Mises of the sensitivities.
const FIELDS: [usize; 4] = [0, 1, 2, 4];

/// Names, units, nominal values and ranges of the parameters.
pub fn parameters() -> Vec<(Parameter, [f64; 2])> {
    let one = |name: &str, unit: &str, nominal, range| {
        (Parameter { name: name.into(), unit: unit.into(), nominal }, range)
    };
    vec![
        one("elastomer.law.mu_mpa", "MPa", 0.8, [0.6, 1.0]),
        one("chambers.length_mm", "mm", 3.0, [2.6, 3.4]),
    ]
}

/// Softness relative to the nominal actuator.
fn softness([_, _, stiffness_mpa, length_mm]: State) -> f64 {
    0.8 / stiffness_mpa * (length_mm / 3.0).powi(2)
}

/// Depth of the tip's underside in free air, mm.
pub fn depth_mm(state: State) -> f64 {
    let (p, soft) = (state[0], softness(state));
    20.0 * soft.sqrt() + soft * (600.0 * p - 1500.0 * p * p)
}

/// Pressure in MPa at which the plate is reached: the inverse of [`depth_mm`], negative below the sag.
pub fn onset_mpa(state: State) -> f64 {
    let soft = softness(state);
    let rest = (state[1] - 20.0 * soft.sqrt()) / soft;
    (600.0 - (360_000.0 - 6000.0 * rest).sqrt()) / 3000.0
}

/// Contact force in N.
pub fn force_n(state: State) -> f64 {
    let excess = state[0] - onset_mpa(state);
    let [p, gap, stiffness_mpa, length_mm] = state;
    if gap.is_finite() && excess > 0.0 {
        excess * (6.0 + 30.0 * p + 0.02 * gap + 2.0 * (stiffness_mpa - 0.8)) * length_mm / 3.0
    } else {
        0.0
    }
}

/// Fields x, y, z, |u|, von Mises of a state, node-interleaved.
pub fn snapshot(state: State) -> Vec<f64> {
    let free = depth_mm(state);
    let depth = free.min(state[1]);
    let blocked = free - depth;
    let node = |x0: &[f64; 3]| {
        let s = x0[0] / 110.0;
        let down = depth * s * s + 0.3 * blocked * s * (1.0 - s);
        let swell = 0.01 * state[0] / state[2];
        let x = [x0[0] - down * down / 400.0, x0[1] - down, x0[2] + swell * (x0[2] - 16.0)];
        let u = ((x[0] - x0[0]).powi(2) + (x[1] - x0[1]).powi(2) + (x[2] - x0[2]).powi(2)).sqrt();
        let stress = (state[0] * (1.0 + s) * 3.0 / state[3] + 0.004 * blocked * s * (1.0 - s)) * x0[1] / 15.0;
        [x[0], x[1], x[2], u, stress]
    };
    mesh().iter().flat_map(node).collect()
}

/// `count` states spread over all inputs (a Kronecker sequence from `first` on), every fourth one free.
pub fn states(first: usize, count: usize) -> Vec<State> {
    let roots = [2.0_f64, 3.0, 5.0, 7.0].map(f64::sqrt);
    let one = |i: usize| {
        let share: [f64; 4] = std::array::from_fn(|k| ((i + 1) as f64 * roots[k]).fract());
        let within = |k: usize, [low, high]: [f64; 2]| low + share[k] * (high - low);
        let gap = if i.is_multiple_of(4) { f64::INFINITY } else { within(1, [8.0, 38.0]) };
        let ranges = parameters();
        [within(0, [0.0, 0.09]), gap, within(2, ranges[0].1), within(3, ranges[1].1)]
    };
    (first..first + count).map(one).collect()
}

/// Database of these states, with or without derivatives.
pub fn database(states: &[(Split, State)], with_derivatives: bool) -> Database {
    let case = |(i, (split, state)): (usize, &(Split, State))| Case {
        name: i.to_string(),
        regime: if state[1].is_finite() { RegimeKind::Contact } else { RegimeKind::Free },
        split: *split,
        pressure_mpa: state[0],
        gap_mm: Some(state[1]).filter(|gap| gap.is_finite()),
        contact_force_n: force_n(*state),
        parameters: state[2..].to_vec(),
    };
    let snapshots = states.iter().flat_map(|(_, state)| snapshot(*state)).map(|v| v as f32).collect();
    let mut database = Database {
        actuator: "beam".into(),
        fields: FieldSpec::of_the_paper(),
        node_count: NODES,
        cases: states.iter().enumerate().map(case).collect(),
        snapshots,
        undeformed_mm: Some(mesh()),
        undeformed_by: Vec::new(),
        surface_triangles: vec![[0, 1, 2], [2, 3, 4]],
        node_sets: vec![NodeSet { name: "tip".into(), nodes: (110..120).collect() }],
        obstacle: Footprint::PLATE,
        parameters: parameters().into_iter().map(|p| p.0).collect(),
        sensitivities: with_derivatives.then(|| derivatives(states)),
        vibrations: Vec::new(),
        hash: [0; 32],
    };
    database.hash = database.content_hash();
    database
}

/// Derivatives with respect to every input of a state, on its side of the onset.
fn derivatives(states: &[(Split, State)]) -> Sensitivities {
    let mut all = Sensitivities { rows: Vec::new(), fields: FIELDS.to_vec(), values: Vec::new() };
    for (case, (_, state)) in states.iter().enumerate() {
        for input in (0..4).filter(|input| *input != 1 || force_n(*state) > 0.0) {
            let step = 1e-4 * [0.09, 30.0, 0.4, 0.8][input];
            let at = |share: f64| {
                let mut moved = *state;
                moved[input] += share * step;
                moved
            };
            let difference = |f: &dyn Fn(f64) -> f64| {
                let central = |h: f64| (f(h) - f(-h)) / (2.0 * h * step);
                (4.0 * central(0.5) - central(1.0)) / 3.0
            };
            let near = [0.5, -0.5, 1.0, -1.0].map(|share| snapshot(at(share)));
            let value = |i: usize| {
                let central = |a: usize, h: f64| (near[a][i] - near[a + 1][i]) / (2.0 * h * step);
                ((4.0 * central(0, 0.5) - central(2, 1.0)) / 3.0) as f32
            };
            all.values.extend((0..NODES).flat_map(|n| FIELDS.map(|f| value(n * 5 + f))));
            let contact_force_n_per_unit = difference(&|share| force_n(at(share)));
            all.rows.push(Sensitivity { case, input, contact_force_n_per_unit });
        }
    }
    all
}
