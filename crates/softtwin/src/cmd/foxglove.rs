//! `softtwin foxglove`: live topics for the Foxglove app.

use crate::live::DomainArgs;
use crate::output;
use crate::viewers::{Looks, Sender, Server, ViewerMessages};
use anyhow::{Context, Result};
use recording::Companion;
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::{AnyReader, Bus, Domain, KeyExpr, TopicKind, Waking};

/// Time between two looks at the topics.
const TICK: Duration = Duration::from_millis(10);
/// Most samples of a topic that are sent before the next topic has its turn.
const AT_ONCE: usize = 256;
/// Time between two searches for new topics.
const SCAN_INTERVAL: Duration = Duration::from_secs(1);

const EXAMPLES: &str = "\
Examples:
  In the Foxglove app: Open connection, Foxglove WebSocket, ws://localhost:8765:
    softtwin foxglove --scene config/scenes/finger.toml
  Points only (no model given), of one actuator:
    softtwin foxglove 'softtwin/finger/**'

Topics: viewer/NAME/SET/surface, .../points, .../frame and viewer/NAME/numbers (docs/viewers.md). The protocol knows no \
password: who reaches the port can watch, pages of other sites than --origin cannot. Nothing can be changed through it.";

/// Show running twins in the Foxglove app.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Topics, as a key expression (`*` one chunk, `**` any)
    #[arg(value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    #[command(flatten)]
    looks: Looks,
    /// Address to listen on
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), help_heading = "Network")]
    bind: IpAddr,
    /// Port to listen on; 0 takes any free one
    #[arg(long, value_name = "PORT", default_value_t = 8765, help_heading = "Network")]
    port: u16,
    /// Site whose pages may connect, beside this machine's; repeat for others
    #[arg(long, value_name = "URL", default_value = "https://app.foxglove.dev", help_heading = "Network")]
    origin: Vec<String>,
    #[command(flatten)]
    domain: DomainArgs,
}

/// A topic that is sent.
struct Source {
    reader: AnyReader,
    companion: Box<dyn Companion>,
}

impl Args {
    /// Serves until Ctrl-C.
    ///
    /// # Errors
    /// A port in use, a scene or model that cannot be read, a key expression that is none.
    pub fn run(self) -> Result<()> {
        let key = crate::live::key(&self.key)?;
        let messages = self.looks.messages()?;
        let stop = runtime::service::stop_flag()?;
        let web =
            tokio::runtime::Builder::new_current_thread().enable_all().build().context("no web runtime")?;
        web.block_on(async {
            let server = Server::bind(self.bind, self.port, self.origin).await?;
            output!(
                "{}\nOpen it in Foxglove as a Foxglove WebSocket connection; Ctrl-C ends.",
                server.url()?
            )?;
            let (sender, domain, ending) = (server.sender(), self.domain.domain(), stop.clone());
            let feed = std::thread::Builder::new().name("foxglove-feed".into());
            let feed = feed
                .spawn(move || feed_all(&domain, &key, &messages, &sender, &ending))
                .context("no thread")?;
            // Without its feed the server would stand still.
            let ended = async {
                while !stop.load(Ordering::Relaxed) && !feed.is_finished() {
                    tokio::time::sleep(TICK).await;
                }
            };
            server.run(ended).await;
            stop.store(true, Ordering::Relaxed);
            feed.join().unwrap_or_else(|_| anyhow::bail!("the feed's thread panicked; please report this"))
        })
    }
}

/// Sends what is in shared memory until `stop` is set. Ports exist only while there are clients.
fn feed_all(
    domain: &Domain,
    key: &KeyExpr,
    messages: &ViewerMessages,
    sender: &Sender,
    stop: &AtomicBool,
) -> Result<()> {
    let bus = Bus::open(domain).context("cannot join the shared-memory domain")?;
    let offset_ns = recording::wall_offset_ns();
    let mut sources = BTreeMap::new();
    let mut scanned: Option<Instant> = None;
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(TICK);
        if !sender.is_watched() {
            (sources, scanned) = (BTreeMap::new(), None);
            continue;
        }
        if scanned.is_none_or(|at| at.elapsed() > SCAN_INTERVAL) {
            open_new(&bus, key, messages, &mut sources);
            scanned = Some(Instant::now());
        }
        sources.retain(|name: &String, source: &mut Source| {
            let sent = send(source, sender, offset_ns);
            sent.inspect_err(|error| tracing::warn!("{name}: {error}; it is opened again")).is_ok()
        });
    }
    Ok(())
}

/// Opens the topics that are not open yet. One that cannot be opened is told and tried again.
fn open_new(bus: &Bus, key: &KeyExpr, messages: &ViewerMessages, sources: &mut BTreeMap<String, Source>) {
    let topics = bus.names(key).unwrap_or_else(|error| {
        tracing::warn!("topics cannot be listed: {error}");
        Vec::new()
    });
    for topic in topics {
        if sources.contains_key(topic.name()) {
            continue;
        }
        let Some(companion) = messages.of(&topic) else { continue };
        match AnyReader::attach_as(bus, &topic, Waking::Never) {
            Ok(reader) => _ = sources.insert(topic.name().to_owned(), Source { reader, companion }),
            Err(error) => tracing::warn!("not shown: {error}"),
        }
    }
}

/// Sends what is waiting in a topic, of a field the newest only: a fast one would never run empty.
fn send(source: &mut Source, sender: &Sender, offset_ns: u64) -> Result<(), wire::WireError> {
    let is_field = source.reader.topic().kind() == TopicKind::Field;
    for _ in 0..if is_field { 1 } else { AT_ONCE } {
        let sample = if is_field { source.reader.newest()? } else { source.reader.next()? };
        let Some(sample) = sample else { break };
        let published_ns = sample.stamp().t_publish_ns.saturating_add(offset_ns);
        for (channel, data) in source.companion.messages(&sample, published_ns) {
            sender.send(&channel, published_ns, data);
        }
    }
    Ok(())
}
