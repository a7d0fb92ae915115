//! Who is there: the nodes of a run, what each has reported of its film, and what follows from it: which frame
//! all of them have, whether film has ended, who is missing.
//!
//! Plain decisions: events go in by [`Roster::up`], [`Roster::down`] and [`Roster::film_event`], time is an argument.
//! The cameras of this process are one node that is always there.

mod available;
mod conduct;
mod present;
mod wait;

use std::collections::VecDeque;

use film_time::{FilmEvent, FilmState, FrameReport};
use proto::convert::RefusalReason;
use thiserror::Error;

use conduct::Conduct;

pub use available::{HullUnavailable, Shortage, StepFilm};
pub use present::LeaveOut;
pub use wait::{FrameWait, WaitError};
pub(crate) use wait::{LOCK_STEP_TIMEOUT, joined};

/// Every node keeps at least so many frames after the one that is asked about.
const HELD_FRAMES: u64 = 4;
/// Frames remembered of a node: as many as the largest ring keeps.
const REMEMBERED_FRAMES: usize = 64;
/// Film of a node that was left out counts for the latency after so long, seconds.
const LATE_FOR_S: f64 = 1.0;
/// Arrivals that wait for the loop: it looks before every step.
const MAX_ARRIVALS: usize = 4096;

/// A node that is not there, and why, if it is known.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Missing {
    /// It was never reached, and no attempt has failed yet.
    #[error("node {node} does not answer")]
    Silent {
        /// The node and its cameras.
        node: String,
    },
    /// It was lost, or cannot be reached.
    #[error("node {node}: {problem}")]
    Down {
        /// The node and its cameras.
        node: String,
        /// Why it is not there.
        problem: String,
    },
}

/// One node of a run.
#[derive(Clone, Debug)]
pub struct RosterNode {
    name: String,
    /// Places in the rig.
    cameras: Vec<u16>,
    connection: Connection,
    /// How often it was connected.
    connections: u64,
    film: NodeFilm,
    /// When it did not answer in time, seconds, if it has not been heard of since.
    silent_since_s: Option<f64>,
    /// Since when steps go on without it, seconds, if they do.
    left_out_s: Option<f64>,
    /// Steps could use it, as of the last [`Roster::leave_out`].
    is_there: bool,
    conduct: Conduct,
    /// How far film time may be off there, seconds; nothing of cameras of this process.
    clock_bound_s: f64,
}

/// Whether a node is there, or why not.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Connection {
    /// It was never reached, and no attempt has failed yet.
    Silent,
    Up,
    /// It was lost, or cannot be reached.
    Down(String),
    /// It answers, and is not what is expected.
    Wrong(String),
    /// Another coordinator leads it.
    Held(String),
}

/// What a node has reported of its film.
#[derive(Clone, Debug)]
struct NodeFilm {
    state: FilmState,
    /// Whether it films without end.
    is_endless: bool,
    /// Of recent frames, ascending.
    reports: VecDeque<FrameReport>,
}

impl RosterNode {
    /// A node by the name that messages use, and its cameras' places in the rig. It is not there yet, and its film may end.
    pub fn new(name: String, cameras: Vec<u16>) -> RosterNode {
        RosterNode {
            name,
            cameras,
            connection: Connection::Silent,
            connections: 0,
            film: NodeFilm { state: FilmState::Running, is_endless: false, reports: VecDeque::new() },
            silent_since_s: None,
            left_out_s: None,
            is_there: false,
            conduct: Conduct::default(),
            clock_bound_s: 0.0,
        }
    }

    /// The same node, which may film without end: that its film has ended is then a fault.
    pub fn endless(mut self, is_endless: bool) -> RosterNode {
        self.film.is_endless = is_endless;
        self
    }

    /// The places of its cameras in the rig.
    pub fn cameras(&self) -> &[u16] {
        &self.cameras
    }

    /// How often it was connected.
    pub fn connections(&self) -> u64 {
        self.connections
    }

    fn is_up(&self) -> bool {
        self.connection == Connection::Up
    }

    fn is_held(&self) -> bool {
        matches!(self.connection, Connection::Held(_))
    }

    /// Whether it did not answer in time, and has not been heard of since.
    fn is_silent(&self) -> bool {
        self.silent_since_s.is_some()
    }

    /// Whether steps go on without it.
    pub fn is_left_out(&self) -> bool {
        self.left_out_s.is_some()
    }

    /// The report of its newest frame.
    pub fn newest(&self) -> Option<&FrameReport> {
        self.film.reports.back()
    }

    /// How far film time may be off there, seconds.
    pub fn clock_bound_s(&self) -> f64 {
        self.clock_bound_s
    }

    /// Why it is not there, if it is not.
    pub fn missing(&self) -> Option<Missing> {
        let node = self.name.clone();
        match &self.connection {
            Connection::Up => None,
            Connection::Silent => Some(Missing::Silent { node }),
            Connection::Down(problem) | Connection::Wrong(problem) | Connection::Held(problem) => {
                Some(Missing::Down { node, problem: problem.clone() })
            }
        }
    }

