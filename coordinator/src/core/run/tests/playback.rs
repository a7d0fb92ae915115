//! Recordings that are played: sought, looped and played at another speed. Their runs end after each seek in the digest of the
//! first pass.

use super::*;
use crate::core::command::Refusal;
use crate::core::playback::PlaybackSettings;

/// A recording that is played, and what its viewer does. In lock-step it asks the hull again; else its answers are given,
/// and steps are made in their time.
struct Played {
    scripted: Scripted,
    tape: Vec<Sees>,
    next: usize,
    has_page: bool,
    /// How often the run began again, and the steps after which a film time was there that was sought.
    begun: usize,
    arrived: Vec<u64>,
}

impl Played {
    fn new(lock_step: bool, tape: Vec<Sees>, stays: bool) -> Played {
        let settings = RunSettings { lock_step, seconds: None, ..settings() };
        let mut scripted = Scripted::new(settings, if lock_step { films(31) } else { vec![] });
        let length_s = tape.last().map_or(0.0, film_s_of);
        scripted.run.playback = Some(Playback::new(PlaybackSettings { length_s, stays }));
        Played { scripted, tape, next: 0, has_page: true, begun: 0, arrived: vec![] }
    }

    fn ask(&mut self, command: &Command) -> Result<(), Refusal> {
        let run = &mut self.scripted.run;
        let prepared = run.prepare(command)?;
        run.carry_out(prepared).map(drop)
    }

    fn seek(&mut self, film_s: f64) {
        self.ask(&Command::Seek { film_s }).expect("within the recording");
    }

    /// Asks the schedule, if the run is between two steps, as the loop does; whether the run goes on.
    fn follow(&mut self) -> bool {
        if !matches!(self.scripted.run.state, State::Between) {
            return true;
        }
        let clock = Rc::clone(&self.scripted.now_s);
        let clocks = || Now { monotonic_s: clock.get(), unix_s: 0.0 };
        let mut follow = self.scripted.run.follow(self.has_page, &clocks);
        loop {
            follow = match follow {
                Follow::BeginAgain => {
                    self.begin_again();
                    Follow::Take
                }
                Follow::Take => match self.tape.get(self.next) {
                    Some(sees) => {
                        self.next += 1;
                        self.scripted.run.sees = Some(sees.clone());
                        Follow::GoOn
                    }
                    None => self.scripted.run.end_of_schedule(&clocks),
                },
                Follow::GoOn => break,
                Follow::End => return false,
            };
        }
        if self.scripted.run.arrive() {
            self.arrived.push(self.scripted.run.world.steps());
        }
        true
    }

    fn begin_again(&mut self) {
        let Scripted { run, roster, script, credits, .. } = &mut self.scripted;
        roster.begin_run();
        *script = if run.settings.lock_step { films(31).into() } else { VecDeque::new() };
        credits.clear();
        run.begin_again(world(), (&*roster, Answering::Nodes(NODES.into())));
        self.next = 0;
        self.begun += 1;
    }

    /// Does one thing; whether the run goes on.
    fn act(&mut self) -> bool {
        self.scripted.run.puts_off_step();
        self.follow() && self.scripted.act().expect("it goes on")
    }

    /// Until something holds.
    #[track_caller]
    fn until(&mut self, is_it: impl Fn(&Played) -> bool) {
        for _ in 0..MOST_ACTIONS {
            if is_it(self) {
                return;
            }
            assert!(self.act(), "the run ends after {} steps", self.scripted.run.world.steps());
        }
        panic!("it never holds: {:?}", self.scripted.run.playback);
    }

    /// Until a film time that was sought is there; after how many steps of the world.
    #[track_caller]
    fn arrive(&mut self) -> u64 {
        let before = self.arrived.len();
        self.until(|played| played.arrived.len() > before);
        self.arrived[before]
    }

    fn made(&self) -> u64 {
        self.scripted.run.world.steps()
    }

    fn has_ended(&self) -> bool {
        self.scripted.run.playback.as_ref().is_some_and(Playback::has_ended)
    }

    fn is_paused(&self) -> bool {
        self.scripted.run.steering.is_paused()
    }
}

fn film_s_of(sees: &Sees) -> f64 {
    match *sees {
        Sees::Recorded { film_s, .. } | Sees::Given { film_s, .. } => film_s,
        Sees::Film => f64::NAN,
    }
}

/// A second of film: what each step saw, and the digest after it.
fn recorded() -> (Vec<Sees>, Vec<TrajectoryDigest>) {
    let mut run = Scripted::new(RunSettings { lock_step: true, ..settings() }, films(31));
    let mut digests = vec![];
    while run.act().expect("it goes on") {
        if run.steps.len() > digests.len() {
            digests.push(run.digest());
        }
    }
    let frames = run.frames();
    let film_s = |step: usize| step as f64 * run.run.world.settings().dt_s;
    let tape = (1..).zip(&frames).map(|(step, &frame)| Sees::Recorded { film_s: film_s(step), frame });
    (tape.collect(), digests)
}

