//! What others see of a run: where its page is served and who may steer, where OSC goes, and the lines that say so.

use std::io::Write as _;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::sync::Arc;

use camera_node::{NodeConfig, SourceConfig};
use clap::Args;
use coordinator::live::{Follower, Live, live};
use feed::pictures::Pictures;
use feed::{Feed, FeedError, FeedSettings, Origin, Osc, RunInfo, Token};
use hull::Silhouette;

use super::setup::Setup;
use cli::{Failure, Outcome};

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
    /// Where a proxy with a certificate shows the page, as in https://studio.example: its name is answered too.
    #[arg(long, value_name = "ORIGIN")]
    origin: Option<String>,
    /// Send the world as Open Sound Control to this address, over UDP.
    #[arg(long, value_name = "HOST:PORT")]
    osc: Option<String>,
}

/// Where a run can be seen and steered; by default nowhere.
#[derive(Clone, Debug, Default)]
pub struct Outlets {
    /// The page, and what programs use.
    pub page: Option<FeedSettings>,
    /// Who gets OSC.
    pub osc: Option<SocketAddr>,
}

/// What serves as long as it lives.
#[derive(Debug)]
pub struct Served {
    _page: Option<Feed>,
    _osc: Option<Osc>,
}

impl PageArguments {
    /// What is served where, and for whom. A headless run serves its page only where it is told to.
    pub fn checked(&self, headless: bool) -> Outcome<Outlets> {
        Ok(Outlets { page: self.page(headless)?, osc: self.osc.as_deref().map(osc_address).transpose()? })
    }

    fn page(&self, headless: bool) -> Outcome<Option<FeedSettings>> {
        if headless && self.listen.is_none() {
            return Ok(None);
        }
        let token = match &self.token {
            Some(text) => Token::new(text).map_err(|why| Failure::input(format_args!("--token is {why}")))?,
            None => Token::random().map_err(Failure::run)?,
        };
        let (listen, or_any_port) = (self.listen.unwrap_or(LISTEN), self.listen.is_none());
        let origin = self.origin.as_deref().map(Origin::new).transpose();
        let origin = origin.map_err(|why| Failure::input(format_args!("--origin is {why}")))?;
        Ok(Some(FeedSettings { listen, or_any_port, token, origin }))
    }
}

/// What a page shows of the cameras.
pub struct PageSource {
    /// Makes what is asked for pictures; called within the page's own runtime.
    pub pictures: Box<dyn FnOnce() -> Arc<dyn Pictures>>,
    /// Which pixels each camera ignores, in rig order.
    pub ignored: Vec<Option<Silhouette>>,
    /// Whether any of it has colours.
    pub has_colour: bool,
    /// Whether it is a recording that is shown.
    pub is_replay: bool,
}

impl PageSource {
    /// Of these cameras.
    pub fn of_cameras<P: Pictures + 'static>(
        config: &NodeConfig,
        pictures: impl FnOnce() -> Arc<P> + 'static,
    ) -> PageSource {
        let cameras = &config.cameras;
        PageSource {
            pictures: Box::new(move || pictures()),
            ignored: cameras.iter().map(|camera| camera.ignored.clone()).collect(),
            has_colour: cameras.iter().any(|camera| !matches!(camera.source, SourceConfig::Masks(_))),
            is_replay: false,
        }
    }
}

/// The address that a host's name and a port mean.
fn osc_address(text: &str) -> Outcome<SocketAddr> {
    let wrong = |why: &str| Failure::input(format_args!("--osc {text}: {why}, expected HOST:PORT"));
    let found: Vec<SocketAddr> = text.to_socket_addrs().map_err(|error| wrong(&error.to_string()))?.collect();
    // A name may mean both; tools that take OSC listen on the older one.
    let old = found.iter().find(|address| address.is_ipv4());
    old.or(found.first()).copied().ok_or_else(|| wrong("no such host"))
}

/// Serves a run where its outlets say. What is returned beside the server belongs to the run; without a source
/// there is no page.
pub fn serve(setup: &Setup, source: Option<PageSource>) -> Outcome<Option<(Served, Live)>> {
    let Outlets { page, osc } = &setup.outlets;
    let page = page.as_ref().zip(source);
    if page.is_none() && osc.is_none() {
        return Ok(None);
    }
    let (live, follower) = live();
    let osc = osc.map(|to| Osc::start(to, follower.clone()));
    let osc = osc.transpose().map_err(|why| Failure::input(format_args!("--osc: {why}")))?;
    let page = page.map(|(settings, source)| serve_page(setup, settings, follower, source));
    Ok(Some((Served { _page: page.transpose()?, _osc: osc }, live)))
}

fn serve_page(
    setup: &Setup,
    settings: &FeedSettings,
    follower: Follower,
    source: PageSource,
) -> Outcome<Feed> {
    let file = &setup.file;
    let info = RunInfo {
        rig: file.rig.clone(),
        ignored: source.ignored,
        probes: file.probes,
        fps: file.fps,
        step_s: setup.world.dt_s,
        response: setup.world.response,
        latency_s: file.latency_s,
        up: setup.scene.up(),
        floor_m: setup.scene.floor().map(|floor| floor.height_m),
        has_colour: source.has_colour,
        is_replay: source.is_replay,
    };
    let feed = Feed::start(settings, info, follower, source.pictures).map_err(|error| match error {
        FeedError::Listen { .. } => Failure::input(format_args!("--listen: {error}")),
        FeedError::System(_) | FeedError::Random(_) => Failure::run(error),
    })?;
    let address = feed.address();
    if !address.ip().is_loopback() {
        tracing::warn!("the page at {address} is open to everyone who reaches it, without encryption");
    }
    let token = settings.token.text();
    // A closed standard error is no reason not to run.
    let _ = writeln!(std::io::stderr(), "page: http://{address}/?token={token}\nviewers: http://{address}/");
    Ok(feed)
}
