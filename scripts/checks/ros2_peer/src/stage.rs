//! Where the checks run: a node of hiroz, and the files in which our own programs say the same.

use hiroz::Builder;
use hiroz::config::RouterConfigBuilder;
use hiroz::context::{ZContext, ZContextBuilder};
use hiroz::msg::{ZDeserializer, ZMessage, ZService};
use hiroz::node::ZNode;
use hiroz::service::ZClient;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// Any error.
pub type Error = Box<dyn std::error::Error + Send + Sync>;
/// Result of a check.
pub type Seen = Result<String, Error>;

/// `ROS_DOMAIN_ID` of the gateway's configuration.
const DOMAIN: usize = 7;
/// Longest wait for anything.
pub const PATIENCE: Duration = Duration::from_secs(60);
const PACE: Duration = Duration::from_millis(20);

/// A node, and the folder with what our own programs say.
pub struct Stage {
    pub node: Arc<ZNode>,
    pub runtime: Runtime,
    folder: PathBuf,
}

impl Stage {
    /// Joins the network at the address of a router, or of the gateway itself.
    pub fn join(endpoint: &str, folder: PathBuf) -> Result<Self, Error> {
        let context =
            ZContextBuilder::default().with_domain_id(DOMAIN).with_router_endpoint(endpoint)?.build()?;
        let node = Arc::new(context.create_node("peer").build()?);
        Ok(Self { node, runtime: Runtime::new()?, folder })
    }

    /// The text of a file in the folder.
    pub fn text(&self, name: &str) -> Result<String, Error> {
        read(&self.folder.join(name))
    }

    /// The samples of a file that `softtwin echo --json` writes; the last line may not be complete yet.
    pub fn samples(&self, name: &str) -> Result<Vec<Value>, Error> {
        let text = self.text(name)?;
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        complete.lines().map(|line| Ok(serde_json::from_str::<Value>(line)?["sample"].take())).collect()
    }

    /// The answer of a service. A client that is new may not be connected to it yet: it asks again.
    pub fn call<T: ZService>(&self, client: &ZClient<T>, request: &T::Request) -> Result<T::Response, Error>
    where
        T::Request: ZMessage,
        T::Response: ZMessage,
        for<'a> <T::Response as ZMessage>::Serdes: ZDeserializer<Output = T::Response, Input<'a> = &'a [u8]>,
    {
        until(|| self.block_on(client.call(request)))
    }

    /// Result of an operation of hiroz, within the patience.
    pub fn block_on<T>(&self, operation: impl Future<Output = hiroz::Result<T>>) -> Result<T, Error> {
        let limited = async { tokio::time::timeout(PATIENCE, operation).await };
        self.runtime.block_on(limited).map_err(|_| Error::from("no answer came"))?
    }
}

/// A router with the settings of `rmw_zenohd`, as long as the result exists.
pub fn router(endpoint: &str) -> Result<ZContext, Error> {
    let config = RouterConfigBuilder::new().with_listen_endpoint(endpoint).build_config()?;
    ZContextBuilder::default().with_zenoh_config(config).build()
}

/// The text of a file.
pub fn read(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()).into())
}

/// An error unless it holds.
pub fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Result<(), Error> {
    if holds { Ok(()) } else { Err(otherwise().into()) }
}

/// Tries until it succeeds, at most as long as the patience lasts; then the last error.
pub fn until<T>(mut attempt: impl FnMut() -> Result<T, Error>) -> Result<T, Error> {
    let end = Instant::now() + PATIENCE;
    loop {
        match attempt() {
            Err(_) if Instant::now() < end => std::thread::sleep(PACE),
            result => return result,
        }
    }
}
