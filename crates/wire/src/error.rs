//! Everything that can go wrong between a program and the shared memory.

/// Failures of the wire. The text says what to do next.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum WireError {
    /// A name that cannot be a chunk of a topic.
    #[error(
        "`{found}` cannot name {what}: expected 1 to 31 letters, digits, `_` or `-` (no `/`, no wildcard)"
    )]
    BadName { what: &'static str, found: String },
    /// A shared-memory domain whose names are no valid file names.
    #[error(
        "the shared-memory domain's {what} `{value}` cannot be used in file names; use letters, digits, `_`, `-`"
    )]
    BadDomain {
        /// `prefix` or `root`.
        what: &'static str,
        value: String,
    },
    /// The folder belongs to another user.
    #[error(
        "the shared-memory domain of `{folder}` belongs to user {owner}, this program runs as user {user}: run it as that user (`sudo -u '#{owner}' SOFTTWIN_ROOT={folder} ...`); other users see and drive a twin through `softtwin view` and the gateway (OPERATIONS.md, Other users)"
    )]
    OthersDomain { folder: String, owner: u32, user: u32 },
    /// Other users may make files in the folder.
    #[error(
        "other users can write in the shared-memory domain's folder `{folder}` (mode {mode:o}), and a domain belongs to one user: `chmod 700 {folder}`, or name another folder with SOFTTWIN_ROOT"
    )]
    OpenFolder { folder: String, mode: u32 },
    /// A shared-memory domain whose paths are too long.
    #[error(
        "the shared-memory domain's folder `{root}` and its prefix `{prefix}` have {found} bytes together, at most {allowed} are allowed (sockets in that folder have paths of at most 107 bytes); choose a shorter SOFTTWIN_ROOT or SOFTTWIN_DOMAIN"
    )]
    LongDomain { prefix: String, root: String, found: usize, allowed: usize },
    /// A program holds the start lock and does not go on.
    #[error(
        "{path}: another program removes leftover files and has not finished within {waited_ms} ms; is it stopped? `lslocks` shows which one holds this file"
    )]
    StartLocked { path: String, waited_ms: u64 },
    /// This process (or the machine) may not open more files.
    #[error(
        "{name}: no more files can be opened ({cause}; the limit of this process is {limit}); raise `LimitNOFILE=` of the unit or `ulimit -n`, or open fewer topics"
    )]
    TooManyFiles { name: String, cause: String, limit: u64 },
    /// A file system of the shared-memory domain has no space for another file.
    #[error(
        "{name}: no file can be made in {folder}: {cause}; remove files there, or mount it with more (`df -i`, `df -h`)"
    )]
    NoFiles { name: String, folder: String, cause: String },
    /// All client slots taken.
    #[error("{name}: all {limit} places of clients are taken; stop a client")]
    TooManyClients { name: String, limit: usize },
    /// No place for a new topic.
    #[error(
        "{topic}: the shared-memory domain has {limit} topics, more are not allowed; run some of the actuators in another one (SOFTTWIN_DOMAIN)"
    )]
    TooManyTopics { topic: String, limit: usize },
    /// All programs' slots taken.
    #[error("{name}: {limit} programs take part, more are not allowed; stop one")]
    TooManyPrograms { name: String, limit: usize },
    /// The node could not be made.
    #[error(
        "cannot join the shared-memory domain: {cause}; check that the root folder and /dev/shm are writable"
    )]
    Node { cause: String },
    /// Nothing of that name.
    #[error(
        "{topic}: the topic does not exist; is the bridge or twin running in this shared-memory domain? `softtwin list` shows the topics"
    )]
    NoSuchTopic { topic: String },
    /// A program of another layout or version made the topic.
    #[error(
        "{topic}: made by a program of another version ({cause}); this one speaks layout version {}. Run the same release everywhere",
        crate::layout::LAYOUT_VERSION
    )]
    Incompatible { topic: String, cause: String },
    /// A second writer.
    #[error(
        "{topic}: another process already publishes here{holder}. Two twins (or bridges) for one actuator would contradict each other: stop the other one, or give this actuator another name"
    )]
    AlreadyPublished {
        topic: String,
        /// Who, if it could be found out: ` (process 1234)`.
        holder: String,
    },
    /// All reader slots taken.
    #[error("{topic}: all {limit} reader slots are taken; stop a reader")]
    TooManyReaders { topic: String, limit: usize },
    /// The topic could not be opened within the time for it, although nothing forbids it.
    #[error(
        "{topic}: could not be opened within {tries} tries ({cause}); another program is creating or removing it, or one of its files is damaged: try again, then stop all programs of this shared-memory domain and empty its folder"
    )]
    InFlux { topic: String, tries: u32, cause: String },
    /// Any other refusal on opening a port.
    #[error("{topic}: cannot open: {cause}")]
    Open { topic: String, cause: String },
    /// /dev/shm is full (or limited).
    #[error(
        "{topic}: cannot reserve {needed_bytes} bytes of shared memory: {cause}; free space in /dev/shm (`df -h /dev/shm`) or enlarge it"
    )]
    NoMemory { topic: String, needed_bytes: u64, cause: String },
    /// Loan refused: readers hold more samples than agreed, or the port broke.
    #[error("{topic}: no sample to write into: {cause}")]
    Loan { topic: String, cause: String },
    /// Sending failed.
    #[error("{topic}: sending failed: {cause}")]
    Send { topic: String, cause: String },
    /// Receiving failed.
    #[error("{topic}: receiving failed: {cause}")]
    Receive { topic: String, cause: String },
    /// Waiting failed.
    #[error("waiting for events failed: {cause}")]
    Wait { cause: String },
    /// Listing failed.
    #[error("the topics cannot be listed: {cause}")]
    List { cause: String },
    /// No twin answers questions for that actuator.
    #[error(
        "{name}: no twin answers queries; is the twin running in this shared-memory domain, and does its scene have `queries = \"off\"`?"
    )]
    NobodyAnswers { name: String },
    /// The answer did not come in time.
    #[error("{name}: no answer within {timeout_ms} ms; the twin is busy or was stopped, ask again")]
    NoAnswer { name: String, timeout_ms: u64 },
    /// A field payload that does not fit its header.
    #[error("{topic}: {found} entries, but the header has {nodes} nodes x {fields} fields")]
    FieldShape { topic: String, found: usize, nodes: u32, fields: u32 },
}

impl WireError {
    /// Whether the domain that the user named cannot be joined as it is, so that starting again is of no use.
    pub fn is_configuration(&self) -> bool {
        matches!(
            self,
            Self::BadDomain { .. }
                | Self::LongDomain { .. }
                | Self::OthersDomain { .. }
                | Self::OpenFolder { .. }
        )
    }
}