/// Steps that touch nothing and end at these film times.
fn untouched(film_s: impl IntoIterator<Item = f64>) -> Vec<Sees> {
    let given = |film_s| Sees::Given { film_s, frame: Some(0), responses: vec![BodyResponse::UNTOUCHED] };
    film_s.into_iter().map(given).collect()
}

#[test]
fn wherever_a_recording_is_sought_the_world_is_what_it_was_there() {
    let (tape, digests) = recorded();
    assert_eq!(digests.len(), 120);
    let mut played = Played::new(true, tape, true);
    played.until(|played| played.made() == 10);
    assert!(played.scripted.steps.iter().all(|seen| seen.frame.is_some()), "the hull is asked");
    for (film_s, step, begun) in [
        (0.5, 60, 0),
        (0.3, 36, 1),
        (0.3, 36, 1),
        (0.304, 36, 1),
        (0.9, 108, 1),
        (0.0, 1, 2),
        (1.0, 120, 2),
        (0.25, 30, 3),
    ] {
        played.seek(film_s);
        // The run goes on meanwhile by a step at most: one that had begun.
        assert_eq!((played.arrive(), played.begun), (step, begun), "{film_s} s");
        assert_eq!(played.scripted.digest(), digests[step as usize - 1], "{film_s} s");
    }
    // It stood at its end, and stands where it was sought from there.
    assert!(played.is_paused() && !played.has_ended());
    let refused = played.ask(&Command::Seek { film_s: 1.1 }).expect_err("beyond the end");
    assert_eq!(refused.to_string(), "a seek to 1.1 s, expected 0 to 1.000 s: the recording is so long");
}

#[test]
fn of_seeks_that_come_before_one_is_there_the_newest_counts() {
    let (tape, digests) = recorded();
    let mut played = Played::new(true, tape, true);
    played.until(|played| played.made() == 90);
    for film_s in [0.1, 0.2, 0.05, 0.4] {
        played.seek(film_s);
    }
    assert_eq!((played.arrive(), played.begun), (48, 1));
    // While it is on its way to one, others come at every step.
    played.seek(0.9);
    for more in 0..20 {
        played.seek(0.5 + 0.01 * f64::from(more));
        played.act();
    }
    assert_eq!((played.arrive(), played.begun), (82, 1), "0.69 s");
    assert_eq!(played.scripted.digest(), digests[81]);
}

#[test]
fn a_paused_recording_stands_where_it_is_sought_and_goes_on_from_there() {
    let (tape, digests) = recorded();
    let mut played = Played::new(true, tape, true);
    played.until(|played| played.made() == 20);
    played.ask(&Command::Step(50)).expect("counted");
    played.until(|played| played.made() == 30);
    played.seek(0.2);
    assert_eq!(played.arrive(), 24);
    (0..50).for_each(|_| assert!(played.act()));
    assert_eq!((played.made(), played.is_paused()), (24, true), "steps are no longer counted");
    played.ask(&Command::Step(2)).expect("counted");
    played.until(Played::is_paused);
    assert_eq!((played.made(), played.scripted.digest()), (26, digests[25]));
    played.ask(&Command::Resume).expect("it goes on");
    played.until(Played::has_ended);
    assert_eq!(played.scripted.digest(), digests[119]);
}

#[test]
fn at_its_end_a_recording_stands_while_a_page_is_there_and_is_played_again() {
    let (tape, digests) = recorded();
    let mut played = Played::new(true, tape.clone(), true);
    played.until(Played::has_ended);
    (0..100).for_each(|_| assert!(played.act(), "it stands while a page is there"));
    assert_eq!((played.made(), played.is_paused(), played.begun), (120, true, 0));
    played.ask(&Command::Step(1)).expect("counted");
    (0..10).for_each(|_| assert!(played.act()));
    assert_eq!((played.made(), played.is_paused()), (120, true), "there is no step more");
    played.ask(&Command::Resume).expect("it is played again");
    played.until(|played| played.made() == 70);
    assert_eq!((played.begun, played.is_paused(), played.scripted.digest()), (1, false, digests[69]));
    played.until(Played::has_ended);
    played.has_page = false;
    let left_s = played.scripted.now_s.get();
    while played.act() {}
    let waited_s = played.scripted.now_s.get() - left_s;
    assert!((2.8..3.2).contains(&waited_s), "the last page went {waited_s} s ago");
    for (stays, has_page) in [(false, true), (true, false)] {
        let mut ends = Played::new(true, tape.clone(), stays);
        ends.has_page = has_page;
        while ends.act() {}
        assert_eq!((ends.made(), ends.scripted.digest()), (120, digests[119]));
    }
}

