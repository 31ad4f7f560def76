//! The only reasons for which a test may end without its checks; `architecture.rs` asserts that no other file has one.

/// Capability that a test needs and that not every machine has.
#[derive(Debug, Clone, Copy)]
pub enum Missing {
    /// The right to mount a small `/dev/shm`, or another small file system, in a separate namespace.
    SmallSharedMemory,
    /// `systemd-analyze`.
    SystemdAnalyze,
    /// A service manager that runs (systemd as the first process).
    ServiceManager,
    /// The right to run programs as another user (root), and `setpriv`.
    SecondUser,
    /// A C++ compiler.
    CppCompiler,
    /// The Python package gmsh.
    GmshPackage,
    /// The network gateway, which a build without its feature does not have.
    Gateway,
}

/// Prints that a test ends without its checks, with the reason.
pub fn skipped(missing: Missing) {
    println!("SKIPPED: this machine has no {missing:?}");
}
