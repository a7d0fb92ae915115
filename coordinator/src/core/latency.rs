//! How old film is when steps see it: no older than it must be for frames to be known everywhere.
//!
//! Plain decisions: film time is an argument.

use std::collections::{BTreeMap, VecDeque};

/// What a minute of frames needed decides.
const WINDOW_S: f64 = 60.0;
/// So many of them may come too late.
const TOO_LATE_SHARE: f64 = 0.005;
/// For timers and threads that wake late, seconds.
const MARGIN_S: f64 = 0.002;
/// Film goes so much slower or faster while the latency changes.
const SLEW: f64 = 0.01;
/// So many frames decide the first latency.
const FIRST_FRAMES: usize = 8;
/// Frames that some nodes have reported and others not yet, at most.
const MAX_OPEN: usize = 64;
/// More frames than a minute of the fastest cameras has.
const MAX_KEPT: usize = 1 << 14;

/// A frame that a node reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Heard {
    /// The node's place in the roster.
    pub node: usize,
    /// The frame's number.
    pub frame: u64,
    /// Film time of its number, seconds.
    pub film_s: f64,
    /// How much later it was known here, seconds.
    pub late_s: f64,
    /// Steps go on without the node.
    pub is_left_out: bool,
}

/// The latency of a live run.
#[derive(Debug)]
pub(crate) struct FilmLatency {
    /// None is set: it is measured.
    is_auto: bool,
    now_s: f64,
    most_s: f64,
    /// What recent frames needed, if that is known.
    target_s: Option<f64>,
    /// Film time at which it last changed.
    slewed_s: f64,
    /// Who has reported each of the newest frames, and how late the latest was.
    open: BTreeMap<u64, (Vec<bool>, f64)>,
    /// Film time of recent frames, ascending, and what each needed to be known everywhere, seconds.
    needed: VecDeque<(f64, f64)>,
    /// How many nodes there are.
    nodes: usize,
    /// Nodes that were left out and whose frames come later than any latency makes good.
    too_late: Vec<bool>,
    /// How late each camera's frames were known here.
    cameras: Vec<VecDeque<(f64, f64)>>,
}

impl FilmLatency {
    /// A latency that is set, seconds, or measured: then of so many nodes and cameras, and never more than `most_s`.
    pub fn new(set_s: Option<f64>, (nodes, cameras): (usize, usize), most_s: f64) -> FilmLatency {
        FilmLatency {
            is_auto: set_s.is_none(),
            now_s: set_s.unwrap_or_default(),
            most_s,
            target_s: None,
            slewed_s: 0.0,
            open: BTreeMap::new(),
            needed: VecDeque::new(),
            nodes,
            too_late: vec![false; nodes],
            cameras: vec![VecDeque::new(); cameras],
        }
    }

    /// The latency now, seconds.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Whether it is known how late frames are.
    pub fn is_known(&self) -> bool {
        !self.is_auto || self.needed.len() >= FIRST_FRAMES
    }

    /// A node has reported a frame; `is_there` says which nodes film. A frame is known once these all have it, and given
    /// up for those that lack it long after.
    pub fn note(&mut self, heard: Heard, is_there: &[bool]) {
        if !self.is_auto {
            return;
        }
        let Heard { node, frame, film_s, late_s, is_left_out } = heard;
        let nodes = self.nodes;
        self.too_late[node] = is_left_out && late_s > self.most_s;
        if self.too_late[node] {
            return;
        }
        let (who, latest_s) = self.open.entry(frame).or_insert_with(|| (vec![false; nodes], f64::MIN));
        who[node] = true;
        *latest_s = latest_s.max(late_s);
        let waited_for =
            is_there.iter().zip(&self.too_late).map(|(is_there, too_late)| *is_there && !too_late);
        let all_have_it = who.iter().zip(waited_for).all(|(has, is_waited_for)| *has || !is_waited_for);
        let latest_s = *latest_s;
        if all_have_it {
            keep(&mut self.needed, film_s, latest_s);
            let usual_s = usual_most_s(&self.needed);
            self.target_s = usual_s.map(|usual_s| (usual_s + MARGIN_S).clamp(0.0, self.most_s));
            // Older ones never came everywhere.
            self.open = self.open.split_off(&(frame + 1));
        } else if self.open.len() > MAX_OPEN {
            self.open.pop_first();
        }
    }

    /// Goes towards what recent frames needed; `film_now_s` is film time by the clock.
    pub fn slew(&mut self, film_now_s: f64) {
        let passed_s = (film_now_s - self.slewed_s).max(0.0);
        self.slewed_s = film_now_s;
        if self.is_auto
            && let Some(target_s) = self.target_s
        {
            let most_s = SLEW * passed_s;
            self.now_s += (target_s - self.now_s).clamp(-most_s, most_s);
        }
    }

    /// Takes what the first frames needed at once: no step was made yet.
    pub fn begin(&mut self, film_now_s: f64) {
        self.slewed_s = film_now_s;
        if self.is_auto {
            self.now_s = self.target_s.unwrap_or(self.now_s);
        }
    }

    /// Notes how late a camera's frame was known here.
    pub fn note_camera(&mut self, camera: usize, film_s: f64, late_s: f64) {
        if let Some(frames) = self.cameras.get_mut(camera).filter(|_| self.is_auto) {
            keep(frames, film_s, late_s);
        }
    }

    /// How late each camera's frames usually are at most, seconds; nothing where that is not measured.
    pub fn late_s(&self) -> Vec<Option<f64>> {
        self.cameras.iter().map(usual_most_s).collect()
    }
}

fn keep(frames: &mut VecDeque<(f64, f64)>, film_s: f64, late_s: f64) {
    frames.push_back((film_s, late_s));
    while frames.len() > MAX_KEPT || frames.front().is_some_and(|(first_s, _)| film_s - first_s > WINDOW_S) {
        frames.pop_front();
    }
}

