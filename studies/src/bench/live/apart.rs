//! A core for the twin, the others for everybody else.

use runtime::realtime;

/// While it lives, this thread and the processes that it starts stay off the twin's core.
pub struct Apart {
    before: Vec<usize>,
}

impl Apart {
    /// # Errors
    /// One core only, or a refusal.
    pub fn new() -> anyhow::Result<Self> {
        let before = realtime::cores()?;
        anyhow::ensure!(before.len() > 1, "the twin cannot have a core of its own where there is one only");
        realtime::pin(&before[1..])?;
        Ok(Self { before })
    }

    /// The twin's core.
    pub fn twin(&self) -> &[usize] {
        &self.before[..1]
    }
}

impl Drop for Apart {
    fn drop(&mut self) {
        let _stays_where_it_is_otherwise = realtime::pin(&self.before);
    }
}
