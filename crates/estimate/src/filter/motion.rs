//! Motion between the readings of a filter.

use super::Filter;
use crate::outcome::{Status, Update};
use crate::setup::{Measurement, Model, Moving, Swing};
use crate::swing::{Passage, moving_inputs};

/// Consecutive readings with a contradiction after which a motion is unknown.
const LOST_AFTER: u32 = 3;

impl Filter {
    /// True if no obstacle is known.
    fn is_open(&self) -> bool {
        let gap = self.setup.gap_unknown();
        gap.is_some_and(|gap| !self.in_contact && !self.identifiability.is_identifiable(gap))
    }

    /// Carries the motion to a reading. A motion that begins there has load and rate of the priors.
    pub(super) fn carry(&mut self, measurement: &mut Measurement, model: &mut impl Model) {
        let Some(swing) = self.setup.swing else { return };
        let carried = self.last.as_ref().and_then(|from| {
            let passage = Passage { setup: &self.setup, from, to: measurement, is_open: self.is_open() };
            passage.carry(&self.mean, &self.covariance, model)
        });
        let places = [swing.load, swing.rate];
        match &carried {
            Some(carried) => {
                carried.spread(&swing, &mut self.covariance);
                places.iter().zip(carried.states).for_each(|(at, value)| {
                    let [low, high] = self.setup.unknowns[*at].range;
                    self.mean[*at] = value.clamp(low, high);
                });
                measurement.load_by_input = carried.by_reading;
                for pattern in &mut self.memory {
                    let errors = carried.errors(pattern.sensitivity(), pattern.difference());
                    places.iter().zip(errors).for_each(|(at, error)| pattern.set(*at, error));
                }
            }
            None => {
                self.lose_motion(swing);
                places.iter().for_each(|at| self.mean[*at] = self.setup.unknowns[*at].prior);
            }
        }
    }

    /// Makes load and rate of a motion as unknown as before any reading.
    fn lose_motion(&mut self, swing: Swing) {
        for at in [swing.load, swing.rate] {
            let sigma = self.setup.unknowns[at].sigma;
            self.covariance.replace(at, sigma * sigma);
            self.memory.iter_mut().for_each(|pattern| pattern.set(at, 0.0));
        }
    }

    /// Gives the motion at a reading to the model.
    pub(super) fn settle(&mut self, measurement: &Measurement, update: &Update, model: &mut impl Model) {
        let Some(swing) = self.setup.swing else { return };
        if update.status == Status::Used {
            self.in_contact = update.in_contact;
        }
        let is_explained = update.status == Status::Used && update.rejected == 0;
        self.unexplained = if is_explained { 0 } else { self.unexplained + 1 };
        if self.unexplained == LOST_AFTER {
            self.unexplained = 0;
            self.lose_motion(swing);
        }
        let inputs = moving_inputs(&self.setup, measurement, &self.mean, self.is_open());
        model.settle(&Moving { t_s: measurement.t_s, inputs, rate: self.mean[swing.rate] }, self.in_contact);
        self.last = Some(*measurement);
    }
}
