//! How a recorded run is played: where a viewer seeks, how fast film goes by, and what happens at the end.
//!
//! A replay makes a run again step by step, and no step can be taken back. A seek ahead makes the steps in between as
//! fast as they can be made, and shows none of them. A seek back begins the run again, and seeks ahead from there.

use serde::Serialize;

use super::command::{Refusal, SPEEDS};

/// Times that differ by less are equal, seconds: texts and sums of times are no more exact.
const SLACK_S: f64 = 1e-9;
/// How long a recording stays at its end after the last page has gone, seconds: a page that is loaded again is soon back.
const PAGE_GRACE_S: f64 = 3.0;

/// What is known of a recording before it is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaybackSettings {
    /// Film time of its last step, seconds.
    pub length_s: f64,
    /// Whether the run stays at the end of the recording while a page is connected. Else it ends there.
    pub stays: bool,
}

/// How a recording is played now. Its fields are keys of the page's status.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlaybackStatus {
    /// Seconds of film in a second.
    pub speed: f64,
    /// Whether the recording begins again at its end.
    #[serde(rename = "loop")]
    pub loops: bool,
    /// Film time that is being sought, seconds.
    pub seeking_s: Option<f64>,
    /// Whether the run stands at the end of the recording.
    #[serde(rename = "ended")]
    pub has_ended: bool,
}

/// A recording that is played.
#[derive(Debug)]
pub(crate) struct Playback {
    settings: PlaybackSettings,
    speed: f64,
    loops: bool,
    /// Steps made since the run last began, and film time of the last of them, seconds.
    steps: u64,
    made_s: f64,
    /// Film time that is being sought, seconds.
    target_s: Option<f64>,
    /// The seek that is under way was asked for after the last decision.
    is_new: bool,
    /// The recording has no more steps.
    has_ended: bool,
    /// Film time that is due now, seconds; the next step's if that is earlier.
    due_s: Option<f64>,
    /// When a page was last connected, seconds.
    page_seen_s: Option<f64>,
}

impl Playback {
    /// A recording at its beginning.
    pub fn new(settings: PlaybackSettings) -> Playback {
        Playback {
            settings,
            speed: 1.0,
            loops: false,
            steps: 0,
            made_s: 0.0,
            target_s: None,
            is_new: false,
            has_ended: false,
            due_s: None,
            page_seen_s: None,
        }
    }

    /// How it is played now.
    pub fn status(&self) -> PlaybackStatus {
        let Playback { speed, loops, target_s, has_ended, .. } = *self;
        PlaybackStatus { speed, loops, seeking_s: target_s, has_ended }
    }

    /// Seconds of film in a second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Seeks a film time, seconds, in place of one that was being sought.
    pub fn seek(&mut self, film_s: f64) -> Result<(), Refusal> {
        let length_s = self.settings.length_s;
        if !(0.0..=length_s + SLACK_S).contains(&film_s) {
            return Err(Refusal::Seek { found_s: film_s, length_s });
        }
        self.is_new |= self.target_s.is_none();
        self.target_s = Some(film_s);
        Ok(())
    }

    /// Changes how many seconds of film go by in a second.
    pub fn set_speed(&mut self, speed: f64) -> Result<(), Refusal> {
        if !SPEEDS.contains(&speed) {
            return Err(Refusal::Speed { found: speed });
        }
        self.speed = speed;
        self.due_s = Some(f64::INFINITY);
        Ok(())
    }

    /// Whether the recording begins again at its end.
    pub fn set_loop(&mut self, loops: bool) {
        self.loops = loops;
    }

    /// The run goes on: at its end, from its beginning.
    pub fn resume(&mut self) {
        if self.has_ended && self.target_s.is_none() {
            self.target_s = Some(0.0);
        }
    }

    /// Whether a film time is being sought: steps are made at once, and not shown.
    pub fn is_seeking(&self) -> bool {
        self.target_s.is_some()
    }

    /// Whether a seek has begun since the last decision.
    pub fn has_new_seek(&self) -> bool {
        self.is_new
    }

