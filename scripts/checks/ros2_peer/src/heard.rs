//! Messages received by a subscription of hiroz.

use crate::stage::{Error, Stage, ensure, until};
use hiroz::msg::{ZDeserializer, ZMessage};
use hiroz::pubsub::ZSub;
use hiroz::{TypeInfo, WithTypeInfo};
use std::sync::{Arc, Mutex, PoisonError};

/// The messages of a topic, decoded by hiroz.
pub struct Heard<T: ZMessage> {
    _subscription: ZSub<T, (), T::Serdes>,
    messages: Arc<Mutex<Vec<T>>>,
}

impl<T> Heard<T>
where
    T: ZMessage + WithTypeInfo,
    T::Serdes: for<'a> ZDeserializer<Input<'a> = &'a [u8], Output = T> + 'static,
{
    /// Subscribes.
    pub fn on(stage: &Stage, topic: &str) -> Result<Self, Error> {
        Self::of_type(stage, topic, T::type_info())
    }

    /// Subscribes as if the type were this one.
    pub fn of_type(stage: &Stage, topic: &str, of: TypeInfo) -> Result<Self, Error> {
        let messages = Arc::new(Mutex::new(Vec::new()));
        let keep = messages.clone();
        let builder = stage.node.create_sub::<T>(topic).with_type_info(of);
        let subscription = builder.build_with_callback(move |message| {
            keep.lock().unwrap_or_else(PoisonError::into_inner).push(message);
        })?;
        Ok(Self { _subscription: subscription, messages })
    }

    /// How many have come.
    pub fn count(&self) -> usize {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// All that have come since the last call.
    pub fn take(&self) -> Vec<T> {
        std::mem::take(&mut *self.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Waits for `count` messages.
    pub fn wait(&self, wanted: usize) -> Result<(), Error> {
        until(|| {
            let count = self.count();
            ensure(count >= wanted, || {
                format!("{}: expected {wanted} messages, {count} came", T::type_name())
            })
        })
    }
}
