//! What all of this crate is built on.

/// The transport: inter-process, single-threaded ports.
pub(crate) type Ipc = iceoryx2::prelude::ipc::Service;

/// Where the system keeps POSIX shared memory.
pub(crate) const SHM_DIR: &str = "/dev/shm";
