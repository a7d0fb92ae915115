//! What a node reports of its film: every frame as it comes, then how the film ended.

use std::sync::Arc;

use film_time::{FilmEvent, FilmState};
use proto::convert::film_event_to_wire;
use proto::v1;
use tokio::sync::mpsc;
use tonic::Status;

use crate::frames::{FrameId, FrameRing, News};

/// Sends until the reader goes.
pub(super) async fn send_film_events(
    ring: Arc<FrameRing>,
    sender: mpsc::Sender<Result<v1::FrameInfo, Status>>,
) {
    // The last frame that was sent, and the run whose end was.
    let mut last: Option<FrameId> = None;
    let mut ended_run: Option<u64> = None;
    loop {
        let changes = ring.changes();
        let News { run, called, frames, state } = ring.since(last);
        let mut events = Vec::with_capacity(frames.len() + 1);
        for frame in frames {
            last = Some(FrameId { run, number: frame.number });
            events.push(FilmEvent::Frame(frame.report()));
        }
        if state != FilmState::Running && ended_run != Some(run) {
            ended_run = Some(run);
            events.push(match state {
                FilmState::Failed(why) => FilmEvent::Failed(why),
                FilmState::Running | FilmState::Ended => FilmEvent::Ended,
            });
        }
        let last_of_run = last.filter(|last| last.run == run).map(|last| last.number);
        for event in events {
            let info = v1::FrameInfo { run: called, ..film_event_to_wire(event, last_of_run) };
            if sender.send(Ok(info)).await.is_err() {
                return;
            }
        }
        tokio::select! {
            biased;
            () = changes => {}
            () = sender.closed() => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use hull::{Observer, ProbeSettings, Silhouette};

    use super::*;
    use crate::frames::{CameraFrame, Stamp};

    #[tokio::test]
    async fn an_end_tells_the_last_frame_of_its_own_run() {
        let camera = crate::source::tests::camera(8, 4);
        let observer = Arc::new(Observer::new(camera, 0, ProbeSettings::default(), None));
        let ring = Arc::new(FrameRing::new(1));
        for number in [5, 7] {
            let stamp = Stamp { number, capture_time_s: 0.0, captured_unix_s: 0.0 };
            let silhouette = Silhouette::empty(8, 4).expect("size");
            ring.offer(0, stamp, CameraFrame::new(&observer, silhouette, 0.0));
        }
        ring.end(0);
        let (sender, mut events) = mpsc::channel(1);
        tokio::spawn(send_film_events(Arc::clone(&ring), sender));
        let mut seen = Vec::new();
        for _ in 0..3 {
            let event = events.recv().await.expect("an event").expect("no error");
            seen.push((event.run, event.frame, event.ended));
        }
        assert_eq!(seen, [(0, 5, false), (0, 7, false), (0, 7, true)]);
        ring.begin_run(8, false);
        ring.fail("no camera".into());
        let event = events.recv().await.expect("an event").expect("no error");
        assert_eq!((event.run, event.frame, event.ended, &event.failure[..]), (8, 0, true, "no camera"));
    }
}
