//! One cluster of node processes, asked about several numbers of bodies.

use std::sync::Arc;

use proto::convert::Precision;
use setup::cli::Outcome;
use setup::{LocalCluster, LocalNodes};
use sim::ResponseMode;

use super::bodies::Bodies;
use super::certificates::Certificates;
use super::connection::{AnswerPlace, ClusterClient, PassCosts, PointForm};
use super::film::{Film, FilmPlan};
use super::names::SocketName;
use super::rows::{Row, stages};
use crate::usage::{process_cpu_s, process_memory_mb};

/// Frames of the film: the ring of every node is full.
const FRAMES: u64 = camera_node::frames::RING_FRAMES as u64;
/// Fewer cameras would be another hull: they are spread over the nodes instead.
const LEAST_CAMERAS: usize = 8;

/// What is measured once nodes run.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Node processes.
    pub nodes: usize,
    /// Cameras of each; `None`: one, and eight of all at least.
    pub node_cameras: Option<usize>,
    /// Whether cameras abstain about what they do not see.
    pub abstain: bool,
    /// Threads of the coordinator that serve connections.
    pub threads: usize,
    /// Of every camera's images, pixels.
    pub size: (u32, u32),
    /// Numbers of bodies.
    pub bodies: Vec<usize>,
    /// Samples of each.
    pub samples: usize,
    /// What they are asked for.
    pub responses: Vec<ResponseMode>,
    /// The encodings of numbers on the wire.
    pub precisions: Vec<Precision>,
}

/// A film and bodies in it.
pub struct Scene {
    film: Film,
    bodies: Bodies,
    /// Samples of each body.
    samples: usize,
}

impl Scene {
    /// The scene of a setting: the one before if it has the same cameras, for filming takes long.
    pub fn prepared<'a>(before: &'a mut Option<Scene>, setting: &Setting) -> Outcome<&'a Scene> {
        let &Setting { nodes, size, abstain, .. } = setting;
        let cameras = setting.node_cameras.map_or(nodes.max(LEAST_CAMERAS), |cameras| nodes * cameras);
        let plan = FilmPlan { cameras, nodes, size, frames: FRAMES, noise: 0.0, abstain };
        let most = setting.bodies.iter().copied().max().unwrap_or_default();
        let mut scene = match before.take() {
            Some(scene) if (FilmPlan { nodes: plan.nodes, ..scene.film.plan }) == plan => scene,
            _ => Scene { film: Film::make(plan)?, bodies: Bodies::default(), samples: setting.samples },
        };
        scene.film.spread_over(plan.nodes)?;
        if scene.bodies.len() < most {
            let Scene { film, samples, .. } = &scene;
            scene.bodies = Bodies::place(most, *samples, &film.views(), &film.person_world)?;
        }
        Ok(before.insert(scene))
    }
}

/// The rows of one cluster.
pub fn measured(scene: &Scene, setting: &Setting, sockets: SocketName, passes: u64) -> Outcome<Vec<Row>> {
    let Scene { film, bodies, .. } = scene;
    let certificates = (sockets == SocketName::Tls).then(|| Certificates::make(setting.nodes)).transpose()?;
    let told = LocalNodes { certs: certificates.as_ref().map(Certificates::folder), ..LocalNodes::default() };
    let cluster = LocalCluster::start(&film.file, sockets.sockets(), told)?;
    let dial = certificates.as_ref().map_or_else(|| Ok(Arc::default()), Certificates::dial)?;
    let place = (AnswerPlace::Nodes, dial);
    let mut connected = ClusterClient::to(film, cluster.nodes().to_vec(), bodies, place, setting.threads)?;
    let mut rows = Vec::new();
    let each = setting
        .responses
        .iter()
        .flat_map(|&response| setting.precisions.iter().map(move |&precision| (response, precision)));
    let each: Vec<(ResponseMode, Precision)> = each.collect();
    for &count in &setting.bodies {
        for &(response, precision) in &each {
            // What was learned of another kind of pass says nothing of this one.
            connected = connected.in_precision(precision);
            let form = match response {
                ResponseMode::Paper => PointForm::Registered,
                ResponseMode::Contacts => PointForm::Contacts,
            };
            let before = cpu_s(&cluster);
            let costs = connected.passes(&bodies.first(count), form, passes)?;
            let asked = (costs.passes_with_warm_up() * setting.nodes as u64) as f64;
            let node_cpu_ms =
                cpu_s(&cluster).zip(before).map(|(after, before)| (after - before) * 1e3 / asked);
            let empty = connected.fan_outs(&bodies.first(count), form, passes)?;
            let row = row(scene, (count, setting.threads), &costs, node_cpu_ms, &cluster);
            rows.push(Row {
                beside_empty_p50_ms: empty.0.p50().unwrap_or_default(),
                empty_p50_ms: empty.1.p50().unwrap_or_default(),
                response: response.name(),
                precision: precision.name(),
                sockets: sockets.name(),
                ..row
            });
        }
    }
    Ok(rows)
}

fn row(
    Scene { film, samples, .. }: &Scene,
    (bodies, threads): (usize, usize),
    costs: &PassCosts,
    node_cpu_ms: Option<f64>,
    cluster: &LocalCluster,
) -> Row {
    let memory_mb = memory_mb(cluster);
    let FilmPlan { cameras, nodes, size, .. } = film.plan;
    let (to_nodes, from_nodes) = costs.bytes_per_node_pass(nodes);
    let ms = |share| costs.pass_ms.at(share).unwrap_or_default();
    Row {
        nodes,
        cameras,
        bodies,
        samples: bodies * samples,
        width: size.0,
        height: size.1,
        response: "",
        precision: "",
        sockets: "",
        passes: costs.passes,
        p50_ms: ms(0.5),
        p99_ms: ms(0.99),
        max_ms: costs.pass_ms.max().unwrap_or_default(),
        bytes_per_node_pass: to_nodes + from_nodes,
        bytes_to_node_pass: to_nodes,
        bytes_from_node_pass: from_nodes,
        inside_share: costs.inside_share,
        node_cpu_ms,
        threads,
        coordinator_cpu_ms: costs.coordinator_cpu_ms + costs.hosted_cpu_ms,
        busiest_thread_ms: costs.busiest_thread_ms,
        empty_p50_ms: 0.0,
        beside_empty_p50_ms: 0.0,
        node_rss_mb: memory_mb.map(|(now_mb, _)| now_mb),
        node_peak_rss_mb: memory_mb.map(|(_, most_mb)| most_mb),
        trips_per_pass: costs.trips_per_pass(),
        stages: stages(costs),
    }
}

/// Processor time of all nodes so far.
fn cpu_s(cluster: &LocalCluster) -> Option<f64> {
    cluster.process_ids().map(process_cpu_s).sum()
}

/// The largest node's memory, now and at most.
fn memory_mb(cluster: &LocalCluster) -> Option<(f64, f64)> {
    let told = cluster.process_ids().filter_map(process_memory_mb);
    told.reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))
}
