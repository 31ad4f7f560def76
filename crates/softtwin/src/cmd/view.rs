//! `softtwin view`: the live view in a browser.

use super::draw;
use crate::failure::{configuration, usage};
use crate::files;
use crate::live::DomainArgs;
use crate::output;
use anyhow::{Context, Result};
use runtime::config::Scene;
use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread::JoinHandle;
use std::time::Duration;
use viewer::{
    Catalogue, Command, Guard, Hub, Library, NamedModel, Picture, Player, Reader, Server, Shared, Stand,
    open_port,
};
use wire::KeyExpr;

/// How often the server checks for a signal to end.
const STOP_INTERVAL: Duration = Duration::from_millis(50);

/// Largest picture that is served.
const MAX_PICTURE_BYTES: u64 = 1 << 26;
const SVG: &str = "image/svg+xml";

const EXAMPLES: &str = "\
Examples:
  Everything that twins on this machine publish, on http://127.0.0.1:7411/:
    softtwin view models/pneunet/pneunet.twin
  A whole scene, every actuator where it stands:
    softtwin view --scene config/scenes/gripper.toml
  Two actuators of several:
    softtwin view finger.twin --key 'softtwin/finger_*/**'
  Without a sensor: press \"What if\" and move the sliders:
    softtwin view finger.twin
  A recording, or a folder of recordings to choose from (the files of a recorder that rotates are one recording):
    softtwin view finger.twin --recording run.mcap
    softtwin view finger.twin --recording /var/lib/softtwin
  A measured model with the pictures of its comparison, under /pictures:
    softtwin view mine.twin --compare compared
  For other machines, with a token in the printed address:
    softtwin view finger.twin --bind 0.0.0.0

The surface is drawn when the model that the twin runs is given; without it, nodes are drawn as points.
Keys: 1-4 views, F fit, space pause, L shading, M mesh lines, T dark, P picture, R record a film.";

/// Show running twins in a browser: the deformed, stressed body, live.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Models of the actuators to show.
    #[arg(value_name = "FILE.twin")]
    models: Vec<PathBuf>,
    /// Scene file: its models, and where its actuators and blocks stand.
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// Topics to show, as a key expression (`*` one chunk, `**` any).
    #[arg(long, value_name = "KEY", default_value = "softtwin/**", help_heading = "Selection")]
    key: String,
    /// Play this recording, or those of this folder, instead of live topics.
    #[arg(long, value_name = "PATH", conflicts_with = "key")]
    recording: Option<PathBuf>,
    /// Show the pictures of this folder of `softtwin compare` under /pictures, with the curves of measured models.
    #[arg(long, value_name = "DIR")]
    compare: Option<PathBuf>,
    /// Address to listen on; clients of any address but loopback need a token.
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST), help_heading = "Network")]
    bind: IpAddr,
    /// Port to listen on; 0 takes any free one.
    #[arg(long, value_name = "PORT", default_value_t = 7411, help_heading = "Network")]
    port: u16,
    /// Token that clients must have (8 to 64 letters and digits) [default: random if needed].
    #[arg(long, value_name = "TEXT", value_parser = parse_token)]
    token: Option<String>,
    #[command(flatten)]
    domain: DomainArgs,
}

/// The thread that fills the hub, and what pages control it by when it plays recordings.
type Feed = (JoinHandle<Result<()>>, Option<(Library, Sender<Command>)>);

fn parse_token(text: &str) -> Result<String, String> {
    let fine = (8..=64).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if fine { Ok(text.to_owned()) } else { Err("expected 8 to 64 letters and digits".into()) }
}

impl Args {
    /// Serves until Ctrl-C.
    ///
    /// # Errors
    /// The port is in use, a model cannot be read, or a key expression is invalid.
    pub fn run(self) -> Result<()> {
        let key = KeyExpr::new(&self.key).map_err(|error| usage(format!("--key {:?}: {error}", self.key)))?;
        let catalogue = Arc::new(self.catalogue()?);
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().context("no web runtime")?;
        runtime.block_on(self.serve(key, catalogue))
    }

