//! Cameras that are filmed in this very process: one node that is always there.

use film_time::{BackgroundFilm, Cut, FilmEvent, FilmState, FrameReport, Pace, monotonic_s};
use futures::future::BoxFuture;
use hull::ViewSet;
use hull::pass::{Pass, Round};
use hull::question::Answer;
use hull::view_set::Scratch;
use tokio::sync::watch;
use tokio::time::Instant;

use super::{BoxError, Silhouettes, TransportError};
use crate::roster::{Arrival, Roster, RosterNode};

/// The place of the one node in the roster.
const NODE: usize = 0;

/// The frames of cameras that are filmed in this very process.
pub trait LocalFrames: Send {
    /// Begins a run.
    fn start(&self, pace: Pace) -> Result<(), BoxError>;
    /// Lets a lock-step run go on up to a frame.
    fn credit(&self, up_to_frame: u64);
    /// Keeps a frame, however old it gets, until another is in use.
    fn use_frame(&self, frame: u64) {
        let _ = frame;
    }
    /// Tells where film is cut into frames, in periods from their numbers.
    fn cut_at(&self, phase: f64) {
        let _ = phase;
    }
    /// Wakes whenever a frame, an end or a failure has come.
    fn watch(&self) -> watch::Receiver<u64>;
    /// The frames there are, ascending.
    fn frames(&self) -> Vec<u64>;
    /// The report of a frame.
    fn report(&self, frame: u64) -> Option<FrameReport>;
    /// The state of the film.
    fn film(&self) -> FilmState;
    /// Calls `use_views` with the views of a frame; false if the frame is gone.
    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool;
    /// The silhouettes of a frame.
    fn silhouettes(&self, frame: u64) -> Option<Silhouettes>;
    /// Has every camera learn its background again; what is returned ends when all have, or one cannot.
    fn take_background(&self, film: BackgroundFilm) -> BoxFuture<'static, Result<(), BoxError>> {
        let _ = film;
        Box::pin(futures::future::ready(Err("these cameras learn no background".into())))
    }
    /// Has the cameras whose backgrounds have that id use the ones before again.
    fn restore_background(&self, id: u64) {
        let _ = id;
    }
}

/// Buffers for probing in this process, kept from pass to pass.
#[derive(Default)]
pub(super) struct LocalProbes {
    scratch: Scratch,
    answer: Answer,
}

impl LocalProbes {
    /// Answers a pass; `took` receives each round and its milliseconds.
    pub fn run(&mut self, pass: &mut Pass, views: &ViewSet, took: &mut dyn FnMut(Round, f64)) {
        while let Some(question) = pass.question() {
            let (round, began) = (pass.round(), Instant::now());
            views.answer(question, &mut self.scratch, &mut self.answer);
            pass.answer(0, &self.answer).expect("the one group answers every question once");
            took(round, began.elapsed().as_secs_f64() * 1e3);
        }
    }
}

/// The cameras, and what of their news has been seen.
pub(super) struct InProcess {
    pub frames: Box<dyn LocalFrames>,
    news: watch::Receiver<u64>,
    probes: LocalProbes,
    cut: Cut,
}

impl InProcess {
    pub fn new(frames: Box<dyn LocalFrames>) -> (InProcess, Roster) {
        let mut roster = Roster::new(vec![RosterNode::new("of this process".into(), vec![])]);
        roster.up(NODE);
        let news = frames.watch();
        (InProcess { frames, news, probes: LocalProbes::default(), cut: Cut::default() }, roster)
    }

    /// Hands the roster what has come.
    pub fn drain(&mut self, roster: &mut Roster) {
        self.news.mark_unchanged();
        // The state is read before the frames: a film that has ended has all its frames.
        let state = self.frames.film();
        let numbers = self.frames.frames();
        let known = roster.newest();
        if known.is_some_and(|known| numbers.last().is_none_or(|last| *last < known)) {
            roster.begin_run();
            self.cut = Cut::default();
        }
        let known = roster.newest();
        let new = numbers.into_iter().filter(|&number| known.is_none_or(|known| number > known));
        let heard_s = monotonic_s();
        for report in new.filter_map(|number| self.frames.report(number)) {
            roster.heard(Arrival { node: NODE, frame: report.frame, heard_s });
            self.cut.heard(&report);
            roster.film_event(NODE, FilmEvent::Frame(report), heard_s);
        }
        if let Some(phase) = self.cut.phase() {
            self.frames.cut_at(phase);
        }
        match state {
            FilmState::Running => {}
            FilmState::Ended => roster.film_event(NODE, FilmEvent::Ended, heard_s),
            FilmState::Failed(why) => roster.film_event(NODE, FilmEvent::Failed(why), heard_s),
        }
    }

    /// Waits for news and hands it to the roster.
    pub async fn next(&mut self, roster: &mut Roster) {
        if self.news.changed().await.is_err() {
            // Nothing more will come.
            std::future::pending::<()>().await;
        }
        self.drain(roster);
    }

    pub fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), TransportError> {
        let InProcess { frames, probes, .. } = self;
        let found = frames.with_views(frame, &mut |views| probes.run(pass, views, took));
        if found { Ok(()) } else { Err(TransportError::Gone { frame }) }
    }
}