    /// What it reported of a frame that is remembered.
    pub fn report(&self, frame: u64) -> Option<&FrameReport> {
        self.film.reports.iter().find(|report| report.frame == frame)
    }

    /// Why its film has failed, if it has.
    pub fn film_failure(&self) -> Option<&str> {
        match &self.film.state {
            FilmState::Failed(why) => Some(why),
            FilmState::Running | FilmState::Ended => None,
        }
    }

    fn newest_frame(&self) -> Option<u64> {
        self.newest().map(|report| report.frame)
    }

    /// The newest frame that it has up to one.
    fn newest_until(&self, wanted: u64) -> Option<u64> {
        self.film.reports.iter().rev().map(|report| report.frame).find(|&frame| frame <= wanted)
    }

    fn forget_film(&mut self) {
        self.film.reports.clear();
        self.film.state = FilmState::Running;
    }

    fn add(&mut self, report: FrameReport) {
        if self.newest_frame().is_some_and(|newest| newest >= report.frame) {
            // Its film started over: what it reported before is gone.
            self.forget_film();
        }
        // No frame follows an end: this is another film.
        self.film.state = FilmState::Running;
        self.film.reports.push_back(report);
        if self.film.reports.len() > REMEMBERED_FRAMES {
            self.film.reports.pop_front();
        }
    }
}

/// All nodes of a run, in the order of the cluster file.
#[derive(Clone, Debug)]
pub struct Roster {
    nodes: Vec<RosterNode>,
    /// Reports that have not been read yet.
    arrivals: VecDeque<Arrival>,
    /// `min_cameras` of the last [`Roster::leave_out`] of a live run; `None` in lock-step.
    least_cameras: Option<usize>,
    /// How many cameras were there, as of the last [`Roster::leave_out`].
    cameras_there: usize,
    /// A run has begun.
    has_begun: bool,
}

/// When a node's report of a frame came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrival {
    /// The node's place.
    pub node: usize,
    /// The frame.
    pub frame: u64,
    /// By this process's monotonic clock, seconds.
    pub heard_s: f64,
}

impl Roster {
    /// Nodes that are not there yet.
    pub fn new(nodes: Vec<RosterNode>) -> Roster {
        Roster { nodes, arrivals: VecDeque::new(), least_cameras: None, cameras_there: 0, has_begun: false }
    }

    /// The nodes.
    pub fn nodes(&self) -> &[RosterNode] {
        &self.nodes
    }

    /// A node is connected; what it reported before no longer holds.
    pub fn up(&mut self, node: usize) {
        let node = &mut self.nodes[node];
        (node.connection, node.silent_since_s) = (Connection::Up, None);
        node.connections += 1;
        node.forget_film();
    }

    /// A node is not there.
    pub fn down(&mut self, node: usize, problem: String) {
        self.nodes[node].connection = Connection::Down(problem);
    }

    /// A node that is down is there, and is not what is expected.
    pub fn wrong(&mut self, node: usize, problem: String) {
        self.nodes[node].connection = Connection::Wrong(problem);
    }

    /// A node refused, or answered wrongly: it is left out until it is heard of, and for longer if that happens often.
    pub fn fault(&mut self, node: usize, now_s: f64, why: String) {
        let node = &mut self.nodes[node];
        node.silent_since_s = Some(now_s);
        node.conduct.fault(now_s, why);
    }

    /// Whether steps ask a node, and it has answered so far.
    pub fn answers(&self, node: usize, now_s: f64) -> bool {
        let node = &self.nodes[node];
        node.is_up() && !node.is_silent() && !node.is_left_out() && !node.conduct.is_excluded(now_s)
    }

    /// Whether a node may refuse a question about a frame for this reason: it no longer has an old frame, and not yet one that
    /// it has not reported. A late question is no fault of the node.
    pub fn excuses(&self, node: usize, reason: RefusalReason, frame: u64) -> bool {
        match reason {
            // One node alone may say anything of its film.
            RefusalReason::Gone => self.newest_of_two().is_some_and(|newest| newest > frame + HELD_FRAMES),
            RefusalReason::NotYet => self.nodes[node].report(frame).is_none(),
            _ => false,
        }
    }

    /// A node's clock was read: film time may be off by so much there, seconds.
    pub fn clock(&mut self, node: usize, bound_s: f64) {
        self.nodes[node].clock_bound_s = bound_s;
    }

    /// A node is led by another coordinator.
    pub fn held(&mut self, node: usize, by: String) {
        self.nodes[node].connection = Connection::Held(by);
    }

    /// The first node that is led by another, and by whom.
    pub fn held_node(&self) -> Option<Missing> {
        self.nodes.iter().find(|node| node.is_held())?.missing()
    }

    /// The same if another leads most of the nodes, or half of them before a run has begun; one alone of several may say so
    /// wrongly.
    pub fn displaced(&self) -> Option<Missing> {
        let (all, held) = (self.nodes.len(), self.nodes.iter().filter(|node| node.is_held()).count());
        let are_most = if self.has_begun { 2 * held > all } else { 2 * held >= all && held >= all.min(2) };
        if are_most { self.held_node() } else { None }
    }

