//! Limit of the young connections from one address, for a listener whose library has none.

use std::collections::BTreeMap;
use std::io;
use std::mem::ManuallyDrop;
use std::net::{IpAddr, Shutdown, SocketAddr, TcpStream};
use std::os::fd::FromRawFd;
use std::time::{Duration, Instant};

/// A connection of another owner.
type Borrowed = ManuallyDrop<TcpStream>;

/// Connections that this process accepted on some ports, as of the last call.
#[derive(Debug)]
pub struct AddressLimit {
    ports: Vec<u16>,
    most: usize,
    young: Duration,
    /// Time of the first call that saw each connection, by its far end.
    seen: BTreeMap<SocketAddr, Instant>,
}

impl AddressLimit {
    /// At most `most` connections from one address (of IPv6: one network of 64 bits) that are younger than `young`.
    pub fn new(ports: Vec<u16>, most: usize, young: Duration) -> Self {
        Self { ports, most, young, seen: BTreeMap::new() }
    }

    /// Shuts down the oldest young connections beyond the limit; returns their number. To be called periodically.
    ///
    /// # Errors
    /// The descriptors of this process cannot be listed.
    pub fn apply(&mut self) -> io::Result<usize> {
        let (now, found) = (Instant::now(), self.accepted()?);
        self.seen.retain(|peer, _| found.iter().any(|(other, _)| other == peer));
        let mut young: BTreeMap<IpAddr, Vec<(Instant, Borrowed)>> = BTreeMap::new();
        for (peer, connection) in found {
            let first = *self.seen.entry(peer).or_insert(now);
            if now.duration_since(first) < self.young {
                young.entry(network(peer.ip())).or_default().push((first, connection));
            }
        }
        let mut closed = 0;
        for mut connections in young.into_values() {
            connections.sort_by_key(|(first, _)| *first); // stable: in the order of the descriptors otherwise
            let beyond = connections.len().saturating_sub(self.most);
            closed += beyond;
            for (_, connection) in connections.iter().take(beyond) {
                let _ended_meanwhile = connection.shutdown(Shutdown::Both);
            }
        }
        Ok(closed)
    }

    /// Connections that were accepted on the ports, in the order of their descriptors.
    fn accepted(&self) -> io::Result<Vec<(SocketAddr, Borrowed)>> {
        let names = std::fs::read_dir("/proc/self/fd")?.map_while(|entry| Some(entry.ok()?.file_name()));
        let mut numbers: Vec<i32> = names.filter_map(|name| name.to_str()?.parse().ok()).collect();
        numbers.sort_unstable();
        let connection = |number: i32| {
            // Neither duplicated nor closed: closing a copy of a file's descriptor would give up this process's locks on the file.
            // SAFETY: the number is not -1. The descriptor stays its owner's; calls on one that was closed meanwhile fail.
            let connection = ManuallyDrop::new(unsafe { TcpStream::from_raw_fd(number) });
            let is_ours = self.ports.contains(&connection.local_addr().ok()?.port());
            Some((connection.peer_addr().ok().filter(|_| is_ours)?, connection))
        };
        Ok(numbers.into_iter().filter_map(connection).collect())
    }
}

/// The address; of IPv6 its network of 64 bits, which one host has for itself.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => IpAddr::V6((address.to_bits() & !u128::from(u64::MAX)).into()),
        address => address,
    }
}
