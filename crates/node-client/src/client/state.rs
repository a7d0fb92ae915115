//! What a client knows of its node, and over which connection it asks.

use std::collections::VecDeque;
use std::time::Duration;

use film_time::{ClockLine, FilmEvent};
use proto::convert::{ExpectedAnswer, StreamKnows};
use proto::v1;
use tokio::sync::mpsc;
use tokio::time::Instant;

use crate::clock_estimate::ClockEstimate;
use crate::reply_limits::NodeCalls;

/// What is still on its way over an old connection comes within this.
pub(super) const LAST_WORDS: Duration = Duration::from_secs(1);

#[derive(Default)]
pub(super) struct State {
    pub connection: Option<Connection>,
    /// What the probe stream has received.
    pub knows: StreamKnows,
    /// Questions without an answer; the oldest is forgotten first.
    pub open: VecDeque<(u64, ExpectedAnswer)>,
    /// All that the node may do so far; each message says all of it.
    pub credit: v1::FrameCredit,
    pub clock: ClockEstimate,
    /// What it said last: our clock by the node's.
    pub clock_line: Option<ClockLine>,
    /// How often the connection was renewed since it was made, and when last.
    pub renewals: u64,
    pub renewed: Option<Instant>,
    /// The last event of film that was reported of this run.
    pub last_of_film: Option<(u64, FilmEvent)>,
}

impl State {
    /// Starts over with another connection; what the node may do stays.
    pub fn connect(&mut self, connection: Connection) {
        let (credit, clock) = (self.credit, std::mem::take(&mut self.clock));
        *self = State { connection: Some(connection), credit, clock, ..State::default() };
        self.send_credit();
    }

    /// Goes on over another connection to the same node. Questions that are open are answered over the old one.
    pub fn renew(&mut self, connection: Connection) {
        self.connection = Some(connection);
        self.knows = StreamKnows::default();
        self.renewals += 1;
        self.renewed = Some(Instant::now());
        self.send_credit();
    }

    /// Whether an event of a run's film is news: where two connections overlap, both report it.
    pub fn is_news(&mut self, run: u64, event: &FilmEvent) -> bool {
        let overlaps = self.renewed.is_some_and(|renewed| renewed.elapsed() < 3 * LAST_WORDS);
        let is_known = match (event, &self.last_of_film) {
            _ if !overlaps => false,
            (_, Some((of, _))) if *of != run => false,
            (FilmEvent::Frame(new), Some((_, FilmEvent::Frame(last)))) => new.frame <= last.frame,
            (new, Some((_, last))) => new == last,
            (_, None) => false,
        };
        if !is_known {
            self.last_of_film = Some((run, event.clone()));
        }
        !is_known
    }

    /// Sends the credit. One that does not fit is dropped: the next includes it.
    pub fn send_credit(&self) {
        if let Some(connection) = &self.connection {
            let _ = connection.credits.try_send(self.credit);
        }
    }
}

pub(super) struct Connection {
    pub client: NodeCalls,
    pub probes: mpsc::Sender<v1::ProbeRequest>,
    pub credits: mpsc::Sender<v1::FrameCredit>,
}

/// The streams that a connection is read from.
pub(super) struct Streams {
    pub replies: tonic::Streaming<v1::ProbeReply>,
    pub frames: tonic::Streaming<v1::FrameInfo>,
}