    /// A node reported of its film, heard at a time by [`film_time::monotonic_s`]. What was heard before it failed to answer may be
    /// noted later: it does not tell that the node answers again.
    pub fn film_event(&mut self, node: usize, event: FilmEvent, heard_s: f64) {
        let node = &mut self.nodes[node];
        node.silent_since_s = node.silent_since_s.filter(|&since_s| heard_s <= since_s);
        match event {
            FilmEvent::Frame(report) => node.add(report),
            FilmEvent::Ended if node.film.is_endless => {
                let why = format!("node {} reports the end of live film", node.name);
                node.film.state = FilmState::Failed(why);
            }
            FilmEvent::Ended => node.film.state = FilmState::Ended,
            FilmEvent::Failed(why) => node.film.state = FilmState::Failed(why),
        }
    }

    /// A report of a frame came.
    pub(crate) fn heard(&mut self, arrival: Arrival) {
        self.arrivals.push_back(arrival);
        if self.arrivals.len() > MAX_ARRIVALS {
            self.arrivals.pop_front();
        }
    }

    /// What came since the last time, and which nodes' frames are waited for. A node whose film has become late is waited for
    /// again after a while: it is never back otherwise.
    pub(crate) fn take_arrivals(&mut self, now_s: f64) -> (VecDeque<Arrival>, Vec<bool>) {
        let newest = self.newest_of_two().unwrap_or_default();
        let films = |node: &RosterNode| {
            let is_waited_for = node.left_out_s.is_none_or(|left_out_s| {
                let is_near = node.newest_frame().is_some_and(|own| own + REMEMBERED_FRAMES as u64 > newest);
                now_s > left_out_s + LATE_FOR_S && is_near && !node.conduct.is_excluded(now_s)
            });
            node.is_up() && !node.is_silent() && is_waited_for && node.film.state == FilmState::Running
        };
        (std::mem::take(&mut self.arrivals), self.nodes.iter().map(films).collect())
    }

    /// A run begins: frames of the one before are forgotten.
    pub fn begin_run(&mut self) {
        self.has_begun = true;
        self.nodes.iter_mut().for_each(RosterNode::forget_film);
    }

    /// The nodes that are not there.
    pub fn missing(&self) -> impl Iterator<Item = Missing> {
        self.nodes.iter().filter_map(RosterNode::missing)
    }

    /// The newest frame that any node has.
    pub fn newest(&self) -> Option<u64> {
        self.nodes.iter().filter_map(RosterNode::newest_frame).max()
    }

    /// The newest frame that two nodes have reported or passed; of a single node its own. One node alone cannot move it.
    pub fn newest_of_two(&self) -> Option<u64> {
        let mut newest: Vec<u64> = self.nodes.iter().filter_map(RosterNode::newest_frame).collect();
        newest.sort_unstable_by(|a, b| b.cmp(a));
        newest.get(1.min(self.nodes.len() - 1)).copied()
    }

    /// The newest frame not newer than `wanted` that all nodes have that are not left out.
    pub fn newest_common(&self, wanted: u64) -> Option<u64> {
        let first = self.present().next()?;
        let frames = first.film.reports.iter().rev().map(|report| report.frame);
        let all_have = |frame: &u64| self.present().all(|node| node.report(*frame).is_some());
        frames.filter(|&frame| frame <= wanted).find(all_have)
    }

    /// What every node that is not left out reported of a frame; `None` while one has not, or no longer remembers.
    pub fn reports(&self, frame: u64) -> Option<Vec<&FrameReport>> {
        self.present().map(|node| node.report(frame)).collect()
    }

    /// The last frame of film: that of the node whose film ended first, of those that are not left out. `None` while all
    /// run.
    pub fn last_frame(&self) -> Option<LastFrame> {
        let ended = self.present().filter(|node| node.film.state == FilmState::Ended);
        ended.map(|node| node.newest_frame().map_or(LastFrame::None, LastFrame::Frame)).min()
    }

    /// The state of film for a step that wants a frame: failed, or ended before that frame, or running. A node
    /// that is done early does not cut off what others have yet to report: in lock-step a fast node ends several
    /// frames ahead of the one in use.
    pub fn film(&self, wanted: u64) -> FilmState {
        let failed = self.present().find(|node| matches!(node.film.state, FilmState::Failed(_)));
        if let Some(node) = failed {
            return node.film.state.clone();
        }
        match self.last_frame() {
            Some(last) if last < LastFrame::Frame(wanted) => FilmState::Ended,
            _ => FilmState::Running,
        }
    }

    /// Where in the film cameras may go on to for a step that wants a frame, `ahead` frames further. Film that
    /// has ended is held at its last frame: nodes whose film is longer must not drop it from their rings.
    pub fn credit(&self, wanted: u64, ahead: u64) -> u64 {
        let last = match self.last_frame() {
            Some(LastFrame::Frame(last)) => last,
            Some(LastFrame::None) => 0,
            None => u64::MAX,
        };
        wanted.min(last).saturating_add(ahead)
    }
}

/// The last frame of film that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LastFrame {
    /// It had none.
    None,
    /// This one.
    Frame(u64),
}

#[cfg(test)]
pub(crate) mod tests;
