//! Which nodes steps go on without: as if their cameras were not in the rig, until they are back.

use film_time::FilmState;

use super::{Connection, Roster, RosterNode, Shortage};

/// A node whose film is later than the others' by more frames than this is left out.
const LATE_FRAMES: u64 = 1;

/// Which nodes a step may leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaveOut {
    /// Nodes that are not there, do not answer, or are late: live.
    Late,
    /// Nodes that are not there: lock-step waits for the others.
    Missing,
}

impl RosterNode {
    /// Whether it is there for a step that may see frames up to `lead`, the newest of all nodes. A node that was left out is
    /// back once it has the frame that the others have in `common`: it may lack what came meanwhile. Frames after `wanted`
    /// tell nothing: no other node has them yet.
    fn is_there(
        &self,
        wanted: u64,
        (lead, common): (Option<u64>, Option<u64>),
        whom: LeaveOut,
        now_s: f64,
    ) -> bool {
        if whom == LeaveOut::Missing {
            return self.is_up();
        }
        let in_time = match (lead, self.newest_until(wanted)) {
            _ if self.is_left_out() => common.is_none_or(|common| self.report(common).is_some()),
            (Some(lead), Some(newest)) => newest + LATE_FRAMES >= lead,
            (Some(_), None) => false,
            (None, _) => true,
        };
        let has_ended = self.film.state == FilmState::Ended;
        let behaves = !self.conduct.is_excluded(now_s) && !matches!(self.film.state, FilmState::Failed(_));
        self.is_up() && !self.is_silent() && behaves && (in_time || has_ended)
    }

    /// How many cameras it films with.
    fn films(&self) -> usize {
        match self.newest() {
            Some(newest) if !newest.cameras.is_empty() => newest.cameras.len(),
            _ => self.cameras.len(),
        }
    }
}

impl Roster {
    /// The nodes that steps go on with.
    pub(super) fn present(&self) -> impl Iterator<Item = &RosterNode> {
        self.nodes.iter().filter(|node| !node.is_left_out())
    }

    /// Whether steps go on without a node.
    pub fn leaves_out_any(&self) -> bool {
        self.nodes.iter().any(RosterNode::is_left_out)
    }

    /// Nodes did not answer a question in time, by [`film_time::monotonic_s`]: they are left out until they are heard of. One alone
    /// that is late again and again is excluded where the run has enough cameras without it. Several at once are no fault of
    /// theirs, but of the network.
    pub fn record_late(&mut self, late: &[usize], now_s: f64, why: &str) {
        if let &[node] = late
            && self.nodes[node].is_up()
            && self.has_enough_cameras_without(node, now_s)
        {
            self.nodes[node].conduct.late(now_s, why.to_owned());
        }
        late.iter().for_each(|&node| self.nodes[node].silent_since_s = Some(now_s));
    }

    /// Whether live steps have enough cameras without a node: of nodes that are there, answer and behave.
    pub fn has_enough_cameras_without(&self, node: usize, now_s: f64) -> bool {
        let Some(least) = self.least_cameras else { return false };
        let answers = |node: &RosterNode| {
            node.is_there && node.is_up() && !node.is_silent() && !node.conduct.is_excluded(now_s)
        };
        let others = self.nodes.iter().enumerate().filter(|&(other, _)| other != node).map(|(_, node)| node);
        others.filter(|node| answers(node)).map(RosterNode::films).sum::<usize>() >= least.max(1)
    }

    /// Decides whom a step that wants a frame goes on without, by [`film_time::monotonic_s`]. No node is left out where fewer than
    /// `least` cameras would remain. Returns what has changed: nodes, and whether each is back.
    pub fn leave_out(&mut self, wanted: u64, whom: LeaveOut, least: usize, now_s: f64) -> Vec<(usize, bool)> {
        let behaves =
            |node: &&RosterNode| node.is_up() && !node.is_silent() && !node.conduct.is_excluded(now_s);
        let newest = |node: &RosterNode| node.newest_until(wanted);
        let lead = self.nodes.iter().filter(behaves).filter_map(newest).max();
        let common = self.newest_common(wanted);
        let is_there = |node: &RosterNode| node.is_there(wanted, (lead, common), whom, now_s);
        let there: Vec<bool> = self.nodes.iter().map(is_there).collect();
        let pairs = || self.nodes.iter().zip(&there);
        let left: usize = pairs().filter(|(_, there)| **there).map(|(node, _)| node.films()).sum();
        let is_enough = left >= least && there.contains(&true);
        self.least_cameras = (whom == LeaveOut::Late).then_some(least);
        self.cameras_there = left;
        let mut changed = Vec::new();
        for (index, (node, there)) in self.nodes.iter_mut().zip(&there).enumerate() {
            node.is_there = *there;
            let is_left_out = is_enough && !there;
            if node.is_left_out() != is_left_out {
                // Film that is in time in one frame and late in the next would change the hull with each.
                let answers = node.is_up() && !node.is_silent() && node.film.state == FilmState::Running;
                if is_left_out && answers && whom == LeaveOut::Late {
                    node.conduct.late(now_s, "its film was late".to_owned());
                }
                node.left_out_s = is_left_out.then_some(now_s);
                changed.push((index, !is_left_out));
            }
        }
        changed
    }

    /// How many cameras were there as of the last [`Roster::leave_out`], if these are too few for live steps.
    pub(super) fn shortage(&self) -> Option<Shortage> {
        let all = self.nodes.iter().map(|node| node.cameras.len()).sum();
        let (found, needed) = (self.cameras_there, self.least_cameras?.min(all));
        (found < needed).then_some(Shortage { found, all, needed })
    }

    /// Whether a run may begin without the nodes that are missing: these are away and not wrong, fewer than half of all are
    /// held by another coordinator, and so many cameras are there.
    pub fn may_begin_without_missing(&self, least: usize) -> bool {
        let there: usize = self.nodes.iter().filter(|node| node.is_up()).map(|node| node.cameras.len()).sum();
        there >= least.max(1)
            && !self.nodes.iter().any(|node| matches!(node.connection, Connection::Wrong(_)))
            && self.displaced().is_none()
    }

    /// The name of a node and its cameras.
    pub fn node_name(&self, node: usize) -> &str {
        &self.nodes[node].name
    }

    /// The name of a node, and why it is left out.
    pub fn why_left_out(&self, node: usize, now_s: f64) -> String {
        let node = &self.nodes[node];
        if let Some(why) = node.conduct.exclusion(now_s) {
            return format!("node {}: {why}", node.name);
        }
        match node.missing() {
            Some(missing) => missing.to_string(),
            None if node.newest().is_none() => format!("node {}: no frame has come from it", node.name),
            None if node.is_silent() => format!("node {}: no answer in time", node.name),
            None => format!("node {}: its film is late", node.name),
        }
    }
}