/// What all but a few needed, seconds; one may always be late.
fn usual_most_s(frames: &VecDeque<(f64, f64)>) -> Option<f64> {
    let mut late_s: Vec<f64> = frames.iter().map(|&(_, late_s)| late_s).collect();
    let too_late = ((late_s.len() as f64 * TOO_LATE_SHARE) as usize).max(1);
    let place = late_s.len().checked_sub(1 + too_late)?;
    Some(*late_s.select_nth_unstable_by(place, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FPS: f64 = 30.0;

    /// Film of two nodes from one frame on; the second's is so late.
    fn film(latency: &mut FilmLatency, frames: std::ops::Range<u64>, second_s: impl Fn(u64) -> f64) {
        for frame in frames {
            let film_s = frame as f64 / FPS;
            latency.note(Heard { node: 0, frame, film_s, late_s: 0.01, is_left_out: false }, &[true; 2]);
            latency.note(
                Heard { node: 1, frame, film_s, late_s: second_s(frame), is_left_out: false },
                &[true; 2],
            );
            latency.slew(film_s);
        }
    }

    fn measured() -> FilmLatency {
        let mut latency = FilmLatency::new(None, (2, 2), 0.4);
        film(&mut latency, 0..8, |_| 0.02);
        assert!(latency.is_known());
        latency.begin(8.0 / FPS);
        latency
    }

    fn is_near(found_s: f64, expected_s: f64) -> bool {
        (found_s - expected_s).abs() < 1e-9
    }

    #[test]
    fn the_first_frames_decide_where_it_begins() {
        assert!(!FilmLatency::new(None, (1, 1), 0.4).is_known());
        assert!(is_near(measured().now_s(), 0.022), "the later node's, and a margin");
        let set = FilmLatency::new(Some(0.1), (1, 1), 0.4);
        assert!(set.is_known() && is_near(set.now_s(), 0.1));
    }

    #[test]
    fn a_node_that_becomes_late_is_followed_by_a_hundredth_of_film_time_and_back() {
        let mut latency = measured();
        film(&mut latency, 8..68, |_| 0.06);
        assert!((0.036..0.043).contains(&latency.now_s()), "{} s after 2 s", latency.now_s());
        film(&mut latency, 68..158, |_| 0.06);
        assert!(is_near(latency.now_s(), 0.062), "{} s after 5 s", latency.now_s());
        film(&mut latency, 158..158 + 66 * 30, |_| 0.02);
        assert!(is_near(latency.now_s(), 0.022), "{} s a minute later", latency.now_s());
    }

    #[test]
    fn each_camera_is_known_by_what_nearly_all_its_frames_needed() {
        let mut latency = measured();
        for frame in 0..100 {
            let film_s = frame as f64 / FPS;
            latency.note_camera(0, film_s, 0.01);
            latency.note_camera(1, film_s, if frame == 50 { 0.9 } else { 0.06 });
        }
        latency.note_camera(7, 0.0, 0.1);
        assert_eq!(latency.late_s(), [Some(0.01), Some(0.06)]);
    }

    #[test]
    fn one_frame_in_two_hundred_may_be_late() {
        let mut latency = measured();
        film(&mut latency, 8..1800, |frame| if frame % 250 == 0 { 0.3 } else { 0.02 });
        assert!(is_near(latency.now_s(), 0.022), "{}", latency.now_s());
        film(&mut latency, 1800..2400, |frame| if frame % 100 == 0 { 0.3 } else { 0.02 });
        film(&mut latency, 2400..4200, |frame| if frame % 100 == 0 { 0.3 } else { 0.02 });
        assert!(latency.now_s() > 0.15, "{}", latency.now_s());
    }

    #[test]
    fn a_node_that_is_not_there_holds_nothing_up() {
        let mut latency = FilmLatency::new(None, (2, 2), 0.4);
        for frame in 0..20 {
            latency.note(
                Heard { node: 0, frame, film_s: frame as f64 / FPS, late_s: 0.01, is_left_out: false },
                &[true, false],
            );
        }
        assert!(latency.is_known());
        latency.begin(0.7);
        assert!(is_near(latency.now_s(), 0.012));
    }

    #[test]
    fn it_is_bounded_by_what_nodes_keep() {
        let mut latency = FilmLatency::new(None, (1, 1), 0.4);
        for frame in 0..1000 {
            latency.note(
                Heard { node: 0, frame, film_s: frame as f64 / FPS, late_s: 3.0, is_left_out: false },
                &[true],
            );
        }
        latency.begin(40.0);
        assert!(is_near(latency.now_s(), 0.4));
        for frame in 0..1000 {
            latency.note(Heard { node: 0, frame, film_s: 50.0, late_s: 3.0, is_left_out: false }, &[false]);
        }
        assert!(latency.open.len() <= MAX_OPEN);
    }

    #[test]
    fn a_node_that_was_left_out_counts_unless_no_latency_makes_its_film_good() {
        for (late_s, expected_s) in [(0.2, 0.202), (0.9, 0.012)] {
            let mut latency = FilmLatency::new(None, (2, 0), 0.4);
            for frame in 0..60 {
                let film_s = frame as f64 / FPS;
                let heard =
                    |node: usize, late_s: f64| Heard { node, frame, film_s, late_s, is_left_out: node == 1 };
                latency.note(heard(0, 0.01), &[true; 2]);
                latency.note(heard(1, late_s), &[true; 2]);
            }
            latency.begin(0.0);
            assert!((latency.now_s() - expected_s).abs() < 1e-9, "{late_s}: {}", latency.now_s());
        }
    }
}
