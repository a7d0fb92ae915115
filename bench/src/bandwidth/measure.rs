//! One film over all layouts: bytes at real sockets, and the processor time beside.

use std::slice;

use hull::cull::WorldBox;
use proto::convert::{Precision, SilhouetteEncoding};
use setup::cli::{Failure, Outcome};

use std::sync::Arc;

use super::hosted::HostedNodes;
use super::layout::{Cost, Layout};
use crate::cluster::bodies::{Bodies, SAMPLES};
use crate::cluster::connection::{AnswerPlace, ClusterClient, FrameCosts, PassCosts, PointForm};
use crate::cluster::film::{Film, FilmPlan};
use crate::passes::Passes;
use crate::usage::thread_cpu_s;

/// Passes that the computation of gathering layouts is the mean of.
const LOCAL_PASSES: u64 = 4;
/// How silhouettes travel in each of [`Layout::GATHERED`].
const ENCODINGS: [SilhouetteEncoding; 4] = [
    SilhouetteEncoding::Grey,
    SilhouetteEncoding::Mask,
    SilhouetteEncoding::Runs,
    SilhouetteEncoding::RunsLz4,
];

/// What is asked, and how.
const REQUESTS: [(Layout, PointForm, Precision); 3] = [
    (Layout::RawPoints, PointForm::RawPoints, Precision::Exact),
    (Layout::RegisteredBodies, PointForm::Registered, Precision::Exact),
    (Layout::RegisteredBodies, PointForm::Registered, Precision::Quantised),
];
/// Points that all cameras together are asked about for one figure, at most: bytes differ little from pass to
/// pass, and a hundred thousand points go to 64 cameras.
const MOST_POINTS: usize = 4_000_000;

/// All layouts over one film.
#[derive(Clone, Debug)]
pub struct FilmMeasurement {
    /// The film; a node a camera.
    pub plan: FilmPlan,
    /// By number of bodies, ascending.
    pub at: Vec<AtBodies>,
}

/// All layouts for so many bodies.
#[derive(Clone, Debug)]
pub struct AtBodies {
    /// Number of bodies.
    pub bodies: usize,
    /// The share of their samples that was inside.
    pub inside_share: f64,
    /// Each layout's cost.
    pub costs: Vec<Cost>,
}

/// Films, serves and asks; `counts` of bodies ascending. Calls `step_done` after every step.
pub fn measured(
    plan: FilmPlan,
    counts: &[usize],
    passes: u64,
    step_done: &mut dyn FnMut(),
) -> Outcome<FilmMeasurement> {
    let film = Film::make(plan)?;
    let views = film.views();
    let bodies =
        Bodies::place(counts.last().copied().unwrap_or_default(), SAMPLES, &views, &film.person_world)?;
    step_done();
    let gathered = gathered(&film, &bodies.first(1), step_done)?;
    let hosted = HostedNodes::start(&film)?;
    let mut nodes =
        ClusterClient::to(&film, hosted.nodes().to_vec(), &bodies, (AnswerPlace::Nodes, Arc::default()), 0)?;
    let mut at = Vec::new();
    let mut here = Passes::new(film.settings(), 1);
    for &count in counts {
        let bodies = bodies.first(count);
        let mut costs = Vec::new();
        let mut local_ms = 0.0;
        for pass in 0..LOCAL_PASSES {
            let (points, began_s) = (bodies.at_pass(pass), thread_cpu_s());
            here.ask(&points, slice::from_ref(&views), &WorldBox::EVERYWHERE)?;
            local_ms += (thread_cpu_s() - began_s) * 1e3 / LOCAL_PASSES as f64;
        }
        costs.extend(gathered.iter().map(|(layout, frame)| gathered_cost(*layout, &nodes, frame, local_ms)));
        let mut inside_share = 0.0;
        for (layout, asked, precision) in REQUESTS {
            nodes = nodes.in_precision(precision);
            let took = nodes.passes(&bodies, asked, affordable(passes, &bodies, plan.cameras))?;
            costs.push(Cost {
                precision: precision.name(),
                ..asked_cost(layout, &nodes, &took, plan.cameras)
            });
            inside_share = took.inside_share;
        }
        at.push(AtBodies { bodies: count, inside_share, costs });
        step_done();
    }
    if at.is_empty() { Err(Failure::run("no bodies to ask about")) } else { Ok(FilmMeasurement { plan, at }) }
}

/// What each encoding of the silhouettes costs.
fn gathered(film: &Film, few: &Bodies, step_done: &mut dyn FnMut()) -> Outcome<Vec<(Layout, FrameCosts)>> {
    let hosted = HostedNodes::start(film)?;
    let mut connected =
        ClusterClient::to(film, hosted.nodes().to_vec(), few, (AnswerPlace::Coordinator, Arc::default()), 0)?;
    let mut gathered = Vec::new();
    for (layout, encoding) in Layout::GATHERED.into_iter().zip(ENCODINGS) {
        connected = connected.encoded_as(encoding);
        gathered.push((layout, connected.gather(few)?));
        step_done();
    }
    Ok(gathered)
}

/// How many times `step_done` is called.
pub fn steps(counts: &[usize]) -> u64 {
    (1 + Layout::GATHERED.len() + counts.len()) as u64
}

/// How many of the passes are worth their time; never less than two.
fn affordable(passes: u64, bodies: &Bodies, cameras: usize) -> u64 {
    let a_pass = (bodies.samples() * cameras).max(1);
    passes.min((MOST_POINTS / a_pass) as u64).max(2)
}

fn gathered_cost(layout: Layout, news: &ClusterClient, frame: &FrameCosts, local_ms: f64) -> Cost {
    Cost {
        layout,
        precision: "exact",
        bytes_per_frame: news.news_bytes_per_frame + frame.bytes,
        bytes_per_pass: 0.0,
        frame_ms: frame.coordinator_cpu_ms,
        pass_ms: local_ms,
        frame_trips: 1.0,
        pass_trips: 0.0,
    }
}

fn asked_cost(layout: Layout, nodes: &ClusterClient, took: &PassCosts, cameras: usize) -> Cost {
    let (to_node, from_node) = took.bytes_per_node_pass(cameras);
    Cost {
        layout,
        precision: "",
        bytes_per_frame: nodes.news_bytes_per_frame,
        bytes_per_pass: (to_node + from_node) * cameras as f64,
        frame_ms: 0.0,
        // Nodes compute at the same time, each on a machine of its own.
        pass_ms: took.coordinator_cpu_ms + took.hosted_cpu_ms / cameras as f64,
        frame_trips: 0.0,
        pass_trips: took.trips_per_pass(),
    }
}