    /// The run stands at the end of the recording.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Decides what comes next: true if the run has to begin again, because the last step ends after the film time that is
    /// sought. The first step is what there is to see of any time before it.
    pub fn goes_back(&mut self) -> bool {
        self.is_new = false;
        let is_later = self.target_s.is_some_and(|target_s| self.made_s > target_s + SLACK_S);
        is_later && (self.steps > 1 || self.has_ended)
    }

    /// The run begins again.
    pub fn begin_again(&mut self) {
        (self.steps, self.made_s, self.has_ended) = (0, 0.0, false);
        self.due_s = Some(f64::INFINITY);
    }

    /// A step was made that ends at this film time, seconds.
    pub fn note(&mut self, film_s: f64) {
        self.steps += 1;
        self.made_s = film_s;
    }

    /// Whether the film time that is sought was reached; `next_s`: film time of the next step, if there is one, seconds.
    pub fn arrive(&mut self, next_s: Option<f64>) -> bool {
        let Some(target_s) = self.target_s else { return false };
        let is_before = next_s.is_some_and(|next_s| next_s <= target_s + SLACK_S);
        if is_before || self.steps == 0 || self.goes_back() {
            return false;
        }
        self.target_s = None;
        self.due_s = Some(target_s.max(self.made_s));
        true
    }

    /// The film time that is due now, if that has changed, seconds; `next_s`: film time of the next step.
    pub fn take_due(&mut self, next_s: f64) -> Option<f64> {
        self.due_s.take().map(|due_s| due_s.min(next_s))
    }

    /// Notes whether a page is connected at this time, seconds.
    pub fn note_page(&mut self, has_page: bool, now_s: f64) {
        if has_page {
            self.page_seen_s = Some(now_s);
        }
    }

    /// Whether the run stays at the end of the recording at this time, seconds.
    pub fn stays(&self, now_s: f64) -> bool {
        let has_page = self.page_seen_s.is_some_and(|seen_s| now_s - seen_s < PAGE_GRACE_S);
        self.settings.stays && has_page
    }

    /// Nothing is sought any more.
    pub fn forget_seek(&mut self) {
        self.target_s = None;
    }