#[test]
fn a_recording_that_loops_is_the_same_each_time_and_ends_without_a_page() {
    let (tape, digests) = recorded();
    let mut played = Played::new(true, tape, true);
    played.ask(&Command::SetLoop(true)).expect("it loops");
    for begun in 1..4 {
        played.until(|played| played.begun == begun && played.made() == 50);
        assert_eq!((played.scripted.digest(), played.is_paused()), (digests[49], false));
    }
    // Paused at its end it does not begin again.
    played.ask(&Command::Pause).expect("paused");
    played.seek(1.0);
    assert_eq!(played.arrive(), 120);
    (0..10).for_each(|_| assert!(played.act()));
    assert_eq!((played.begun, played.made()), (3, 120));
    played.ask(&Command::Resume).expect("it goes on");
    played.until(|played| played.begun == 4);
    played.has_page = false;
    played.scripted.answer_s = 0.2;
    for _ in 0..100 * MOST_ACTIONS {
        if !played.act() {
            return;
        }
    }
    panic!("it loops without a page");
}

#[test]
fn a_recording_is_played_as_fast_as_is_asked() {
    let dt_s = 1.0 / 120.0;
    let tape = untouched((1..=120).map(|step| f64::from(step) * dt_s));
    let mut played = Played::new(false, tape, true);
    played.until(|played| played.made() == 20);
    for (speed, steps) in [(4.0, 60), (0.25, 70), (1.0, 90), (10.0, 119)] {
        let from = played.made() as usize;
        played.ask(&Command::SetSpeed(speed)).expect("a speed");
        played.until(|played| played.made() == steps);
        let made = &played.scripted.steps[from..];
        for pair in made.windows(2) {
            let took_s = pair[1].at_s - pair[0].at_s;
            assert!((took_s - dt_s / speed).abs() < 1e-6, "{took_s} s a step at speed {speed}");
        }
        // The first comes at once, or when it was due anyway.
        assert!(made[0].at_s - played.scripted.steps[from - 1].at_s < 4.0 * dt_s + 1e-6);
    }
    let refused = played.ask(&Command::SetSpeed(0.0)).expect_err("it would stand");
    assert_eq!(refused.to_string(), "a speed of 0, expected 0.1 to 10");
    played.seek(0.5);
    let from_s = played.scripted.now_s.get();
    assert_eq!(played.arrive(), 60);
    assert!(played.scripted.now_s.get() - from_s < dt_s, "its steps are not waited for");
}

#[test]
fn a_speed_that_is_chosen_while_a_step_is_waited_for_holds_up_nothing() {
    let dt_s = 1.0 / 120.0;
    let mut played = Played::new(false, untouched((1..=1200).map(|step| f64::from(step) * dt_s)), true);
    for (speed, steps) in [(4.0, 600), (0.25, 620), (1.0, 640)] {
        played.until(|played| matches!(played.scripted.run.state, State::Early { .. }));
        played.ask(&Command::SetSpeed(speed)).expect("a speed");
        let (made, from_s) = (played.made(), played.scripted.now_s.get());
        played.until(|played| played.made() > made);
        let waited_s = played.scripted.now_s.get() - from_s;
        assert!(waited_s < 0.05, "{waited_s} s until the next step at speed {speed}");
        played.until(|played| played.made() == steps);
    }
}

#[test]
fn a_recording_that_loops_begins_again_also_where_its_end_was_sought() {
    let (tape, _) = recorded();
    let mut played = Played::new(true, tape, true);
    played.ask(&Command::SetLoop(true)).expect("it loops");
    played.until(|played| played.made() == 10);
    played.seek(1.0);
    played.until(|played| played.begun == 1 && played.made() == 10);
    assert!(!played.scripted.run.is_seeking(), "it is played, and seen");
}

#[test]
fn where_a_recording_has_no_steps_for_long_a_seek_does_not_wait() {
    let mut played = Played::new(false, untouched([0.1, 0.2, 0.3, 60.0, 60.1]), true);
    played.until(|played| played.made() == 3);
    (0..5).for_each(|_| assert!(played.act()));
    let now_s = played.scripted.now_s.get();
    played.seek(50.0);
    assert_eq!((played.arrive(), played.begun), (3, 0), "there is no step between");
    played.seek(0.2);
    assert_eq!((played.arrive(), played.begun), (2, 1));
    played.seek(50.0);
    assert_eq!(played.arrive(), 3);
    assert!(played.scripted.now_s.get() - now_s < 0.5);
    played.until(|played| played.made() == 4);
    let waited_s = played.scripted.now_s.get() - now_s;
    assert!((10.0 - 1e-6..10.5).contains(&waited_s), "{waited_s} s from 50 s to 60 s");
}

#[test]
fn a_live_run_is_not_sought_sped_up_or_looped() {
    let mut live = Scripted::new(settings(), films(31));
    for command in [Command::Seek { film_s: 0.1 }, Command::SetSpeed(2.0), Command::SetLoop(true)] {
        let prepared = live.run.prepare(&command).expect("nothing is needed");
        let Err(why) = live.run.carry_out(prepared) else { panic!("it is live") };
        let why = why.to_string();
        assert!(why.starts_with("this run is no replay"), "{why}");
    }
    live.go().expect("it goes on");
    assert_eq!(live.digest(), run(settings(), films(31)).digest());
}
