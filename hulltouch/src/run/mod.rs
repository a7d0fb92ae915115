//! A run from a cluster file: what `demo`, `coordinator`, `record` and `replay` share.

mod console;
pub mod metrics;
pub mod options;
pub mod outlets;
pub mod page;
pub mod play;
pub mod recorded_pictures;
mod recording;
mod report;
pub mod run_setup;
pub mod security;
mod snapshot;
pub mod token;

use std::sync::Arc;
use std::time::Duration;

use ::recording::ColourSource;
use camera_node::NodeConfig;
use coordinator::{Placement, Transport};
use node_client::NodePictures;
use node_client::{Agreement, ExpectedNode};
use setup::cli::{Failure, Outcome};
use setup::{InProcess, LocalCluster, LocalNodes, Sockets};
use sim::World;
use web_server::pictures::Pictures;

use self::outlets::PageSource;
use self::play::{RunPlan, play};
use self::run_setup::{Setup, TransportName};

/// How long nodes on this machine may take to connect (they listen already), and their cameras to film.
const LOCAL_CONNECT_TIMEOUT: Duration = Duration::from_secs(20);

/// Runs on this machine: nodes as processes, or everything in this one.
pub fn run_locally(setup: &Setup) -> Outcome {
    setup.prepare_outputs()?;
    let cameras = cameras(setup)?;
    if let Some(short) = cameras.check_films(setup.lock_step.then_some(coordinator::FRAMES_AHEAD))? {
        tracing::warn!("{short}");
    }
    if setup.transport != TransportName::Inprocess {
        let told = LocalNodes { empty: setup.empty, otlp: setup.outlets.otlp.as_ref(), certs: None };
        let cluster = LocalCluster::start(&setup.file, Sockets::default(), told)?;
        return run_over_nodes(setup, &cameras, cluster.nodes().to_vec(), LOCAL_CONNECT_TIMEOUT);
    }
    let frames = InProcess::prepare(&cameras)?;
    let pictures = Arc::new(frames.pictures(&cameras).map_err(Failure::run)?);
    let of_recording = Arc::clone(&pictures);
    let colours = colour_source(setup, || of_recording);
    let page = PageSource::of_cameras(&cameras, || pictures);
    let transport = |_: &World, _| Transport::in_process(Box::new(frames));
    run(setup, &cameras, transport, page, colours, LOCAL_CONNECT_TIMEOUT)
}

/// Runs against the nodes of the cluster file, at their addresses or wherever they are found, which have so long to
/// connect.
pub fn run_deployed(setup: &Setup, connect_timeout: Duration) -> Outcome {
    setup.prepare_outputs()?;
    let cameras = cameras(setup)?;
    let nodes = setup.file.expected_nodes()?;
    run_over_nodes(setup, &cameras, nodes, connect_timeout)
}

/// The cameras of the rig; refuses a rule that no point could ever meet.
fn cameras(setup: &Setup) -> Outcome<NodeConfig> {
    let (found, min_views) = (setup.file.cameras.len(), setup.file.probes.rule().min_views);
    if min_views as usize > found {
        return Err(Failure::input(format_args!(
            "min_views is {min_views}, expected at most the {found} cameras"
        )));
    }
    Ok(setup.file.rig_config(setup.empty)?)
}

/// Runs against nodes. Pictures come over connections of the page's and of the recording's own.
fn run_over_nodes(
    setup: &Setup,
    cameras: &NodeConfig,
    nodes: Vec<ExpectedNode>,
    connect_timeout: Duration,
) -> Outcome {
    let (of_recording, of_page) = (nodes.clone(), nodes.clone());
    let (dial, dial_of_page) = (Arc::clone(&setup.dial), Arc::clone(&setup.dial));
    let colours = colour_source(setup, move || Arc::new(NodePictures::new(of_recording, &dial)));
    let page = PageSource::of_cameras(cameras, move || Arc::new(NodePictures::new(of_page, &dial_of_page)));
    let transport = |world: &World, gather| connect(setup, nodes, world, gather);
    run(setup, cameras, transport, page, colours, connect_timeout)
}

/// Colours for the recording, if it is to have any.
fn colour_source<P: Pictures + 'static>(
    setup: &Setup,
    make: impl FnOnce() -> Arc<P> + Send + 'static,
) -> Option<ColourSource> {
    setup.record.as_ref().filter(|to| to.colour).map(|_| recording::colour_source(make))
}

fn connect(setup: &Setup, nodes: Vec<ExpectedNode>, world: &World, placement: Placement) -> Transport {
    let mut shapes: Vec<Arc<hull::Shape>> = world.asked_shapes().collect();
    shapes.sort_by_key(|shape| shape.digest());
    shapes.dedup_by_key(|shape| shape.digest());
    let agreement = Agreement::new(setup.file.probes, setup.file.fps, shapes).with_role(setup.role);
    let agreement = agreement.dialling(Arc::clone(&setup.dial));
    Transport::connect(nodes, placement, agreement).with_precision(setup.file.precision)
}

fn run(
    setup: &Setup,
    cameras: &NodeConfig,
    transport: impl FnOnce(&World, Placement) -> Transport,
    page: PageSource,
    colours: Option<ColourSource>,
    connect_timeout: Duration,
) -> Outcome {
    let mut plan = RunPlan {
        observers: cameras.observers(),
        recorder: None,
        schedule: None,
        playback: None,
        file: None,
        page: Some(page),
        connect_timeout,
    };
    if let Some(to) = &setup.record {
        let (recorder, file) = recording::begin(setup, to, cameras, colours)?;
        plan.recorder = Some(Box::new(recorder));
        plan.file = Some(file);
    }
    let outcome = play(setup, plan, transport)?;
    outcome.report(setup)?;
    outcome.failure.map_or(Ok(()), Err)
}
