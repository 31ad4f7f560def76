//! A twin that takes the topics over from another one, and the other one's side.

use super::Twin;
use std::time::{Duration, Instant};
use wire::{Bus, StateReader, Topic, Waking, WireError, WriterRight};

impl Twin {
    /// The state topics, which stand for the actuators.
    pub fn state_topics(&self) -> Vec<Topic> {
        self.actuators.iter().map(|actuator| actuator.state_topic().clone()).collect()
    }

    /// Takes the topics over from the twin that serves them, or takes them at once where there is none. That twin finishes its
    /// reading and writes on until this one asks; what it has answered is known from its last state, so that no reading is lost or
    /// answered twice.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when the other one has not given them within `patience`, or a third program asks too.
    pub fn take_over(&mut self, bus: &Bus, patience: Duration) -> Result<(), WireError> {
        let topics = self.state_topics();
        let attach = |topic: &Topic| StateReader::attach_as(bus, topic, Waking::Never);
        let answered = topics.iter().map(attach).collect::<Result<Vec<_>, _>>()?;
        let asked = bus.ask_to_take_over(&topics)?;
        wire::wait_for_rights(&self.rights(), Instant::now() + patience)?;
        for (actuator, states) in self.actuators.iter_mut().zip(&answered) {
            actuator.continue_after(states.newest()?.as_ref());
        }
        drop(asked);
        Ok(())
    }

    /// Gives all topics away; nothing may be served until [`Self::take_rights`].
    pub fn give_rights(&self) {
        self.rights().iter().for_each(|right| right.give_right());
    }

    /// Takes all topics again.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another twin has them.
    pub fn take_rights(&self) -> Result<(), WireError> {
        wire::take_rights(&self.rights())
    }

    fn rights(&self) -> Vec<&dyn WriterRight> {
        self.actuators.iter().flat_map(|actuator| actuator.rights()).collect()
    }
}