    /// The models that are named and those of the scene, which also says where the actuators stand.
    fn catalogue(&self) -> Result<Catalogue> {
        let scene = self.scene.as_deref().map(Scene::load).transpose().map_err(configuration)?;
        let mut paths = self.models.clone();
        for actuator in scene.iter().flat_map(|scene| &scene.actuators) {
            if !paths.contains(&actuator.model) {
                paths.push(actuator.model.clone());
            }
        }
        let named = |path: PathBuf| {
            let (model, hash) = files::model_and_hash(&path)?;
            Ok(NamedModel { path, model, hash })
        };
        let models = paths.into_iter().map(named).collect::<Result<Vec<_>>>()?;
        Catalogue::new(&models, scene.as_ref().map(Stand::of).unwrap_or_default())
    }

    async fn serve(self, key: KeyExpr, catalogue: Arc<Catalogue>) -> Result<()> {
        let listener = open_port(self.bind, self.port).await?;
        let guard = Guard::new(self.bind, self.token.clone())?;
        let hub = Arc::new(Hub::default());
        let stop = runtime::service::stop_flag()?;
        let pictures = self.pictures(&catalogue)?.into();
        let (thread, player) = self.feed(key, &catalogue, &hub, &stop)?;
        let server = Server { listener, guard, shared: Shared { pictures, catalogue, hub, player } };
        output!("{}\nOpen it in a browser; Ctrl-C ends the viewer.", server.url()?)?;
        server.run(is_set(&stop)).await;
        stop.store(true, Ordering::Relaxed);
        thread.join().unwrap_or_else(|_| anyhow::bail!("the reader thread panicked; please report this"))
    }

    /// Pictures of the comparison and of the measured models.
    fn pictures(&self, catalogue: &Catalogue) -> Result<Vec<Picture>> {
        let mut pictures = Vec::new();
        if let Some(folder) = &self.compare {
            let read = |name: &str| formats::file::read_bytes(&folder.join(name), MAX_PICTURE_BYTES);
            let one = |title: &str, kind, content: Vec<u8>| Picture {
                title: title.into(),
                kind,
                content: content.into(),
            };
            let comparison = read("compare.svg").map_err(files::refusal)?;
            pictures.push(one("Model and measurement", SVG, comparison));
            // Only models with coordinates have it.
            if folder.join("body.png").exists() {
                let body = read("body.png").map_err(files::refusal)?;
                pictures.push(one("Measured markers", "image/png", body));
            }
        }
        let curves = |path: &Path| {
            let figure = draw::observables(&files::model(path)?)?;
            Ok(Picture { title: path.display().to_string(), kind: SVG, content: figure.svg()?.into() })
        };
        pictures.extend(catalogue.measured().map(curves).collect::<Result<Vec<_>>>()?);
        Ok(pictures)
    }

    /// Starts the thread that fills the hub. It ends when `stop` is set.
    fn feed(
        &self,
        key: KeyExpr,
        catalogue: &Arc<Catalogue>,
        hub: &Arc<Hub>,
        stop: &Arc<AtomicBool>,
    ) -> Result<Feed> {
        let (catalogue, hub, stop) = (Arc::clone(catalogue), Arc::clone(hub), Arc::clone(stop));
        let thread = std::thread::Builder::new().name("view-feed".into());
        let Some(path) = &self.recording else {
            let reader = Reader { domain: self.domain.domain(), key, catalogue, hub };
            let thread = thread.spawn(move || reader.run(&stop)).context("no thread for the reader")?;
            return Ok((thread, None));
        };
        let library = Library::new(path)?;
        let player = Player::new(library.clone(), catalogue, hub, &stop).map_err(configuration)?;
        let (sender, commands) = mpsc::channel();
        let play = move || {
            player.run(&commands, &stop);
            Ok(())
        };
        let thread = thread.spawn(play).context("no thread for the player")?;
        Ok((thread, Some((library, sender))))
    }
}

/// Ends when the flag is set.
async fn is_set(flag: &AtomicBool) {
    while !flag.load(Ordering::Relaxed) {
        tokio::time::sleep(STOP_INTERVAL).await;
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cmd_view.rs"]
mod tests;
