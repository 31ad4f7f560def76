//! The shared memory of dead listeners (`.event_mgmt`), which living notifiers may still have mapped.
//!
//! iceoryx2 removes the data and the connections of a port whose program was killed while it removed the port, but not the
//! memory of a listener. A notifier of another program lets go of it with its next notification only, so that
//! [`super::unused`] cannot tell it from one in use.

use super::nodes::is_process;
use super::places::{Places, files, name, process_of};
use std::collections::BTreeSet;

const EVENT: &str = ".event_mgmt";
const PORT_TAG: &str = ".port_tag";

impl Places {
    /// Removes the memory of listeners that have no tag in the folder of any node; returns how many were removed. After the
    /// dead nodes, and only under the exclusive start lock.
    ///
    /// A listener makes its tag before its memory and removes it afterwards: the memory is listed before the tags. Another
    /// shared-memory domain with the same prefix has its tags in another folder: its listeners are recognised by their live processes.
    pub(super) fn remove_dead_listeners(&self) -> usize {
        let listed: Vec<_> = self
            .segments()
            .into_iter()
            .filter_map(|path| self.listener(name(&path)).map(|id| (path, id)))
            .collect();
        if listed.is_empty() {
            return 0;
        }
        let tagged = self.port_tags();
        let dead = listed.iter().filter(|(_, id)| !tagged.contains(id) && !is_process(process_of(*id)));
        dead.filter(|(path, _)| std::fs::remove_file(path).is_ok()).count()
    }

    /// The listener to which `<prefix><40 hexadecimal digits>_<number>.event_mgmt` belongs.
    fn listener(&self, file: &str) -> Option<u128> {
        self.own(file)?.strip_suffix(EVENT)?.split_once('_')?.1.parse().ok()
    }

    /// The ports of all nodes.
    fn port_tags(&self) -> BTreeSet<u128> {
        let port = |file: &str| self.own(file)?.strip_suffix(PORT_TAG)?.parse::<u128>().ok();
        let nodes = files(&self.nodes(), |file| file.parse::<u128>().is_ok());
        let tags = nodes.iter().flat_map(|node| files(node, |file| port(file).is_some()));
        tags.filter_map(|path| port(name(&path))).collect()
    }
}
