//! `softtwin view`: the live view in a browser.

use crate::failure::{configuration, usage};
use crate::live::DomainArgs;
use crate::load::LoadedModel;
use crate::output;
use crate::view::{Catalogue, Command, Guard, Hub, Library, Player, Reader, Server, Stand, open_port};
use anyhow::{Context, Result};
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use wire::KeyExpr;

const EXAMPLES: &str = "\
Examples:
  Everything that twins on this machine publish, on http://127.0.0.1:7411/:
    softtwin view --model models/pneunet/pneunet.twin
  A whole scene, every actuator where it stands:
    softtwin view --scene config/scenes/gripper.toml
  Two actuators of several:
    softtwin view --model finger.twin --key 'softtwin/finger_*/**'
  No sensor at hand: press \"What if\" on the page and move the sliders:
    softtwin view --model finger.twin
  What happened: a recording, or a folder of recordings to choose from:
    softtwin view --model finger.twin --recording run.mcap
  For other machines, with a token in the printed address:
    softtwin view --model finger.twin --bind 0.0.0.0

The surface is drawn when the model that the twin runs is given; without it, nodes are drawn as points.
Keys on the page: 1-4 views, F fit, space pause, L light, M mesh lines, T theme.";

/// Look at running twins in a browser: the deformed, stressed body, live.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Model file of an actuator that will be seen; repeat for several.
    #[arg(long, value_name = "FILE")]
    model: Vec<PathBuf>,
    /// Scene file: its models, and where its actuators and blocks stand.
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// Topics to look at, as a key expression (`*` one chunk, `**` any).
    #[arg(long, value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// Play this recording, or those of this folder, instead of live topics.
    #[arg(long, value_name = "PATH", conflicts_with = "key")]
    recording: Option<PathBuf>,
    /// Address to listen on; anything but loopback asks visitors for a token.
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,
    /// Port to listen on; 0 takes any free one.
    #[arg(long, value_name = "PORT", default_value_t = 7411)]
    port: u16,
    /// Token that visitors must have (8 to 64 letters and digits); made up when needed and left out.
    #[arg(long, value_name = "TEXT", value_parser = parse_token)]
    token: Option<String>,
    #[command(flatten)]
    domain: DomainArgs,
}

/// The thread that fills the slots, and how to end it.
struct Feed {
    thread: JoinHandle<Result<()>>,
    stop: Stop,
}

/// Live feeds end when their channel closes, recordings when they are told.
enum Stop {
    Live(mpsc::Sender<()>),
    Recording(Library, mpsc::Sender<Command>),
}

fn parse_token(text: &str) -> Result<String, String> {
    let fine = (8..=64).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if fine { Ok(text.to_owned()) } else { Err("expected 8 to 64 letters and digits".into()) }
}

impl Args {
    /// Serves until Ctrl-C.
    ///
    /// # Errors
    /// A port in use, a model that cannot be read, a key expression that is none.
    pub fn run(self) -> Result<()> {
        let key = KeyExpr::new(&self.key).map_err(|error| usage(format!("--key {:?}: {error}", self.key)))?;
        let scene = self.scene.as_deref().map(runtime::config::Scene::load).transpose();
        let scene = scene.map_err(configuration)?;
        let mut paths = self.model.clone();
        for actuator in scene.iter().flat_map(|scene| &scene.actuators) {
            let path = scene.as_ref().map(|scene| scene.resolve(&actuator.model)).unwrap_or_default();
            if !paths.contains(&path) {
                paths.push(path);
            }
        }
        let models = paths.iter().map(|path| LoadedModel::read(path)).collect::<Result<_>>()?;
        let catalogue = Arc::new(Catalogue::new(models, scene.as_ref().map(Stand::of).unwrap_or_default())?);
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().context("no web runtime")?;
        runtime.block_on(self.serve(key, catalogue))
    }

    async fn serve(self, key: KeyExpr, catalogue: Arc<Catalogue>) -> Result<()> {
        let listener = open_port(self.bind, self.port).await?;
        let hub = Arc::new(Hub::default());
        let guard = Guard::new(self.bind, self.token.clone())?;
        let Feed { thread, stop } = self.feed(key, &catalogue, &hub)?;
        let player = match &stop {
            Stop::Live(_) => None,
            Stop::Recording(library, commands) => Some((library.clone(), commands.clone())),
        };
        let server = Server { listener, guard, catalogue, hub, player };
        output!("{}\nOpen it in a browser; Ctrl-C ends the viewer.", server.url()?)?;
        let served = server.run(end_of_service()).await;
        match stop {
            Stop::Live(open) => drop(open),
            Stop::Recording(_, commands) => {
                // A player that has ended already needs no telling.
                let _ = commands.send(Command::End);
            }
        }
        match thread.join() {
            Ok(read) => served.and(read),
            Err(_) => anyhow::bail!("the reader thread broke; please report this"),
        }
    }

    /// Starts what fills the slots.
    fn feed(&self, key: KeyExpr, catalogue: &Arc<Catalogue>, hub: &Arc<Hub>) -> Result<Feed> {
        let named = |name: &str| std::thread::Builder::new().name(name.into());
        let (catalogue, hub) = (Arc::clone(catalogue), Arc::clone(hub));
        if let Some(path) = &self.recording {
            let library = Library::new(path)?;
            let player = Player::new(library.clone(), catalogue, hub)?;
            let (commands, wishes) = mpsc::channel();
            let play = move || {
                player.run(&wishes);
                Ok(())
            };
            let thread = named("view-player").spawn(play).context("no thread for the player")?;
            return Ok(Feed { thread, stop: Stop::Recording(library, commands) });
        }
        let reader = Reader { domain: self.domain.domain(), key, catalogue, hub };
        let (open, stopped) = mpsc::channel();
        let thread = named("view-reader").spawn(move || reader.run(&stopped));
        Ok(Feed { thread: thread.context("no thread for the reader")?, stop: Stop::Live(open) })
    }
}

/// Done at Ctrl-C or a polite kill.
async fn end_of_service() {
    let term = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate());
    let Ok(mut term) = term else {
        return std::future::pending().await; // without signals only a kill ends the viewer
    };
    tokio::select! {
        _ = tokio::signal::ctrl_c() => {}
        _ = term.recv() => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_plain_and_not_short() {
        assert!(parse_token("abcdef12").is_ok());
        for wrong in ["", "short", "with space 1", "semi;colon1", &"a".repeat(65)] {
            assert!(parse_token(wrong).is_err(), "{wrong}");
        }
    }
}