    /// There are no more steps. Whether the recording begins again.
    pub fn end(&mut self) -> bool {
        self.has_ended = true;
        // Of a file that can no longer be read there are no steps at all.
        self.loops && self.steps > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps of the recording end at 0.5, 1.0, 1.5, 2.0 and 2.5 s.
    const LENGTH_S: f64 = 2.5;

    fn playback() -> Playback {
        Playback::new(PlaybackSettings { length_s: LENGTH_S, stays: true })
    }

    /// Makes steps until the film time that is sought is reached; how often the run began again, and where it is.
    fn reach(playback: &mut Playback) -> (usize, f64) {
        let mut begun = 0;
        for _ in 0..100 {
            if playback.goes_back() {
                playback.begin_again();
                begun += 1;
            }
            let next_s = playback.made_s + 0.5;
            let next_s = (next_s <= LENGTH_S).then_some(next_s);
            if next_s.is_none() {
                playback.end();
            }
            if playback.arrive(next_s) {
                return (begun, playback.made_s);
            }
            playback.note(next_s.expect("there are more steps"));
        }
        panic!("it does not arrive");
    }

    fn sought(playback: &mut Playback, film_s: f64) -> (usize, f64) {
        playback.seek(film_s).expect("within the recording");
        reach(playback)
    }

    #[test]
    fn a_seek_ends_with_the_last_step_before_its_time_and_goes_back_only_if_it_must() {
        let mut playback = playback();
        assert_eq!(sought(&mut playback, 1.2), (0, 1.0), "ahead");
        assert_eq!(sought(&mut playback, 1.4), (0, 1.0), "it is there");
        assert_eq!(sought(&mut playback, 2.0), (0, 2.0), "ahead from there");
        assert_eq!(sought(&mut playback, 1.5), (1, 1.5), "back");
        assert_eq!(sought(&mut playback, 0.0), (1, 0.5), "the first step is the earliest");
        assert_eq!(sought(&mut playback, 0.1), (0, 0.5), "and is there");
        assert_eq!(sought(&mut playback, LENGTH_S), (0, LENGTH_S));
        assert!(playback.has_ended());
        assert_eq!(sought(&mut playback, LENGTH_S), (0, LENGTH_S), "it stays at its end");
        assert_eq!(sought(&mut playback, 2.4), (1, 2.0));
        assert!(!playback.has_ended());
    }

    #[test]
    fn of_many_seeks_the_newest_counts() {
        let mut playback = playback();
        playback.note(0.5);
        for film_s in [2.4, 0.1, 1.3, 2.0] {
            playback.seek(film_s).expect("within the recording");
        }
        assert_eq!(playback.status().seeking_s, Some(2.0));
        assert_eq!(reach(&mut playback), (0, 2.0));
        assert_eq!(playback.status().seeking_s, None);
    }

    #[test]
    fn a_seek_that_changes_another_one_puts_no_step_off() {
        let mut playback = playback();
        playback.note(0.5);
        playback.seek(2.0).expect("within the recording");
        assert!(playback.has_new_seek() && !playback.goes_back() && !playback.has_new_seek());
        playback.seek(1.5).expect("within the recording");
        assert!(!playback.has_new_seek(), "or a flood of them would hold up the run");
    }

    #[test]
    fn what_is_no_place_or_no_speed_is_refused_with_what_is_expected() {
        let mut playback = playback();
        for film_s in [-0.1, 2.6, f64::NAN, f64::INFINITY] {
            let why = playback.seek(film_s).expect_err("no place").to_string();
            assert_eq!(why, format!("a seek to {film_s} s, expected 0 to 2.500 s: the recording is so long"));
        }
        assert_eq!(playback.status().seeking_s, None);
        for speed in [0.0, -1.0, 0.09, 10.1, f64::NAN] {
            let why = playback.set_speed(speed).expect_err("no speed").to_string();
            assert_eq!(why, format!("a speed of {speed}, expected 0.1 to 10"));
        }
        assert_eq!(playback.status().speed, 1.0);
    }

    #[test]
    fn film_is_due_from_where_it_was_sought_and_from_the_next_step_when_the_speed_changes() {
        let mut playback = playback();
        assert_eq!(playback.take_due(0.5), None);
        sought(&mut playback, 1.2);
        assert_eq!((playback.take_due(1.5), playback.take_due(1.5)), (Some(1.2), None));
        playback.set_speed(4.0).expect("a speed");
        assert_eq!(playback.take_due(1.5), Some(1.5));
    }

    #[test]
    fn at_its_end_a_recording_stays_for_pages_that_are_there_or_were_just_now() {
        let mut stays = playback();
        assert!(!stays.stays(0.0), "no page has come");
        stays.note_page(true, 1.0);
        stays.note_page(false, 2.0);
        assert!(stays.stays(3.9) && !stays.stays(4.0));
        let mut ends = Playback::new(PlaybackSettings { length_s: LENGTH_S, stays: false });
        ends.note_page(true, 1.0);
        assert!(!ends.stays(1.0));
    }

    #[test]
    fn a_recording_that_has_ended_is_played_again_from_its_beginning() {
        let mut playback = playback();
        sought(&mut playback, LENGTH_S);
        playback.resume();
        assert_eq!(reach(&mut playback), (1, 0.5));
        playback.resume();
        assert!(!playback.is_seeking(), "one that has not ended goes on from where it is");
    }

    #[test]
    fn a_recording_loops_if_it_is_to_and_has_steps() {
        let mut playback = playback();
        playback.set_loop(true);
        assert!(!playback.end(), "an unreadable file is not read for ever");
        playback.begin_again();
        playback.note(0.5);
        assert!(playback.end());
        playback.set_loop(false);
        assert!(!playback.end());
    }
}
