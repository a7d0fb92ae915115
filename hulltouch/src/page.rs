//! The page beside a run: where it is served, who may steer, and the lines that say so.

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::Arc;

use camera_node::SourceConfig;
use clap::Args;
use coordinator::live::{Live, live};
use feed::pictures::Pictures;
use feed::{Feed, FeedError, FeedSettings, RunFacts, Token};

use crate::cluster_file::ClusterFile;
use crate::failure::{Failure, Outcome};
use crate::run::Setup;

/// Where the page is unless somebody says otherwise.
const LISTEN: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 8470);

/// Who may look, and who may steer.
#[derive(Clone, Debug, Default, Args)]
pub struct PageArguments {
    /// Serve the page at this address [default: 127.0.0.1:8470, or a free port if that is taken].
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// What lets a page steer the run, at least 8 letters and digits [default: a new one each run].
    #[arg(long, value_name = "T", env = "HULLTOUCH_TOKEN", hide_env_values = true)]
    token: Option<String>,
}

impl PageArguments {
    /// Where to serve, and for whom; `None`: nowhere. A headless run serves only where it is told to.
    pub fn checked(&self, headless: bool) -> Outcome<Option<FeedSettings>> {
        if headless && self.listen.is_none() {
            return Ok(None);
        }
        let token = match &self.token {
            Some(text) => Token::new(text).map_err(|why| Failure::input(format_args!("--token is {why}")))?,
            None => Token::random().map_err(Failure::run)?,
        };
        let (listen, or_any_port) = (self.listen.unwrap_or(LISTEN), self.listen.is_none());
        Ok(Some(FeedSettings { listen, or_any_port, token }))
    }
}

/// What a page shows of the cameras.
pub struct PageSource {
    /// Makes what is asked for pictures; called within the page's own runtime.
    pub pictures: Box<dyn FnOnce() -> Arc<dyn Pictures>>,
    /// Whether any of it has colours.
    pub has_colour: bool,
}

impl PageSource {
    /// Of the cameras of a cluster file.
    pub fn of_cameras<P: Pictures + 'static>(
        file: &ClusterFile,
        pictures: impl FnOnce() -> Arc<P> + 'static,
    ) -> PageSource {
        let has_colour = file.cameras.iter().any(|camera| !matches!(camera.source, SourceConfig::Masks(_)));
        PageSource { pictures: Box::new(move || pictures()), has_colour }
    }
}

/// Serves the page of a run, and says where. What is returned beside the server belongs to the run.
pub fn serve(setup: &Setup, step_s: f64, source: PageSource) -> Outcome<Option<(Feed, Live)>> {
    let Some(settings) = &setup.page else { return Ok(None) };
    let (live, follower) = live();
    let file = &setup.file;
    let facts = RunFacts {
        rig: file.rig.clone(),
        probes: file.probes,
        fps: file.fps,
        step_s,
        latency_s: file.latency_s,
        up: setup.scene.up(),
        floor_m: setup.scene.floor().map(|floor| floor.height_m),
        has_colour: source.has_colour,
    };
    let feed = Feed::start(settings, facts, follower, source.pictures).map_err(|error| match error {
        FeedError::Listen { .. } => Failure::input(format_args!("--listen: {error}")),
        FeedError::System(_) => Failure::run(error),
    })?;
    let address = feed.address();
    if !address.ip().is_loopback() {
        tracing::warn!("the page at {address} is open to everyone who reaches it, without encryption");
    }
    let token = settings.token.text();
    // A closed standard error is no reason not to run.
    let _ = writeln!(std::io::stderr(), "page: http://{address}/?token={token}\nviewers: http://{address}/");
    Ok(Some((feed, live)))
}
