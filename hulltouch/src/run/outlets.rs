//! What others see of a run: serves its page and sends OSC.

use std::io::{IsTerminal as _, Write as _};
use std::sync::Arc;

use camera_node::NodeConfig;
use coordinator::live::{Follower, Live, live};
use hull::Silhouette;
use setup::cli::{Failure, Outcome};
use web_server::pictures::Pictures;
use web_server::{Feed, FeedError, Osc, RunInfo};

use super::options::Outlets;
use super::page::PagePlan;
use super::run_setup::Setup;

/// What serves as long as it lives.
#[derive(Debug)]
pub struct Served {
    _page: Option<Feed>,
    _osc: Option<Osc>,
}

/// What a page shows of the cameras.
pub struct PageSource {
    /// Makes what is asked for pictures; called within the page's own runtime.
    pub pictures: Box<dyn FnOnce() -> Arc<dyn Pictures>>,
    /// Which pixels each camera ignores, in rig order.
    pub ignored: Vec<Option<Silhouette>>,
    /// Whether any of it has colours.
    pub has_colour: bool,
    /// Film time of the last step of the recording that is shown, seconds, if one is.
    pub length_s: Option<f64>,
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
            has_colour: cameras.iter().any(|camera| !camera.source.gives_masks()),
            length_s: None,
        }
    }
}

/// Serves a run where its outlets say. What is returned beside the server belongs to the run; without a source
/// there is no page.
pub fn serve(setup: &Setup, source: Option<PageSource>) -> Outcome<Option<(Served, Live)>> {
    let Outlets { page, osc, .. } = &setup.outlets;
    let page = page.as_ref().zip(source);
    if page.is_none() && osc.is_none() {
        return Ok(None);
    }
    let (live, follower) = live();
    let osc = osc.map(|to| Osc::start(to, follower.clone()));
    let osc = osc.transpose().map_err(|why| Failure::input(format_args!("--osc: {why}")))?;
    let page = page.map(|(plan, source)| serve_page(setup, plan, follower, source));
    Ok(Some((Served { _page: page.transpose()?, _osc: osc }, live)))
}

fn serve_page(setup: &Setup, plan: &PagePlan, follower: Follower, source: PageSource) -> Outcome<Feed> {
    let file = &setup.file;
    let info = RunInfo {
        rig: file.rig.clone(),
        ignored: source.ignored,
        probes: file.probes,
        fps: file.fps,
        step_s: setup.world.dt_s,
        response: setup.world.response,
        latency_s: file
            .latency_s
            .map(|latency_s| latency_s + setup.world.hull_time.frames_later() / file.fps),
        up: setup.scene.up(),
        floor_m: setup.scene.floor().map(|floor| floor.height_m),
        has_colour: source.has_colour,
        is_replay: source.length_s.is_some(),
        length_s: source.length_s,
        film_waits: setup.lock_step || source.length_s.is_some(),
        insecure: plan.insecure.clone(),
    };
    let feed = Feed::start(&plan.feed, info, follower, source.pictures).map_err(|error| match error {
        FeedError::Listen { .. } => Failure::input(format_args!("--listen: {error}")),
        FeedError::System(_) | FeedError::Random(_) => Failure::run(error),
    })?;
    let address = feed.address();
    plan.warn(address);
    let mut stderr = std::io::stderr();
    let announcement = plan.announcement(address, stderr.is_terminal());
    // A closed standard error is no reason not to run.
    let _ = stderr.write_all(announcement.as_bytes());
    plan.open(address);
    Ok(feed)
}
