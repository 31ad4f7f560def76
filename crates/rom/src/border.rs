//! Which named regime a state is in: that of the largest score (`model/named.rs`).

use crate::hull::Domain;
use crate::inputs::{InputMap, Inputs};
use crate::model::NamedRegimes;
use crate::names::MAX_REGIMES;
use crate::snapshots::RegimeKind;
use crate::sums::{Room, Sums};

/// Decides between the named regimes of a model.
#[derive(Clone, Debug)]
pub(crate) struct Decision {
    pub(crate) names: Vec<String>,
    /// None: there is one regime only.
    scores: Option<(InputMap, Sums, f64)>,
}

impl Decision {
    pub(crate) fn new(named: &NamedRegimes) -> Self {
        let scores = |border: &crate::model::Border| {
            (border.inputs.clone(), Sums::new(&[&border.scores]), border.doubt)
        };
        Self { names: named.names.clone(), scores: named.border.as_ref().map(scores) }
    }

    /// The sums that need room.
    pub(crate) fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.scores.iter().map(|scores| &scores.1)
    }

    /// The regime of a state, and a distance to its domain that stands for how close another regime is: 0 where the best two
    /// scores are as far apart as the doubt or farther, [`Domain::NEAR`] where they are the same. No allocation.
    pub(crate) fn at(&self, inputs: &Inputs, room: &mut Room) -> (RegimeKind, f64) {
        let Some((map, sums, doubt)) = &self.scores else { return (RegimeKind::Named(0), 0.0) };
        let mut scores = [f64::NEG_INFINITY; MAX_REGIMES];
        sums.evaluate(&map.scale(inputs), room, &mut scores[..sums.outputs()], None);
        let (best, margin) = largest(&scores);
        let closeness = if *doubt > 0.0 { (1.0 - margin / doubt).max(0.0) } else { 0.0 };
        (RegimeKind::Named(best as u8), Domain::NEAR * closeness)
    }
}

/// Place of the largest score and how far above the next one it is.
pub fn largest(scores: &[f64]) -> (usize, f64) {
    let best = (0..scores.len()).fold(0, |best, at| if scores[at] > scores[best] { at } else { best });
    let others = scores.iter().enumerate().filter(|(at, _)| *at != best);
    let next = others.fold(f64::NEG_INFINITY, |next, (_, score)| next.max(*score));
    (best, scores[best] - next)
}
