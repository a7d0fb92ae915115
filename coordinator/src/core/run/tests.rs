//! Runs over nodes that follow a script: no node, no socket, no thread, and no clock but a number.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

use film_time::FilmEvent;
use hull::question::Answer;
use hull::silhouette::PixelRect;
use hull::view_set::Scratch;
use hull::{ProbeSettings, ViewSet};
use sim::{BodyResponse, BodySpec, Parameters, Scene, TrajectoryDigest, WorldSettings};

use super::*;
use crate::core::command::{Command, Refusal};
use crate::core::playback::PlaybackSettings;
use crate::core::query::AskEvery;
use crate::core::room;

const NODES: u16 = 4;
const FPS: f64 = 30.0;
const STEPS_PER_FRAME: u64 = 4;
/// A frame is known so long after its capture, seconds.
const ARRIVES_S: f64 = 0.01;
const LATENCY_S: f64 = 0.05;
/// What a question takes, and what one takes that is not answered in time, seconds.
const ANSWER_S: f64 = 0.002;
const TIMEOUT_S: f64 = 0.03;

/// More than any of these runs needs.
const MOST_ACTIONS: usize = 10_000;

const SCENE: &str = r#"
[floor]
enabled = false

[[bodies]]
name = "box"
shape.box.size = [0.1, 0.1, 0.1]
place.at = [0.0, 0.3, 0.0]
"#;

/// What happens at a node.
#[derive(Clone, Copy, Debug)]
enum Event {
    Frame(u64),
    Ends,
    Breaks,
    /// It reports and answers nothing any more.
    Freezes,
    /// It does again.
    GoesOn,
    /// It answers nothing any more, and films on.
    GoesDeaf,
}

/// What a step saw.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    at_s: f64,
    frame: Option<u64>,
    is_touched: bool,
    /// How far the deepest contact moves the box out, metres.
    deepest_m: f32,
    /// How fast the fastest surface comes that it touches, m/s.
    fastest_m_s: f32,
}

struct Scripted {
    run: Run,
    roster: Roster,
    now_s: Rc<Cell<f64>>,
    /// Events and their times, ascending, by node.
    script: VecDeque<(f64, u16, Event)>,
    /// What every camera sees of a frame, and what is made of it for each node.
    seen: fn(u64) -> PixelRect,
    views: (PixelRect, Vec<ViewSet>),
    is_frozen: [bool; NODES as usize],
    is_deaf: [bool; NODES as usize],
    /// Commands, and the steps before which they are given.
    commands: VecDeque<(u64, Command)>,
    /// What a question takes from now on, seconds.
    answer_s: f64,
    /// Questions that were not answered.
    failures: usize,
    /// What cameras were let film, in order.
    credits: Vec<u64>,
    steps: Vec<Seen>,
}

fn settings() -> RunSettings {
    RunSettings {
        probes: ProbeSettings::default(),
        fps: FPS,
        latency_s: Some(LATENCY_S),
        hold_s: 0.0,
        seconds: Some(1.0),
        lock_step: false,
        ask_every: AskEvery::Frame,
        reuse_within_m: 0.0,
        going_on: GoingOn::default(),
        connect_timeout: Duration::from_secs(20),
    }
}

fn world() -> World {
    let world_settings = WorldSettings { response: ResponseMode::Contacts, ..Default::default() };
    let scene = Scene::from_toml("scripted", SCENE).expect("a scene");
    World::new(&scene, world_settings).expect("a world")
}

/// Every node films so many frames.
fn films(frames: u64) -> Vec<(f64, u16, Event)> {
    let of = |frame: u64| {
        let at_s = frame as f64 / FPS + ARRIVES_S;
        (0..NODES).map(move |node| (at_s, node, Event::Frame(frame)))
    };
    (0..frames).flat_map(of).collect()
}

impl Scripted {
    fn new(settings: RunSettings, mut script: Vec<(f64, u16, Event)>) -> Scripted {
        script.sort_by(|a, b| a.0.total_cmp(&b.0));
        let world = world();
        let observers = room::observers(NODES);
        let nodes = (0..NODES).map(|node| crate::roster::RosterNode::new(format!("n{node}"), vec![node]));
        let mut roster = Roster::new(nodes.collect());
        (0..NODES.into()).for_each(|node| roster.up(node));
        roster.begin_run();
        let views = (room::SEEN, observers.chunks(1).map(room::views).collect());
        let answering = Answering::Nodes(NODES.into());
        let pace = Pace { run: 1, zero_s: 0.0, epoch_unix_s: 0.0, lock_step: settings.lock_step };
        let mut run = Run::new(world, observers, settings, (&roster, answering));
        run.clock.pace = pace;
        Scripted {
            run,
            roster,
            now_s: Rc::default(),
            script: script.into(),
            seen: |_| room::SEEN,
            views,
            is_frozen: [false; NODES as usize],
            is_deaf: [false; NODES as usize],
            commands: VecDeque::new(),
            answer_s: ANSWER_S,
            failures: 0,
            credits: vec![],
            steps: vec![],
        }
    }

    /// When the next event happens, seconds: in lock-step a node films no further than it may.
    fn next_event_s(&self) -> Option<f64> {
        let (at_s, _, event) = self.script.front()?;
        let waits = matches!(event, Event::Frame(frame) if self.run.settings.lock_step && Some(frame) > self.credits.last());
        (!waits).then_some(*at_s)
    }

    /// Time goes on, and what the script has happens.
    fn pass(&mut self, until_s: f64) {
        while self.next_event_s().is_some_and(|at_s| at_s <= until_s)
            && let Some((at_s, node, event)) = self.script.pop_front()
        {
            let place = usize::from(node);
            match event {
                Event::Frame(_) if self.is_frozen[place] => {}
                Event::Frame(frame) => {
                    self.roster.heard(Arrival { node: place, frame, heard_s: at_s });
                    let report = room::report(frame, [node], Some((self.seen)(frame)));
                    self.roster.film_event(place, FilmEvent::Frame(report), at_s);
                }
                Event::Ends => self.roster.film_event(place, FilmEvent::Ended, at_s),
                Event::Breaks => self.roster.down(place, "it broke".into()),
                Event::Freezes => self.is_frozen[place] = true,
                Event::GoesOn => self.is_frozen[place] = false,
                Event::GoesDeaf => self.is_deaf[place] = true,
            }
        }
        self.now_s.set(until_s);
    }

    fn wait(&mut self, at_most_s: f64) {
        let now_s = self.now_s.get();
        let until_s = now_s + at_most_s;
        self.pass(self.next_event_s().map_or(until_s, |at_s| at_s.clamp(now_s, until_s)));
    }

    /// All that are asked answer, but for nodes that are frozen.
    fn answer(&mut self, frame: u64) -> Result<(), Unanswered> {
        self.pass(self.now_s.get() + self.answer_s);
        let seen = (self.seen)(frame);
        if seen != self.views.0 {
            let views = |observer| room::views_of(observer, seen);
            self.views = (seen, self.run.observers().chunks(1).map(views).collect());
        }
        let views = &self.views.1;
        let (pass, mut took) = self.run.pass();
        let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
        while let Some(question) = pass.question().cloned() {
            let also = pass.speculative_question().cloned();
            let asked: Vec<usize> = (0..views.len()).filter(|&node| pass.asks(node)).collect();
            let is_silent = |node: &usize| self.is_frozen[*node] || self.is_deaf[*node];
            let silent: Vec<usize> = asked.iter().copied().filter(is_silent).collect();
            if !silent.is_empty() {
                self.failures += 1;
                self.now_s.set(self.now_s.get() + TIMEOUT_S);
                self.roster.record_late(&silent, self.now_s.get(), "no answer in time");
                return Err(Unanswered("no answer in time".into()));
            }
            took(pass.round(), self.answer_s * 1e3);
            for question in [Some(question), also].into_iter().flatten() {
                for &node in &asked {
                    views[node].answer(&question, &mut scratch, &mut answer);
                    pass.answer(node, &answer).expect("an answer to what was asked");
                }
            }
        }
        Ok(())
    }

    /// Does the next action; whether the run goes on.
    fn act(&mut self) -> Result<bool, CannotGoOn> {
        let clock = Rc::clone(&self.now_s);
        let clocks = || Now { monotonic_s: clock.get(), unix_s: 0.0 };
        match self.run.next(&mut self.roster, &clocks)? {
            Action::Wait { at_most_s } => self.wait(at_most_s),
            Action::TakeOrders => self.take_order(),
            Action::Credit(up_to_frame) => {
                self.credits.push(up_to_frame);
                self.pass(clock.get());
            }
            Action::UseFrame(_) | Action::StandStill | Action::StartAfresh => {}
            Action::Ask { frame, .. } => {
                let answered = self.answer(frame);
                self.run.answered(answered, &mut self.roster, &clocks);
            }
            Action::Make(step) => {
                let at_s = clock.get();
                let made = self.run.make(&step, &self.roster, &clocks).expect("a step");
                let is_touched = made.touched > 0;
                let contacts = step.responses.iter().flat_map(|response| &response.contacts);
                let deepest_m = contacts.clone().map(|contact| contact.depth_m).fold(0.0, f32::max);
                let fastest_m_s = contacts.filter_map(|contact| contact.speed_m_s).fold(0.0, f32::max);
                let frame = self.run.film.hull_frame();
                self.steps.push(Seen { at_s, frame, is_touched, deepest_m, fastest_m_s });
            }
            Action::Rest => {
                self.take_order();
                self.pass(clock.get() + 0.05);
                self.run.let_film_pass(&clocks);
            }
            Action::End => return Ok(false),
        }
        Ok(true)
    }

    /// Until the run ends.
    fn go(&mut self) -> Result<(), CannotGoOn> {
        for _ in 0..MOST_ACTIONS {
            if !self.act()? {
                return Ok(());
            }
        }
        panic!("the run does not end: {:?}", self.steps.last());
    }

    /// Follows a schedule for one step.
    fn follow(&mut self, sees: Sees) -> Result<(), CannotGoOn> {
        self.run.sees = Some(sees);
        let made = self.steps.len();
        for _ in 0..MOST_ACTIONS {
            if self.steps.len() > made {
                return Ok(());
            }
            self.act()?;
        }
        panic!("no step is made after {made}");
    }

    /// One, if its time has come.
    fn take_order(&mut self) {
        let made = self.run.world.steps();
        if let Some((_, command)) = self.commands.pop_front_if(|(step, _)| *step <= made) {
            let prepared = self.run.prepare(&command).expect("it can be done");
            self.run.carry_out(prepared).expect("it is done");
        }
    }

    fn frames(&self) -> Vec<Option<u64>> {
        self.steps.iter().map(|seen| seen.frame).collect()
    }

    fn digest(&self) -> TrajectoryDigest {
        self.run.world.digest()
    }

    fn blind_steps(&self) -> u64 {
        self.run.figures.counts.misses.blind_steps()
    }
}

/// A run to its end.
fn run(settings: RunSettings, script: Vec<(f64, u16, Event)>) -> Scripted {
    let mut scripted = Scripted::new(settings, script);
    scripted.go().expect("it goes on");
    scripted
}

/// What steps 1 to `count` see if nothing fails: step k sees frame k / 4.
fn every_frame(count: u64) -> Vec<Option<u64>> {
    (1..=count).map(|step| Some(step / STEPS_PER_FRAME)).collect()
}

/// What every camera sees below the box comes up by 15 cm a frame, 4.5 m/s, and no edge tells how far it moved.
#[test]
fn what_comes_fast_is_as_fast_as_the_frame_before_tells() {
    let mut comes = Scripted::new(settings(), films(31));
    comes.seen = |frame| {
        let rows = 5 * frame.min(9) as u32;
        PixelRect { left: 42, top: 5 + rows, right: 59, bottom: 22 + rows }
    };
    let no_gravity = Parameters { gravity_m_s2: Some([0.0; 3]), ..Parameters::default() };
    comes.commands.push_back((0, Command::Set(no_gravity)));
    comes.go().expect("it goes on");
    let met = comes.steps.iter().find(|step| step.fastest_m_s > 0.0).expect("it meets the box");
    assert!((met.fastest_m_s - 4.5).abs() < 0.3, "{met:?}");
    assert!(comes.steps.iter().all(|step| step.fastest_m_s < 5.0));
}

#[test]
fn a_live_step_is_made_at_its_time_and_sees_the_frame_of_its_time() {
    let live = run(settings(), films(31));
    assert_eq!(live.frames(), every_frame(120));
    for (step, seen) in (1..).zip(&live.steps) {
        let due_s = f64::from(step) / 120.0 + LATENCY_S;
        assert!((-1e-9..0.01).contains(&(seen.at_s - due_s)), "step {step} at {} s", seen.at_s);
    }
    assert!(live.steps.iter().any(|seen| seen.is_touched), "the box falls through the person");
    assert_eq!((live.blind_steps(), live.run.figures.counts.frames), (0, 31));
}

#[test]
fn a_live_run_that_missed_nothing_is_the_lock_step_run() {
    let live = run(settings(), films(31));
    let lock_step = run(RunSettings { lock_step: true, ..settings() }, films(31));
    assert_eq!(lock_step.frames(), live.frames());
    assert_eq!(lock_step.digest(), live.digest());
    // Film is 20 s late.
    let late = films(31).into_iter().map(|(at_s, node, event)| (at_s + 20.0, node, event));
    assert_eq!(run(RunSettings { lock_step: true, ..settings() }, late.collect()).digest(), live.digest());
}

#[test]
fn a_step_is_due_once_its_time_is_left_to_rounding() {
    let mut waits = Scripted::new(settings(), films(31));
    // A clock of whole nanoseconds may stand a little before the time of a step: a wait for that takes no time.
    let mut film_s = 0.0;
    let due_s = loop {
        film_s += 1.0 / 120.0;
        let due_s = film_s + LATENCY_S;
        let rounded_s = (due_s * 1e9).round() / 1e9;
        if rounded_s < due_s {
            break rounded_s;
        }
    };
    let now = Now { monotonic_s: due_s, unix_s: 0.0 };
    assert_eq!(waits.run.clock.left_s(film_s, now), None, "{film_s}");
    let before = Now { monotonic_s: due_s - 1e-6, ..now };
    assert!(waits.run.clock.left_s(film_s, before).is_some());
}

#[test]
fn in_lock_step_cameras_film_half_of_their_rings_ahead() {
    let run = run(RunSettings { lock_step: true, ..settings() }, films(31));
    let expected: Vec<u64> = (0..=30).map(|frame| frame + FRAMES_AHEAD).collect();
    assert_eq!(run.credits, expected, "once a frame");
}

#[test]
fn the_same_script_is_the_same_run() {
    let script = || [films(31), vec![(0.3, 1, Event::Freezes), (0.6, 2, Event::Breaks)]].concat();
    let going_on = GoingOn { min_cameras: 2, ..GoingOn::default() };
    let runs = [(); 2].map(|()| run(RunSettings { going_on, ..settings() }, script()));
    assert_eq!(runs[0].steps, runs[1].steps);
    assert_eq!(runs[0].digest(), runs[1].digest());
    assert!(runs[0].run.figures.counts.misses.reduced_steps > 0);
}

#[test]
fn a_node_that_freezes_costs_one_question_and_is_left_out_until_it_goes_on() {
    let frozen =
        run(settings(), [films(31), vec![(0.3, 1, Event::Freezes), (0.7, 1, Event::GoesOn)]].concat());
    assert_eq!((frozen.failures, frozen.blind_steps()), (1, 0), "the step asks once more, without it");
    assert!(!frozen.roster.nodes()[1].is_left_out());
    let reduced = frozen.run.figures.counts.misses.reduced_steps;
    assert!((40..60).contains(&reduced), "{reduced} of 120 steps, 48 of them in these 0.4 s");
}

#[test]
fn a_question_that_no_node_is_left_out_for_is_not_asked_again() {
    let going_on = GoingOn { min_cameras: 4, ..GoingOn::default() };
    let script = [films(31), vec![(0.3, 1, Event::GoesDeaf)]].concat();
    let deaf = run(RunSettings { going_on, seconds: Some(0.6), ..settings() }, script);
    assert!(deaf.failures > 0);
    assert_eq!(deaf.blind_steps(), deaf.failures as u64, "each costs a step its hull");
    let why = HullUnavailable::Unanswered("no answer in time".into());
    assert_eq!(deaf.run.figures.counts.misses.blind_by_cause[why.cause()], deaf.blind_steps());
}

#[test]
fn for_a_second_after_a_camera_has_gone_bodies_are_moved_gently() {
    let push_m_s = 0.05;
    let going_on = GoingOn { push_m_s, ..GoingOn::default() };
    let freezes = vec![(0.1, 1, Event::Freezes)];
    let gentle = run(RunSettings { going_on, ..settings() }, [films(31), freezes].concat());
    let until_s = gentle.run.film.gentle_until_s;
    assert!((1.0..1.2).contains(&until_s), "{until_s}");
    let deepest_m = |run: &Scripted| run.steps.iter().skip(12).map(|seen| seen.deepest_m).fold(0.0, f32::max);
    let most_m = (push_m_s / 120.0) as f32;
    assert!(deepest_m(&gentle) <= most_m, "{} m", deepest_m(&gentle));
    let rough_m = deepest_m(&run(settings(), films(31)));
    assert!(rough_m > most_m, "with all cameras it may be moved {rough_m} m");
}

#[test]
fn with_too_few_cameras_there_is_no_hull_and_the_world_goes_on() {
    let going_on = GoingOn { min_cameras: 4, ..GoingOn::default() };
    let broken =
        run(RunSettings { going_on, ..settings() }, [films(31), vec![(0.5, 3, Event::Breaks)]].concat());
    assert_eq!(broken.steps.len(), 120);
    let blind = broken.frames().iter().filter(|frame| frame.is_none()).count() as u64;
    assert!((60..75).contains(&blind), "{blind} of the 66 steps made after it broke");
    assert_eq!(broken.blind_steps(), blind);
    let why = broken.run.film.unavailable.map(|why| why.to_string());
    assert_eq!(why.as_deref(), Some("3 of 4 cameras, 4 needed: node n3: it broke"));
}

#[test]
fn the_world_stands_still_until_there_is_film() {
    let late = films(61).into_iter().filter(|(_, _, event)| !matches!(event, Event::Frame(0..30)));
    let begun = run(RunSettings { seconds: Some(2.0), ..settings() }, late.collect());
    assert_eq!(begun.steps[0].frame, Some(30), "no step was made without a hull: {:?}", begun.steps[0]);
    assert_eq!(begun.blind_steps(), 0);
}

#[test]
fn a_run_whose_film_never_comes_ends_with_its_time_and_says_why() {
    let empty = run(settings(), vec![]);
    assert!(empty.steps.is_empty() && (1.0..1.3).contains(&empty.now_s.get()));
    assert_eq!(empty.run.film.unavailable.map(|why| why.to_string()), Some("no frame has come yet".into()));
}

#[test]
fn film_that_goes_by_while_the_run_is_paused_is_not_missed() {
    let mut paused = Scripted::new(settings(), films(31));
    // A rest lasts 0.05 s: it is asked to pause for as long as six of them.
    paused.commands = [(); 6].map(|()| (40, Command::Pause)).into();
    paused.commands.push_back((40, Command::Resume));
    paused.go().expect("it goes on");
    let passed = paused.frames()[41].unwrap_or(0) - paused.frames()[39].unwrap_or(0);
    assert!(passed >= 6, "{passed} frames went by");
    let figures = &paused.run.figures;
    assert_eq!((figures.counts.frames_passed_over, paused.blind_steps()), (0, 0));
    let missed = figures.frames_missed();
    assert_eq!(missed, 0, "none of them was expected");
}

#[test]
fn a_run_that_is_stepped_sees_the_frame_at_which_it_was_paused() {
    let mut stepped = Scripted::new(settings(), films(31));
    stepped.commands = [(40, Command::Pause), (40, Command::Step(12)), (52, Command::Resume)].into();
    stepped.go().expect("it goes on");
    assert_eq!(stepped.frames()[40..52], [Some(10); 12]);
    assert!(stepped.frames()[52] > Some(10), "film went on");
    assert_eq!((stepped.run.figures.counts.frames_passed_over, stepped.blind_steps()), (0, 0));
}

#[test]
fn steps_that_take_too_long_give_up_film_and_not_the_world() {
    let mut slow = Scripted::new(settings(), films(61));
    slow.run.settings.seconds = Some(2.0);
    slow.answer_s = 0.06;
    slow.go().expect("it goes on");
    let (made, slipped_s) = (slow.steps.len() as f64, slow.run.clock.slipped_s);
    assert!(slipped_s > 0.2, "{slipped_s}");
    assert!((made / 120.0 + slipped_s - 2.0).abs() < 0.16, "{made} steps and {slipped_s} s are not 2 s");
    assert_eq!(slow.blind_steps(), 0);
}

#[test]
fn film_that_ends_is_held_and_then_the_run_is_over() {
    let ends = (0..NODES).map(|node| (15.0 / FPS + 0.02, node, Event::Ends));
    let held = RunSettings { hold_s: 0.1, ..settings() };
    let ended = run(held, films(16).into_iter().chain(ends).collect());
    // 16 frames last until 0.533 s.
    assert_eq!(ended.steps.len(), 76, "{:?}", ended.steps.last());
    assert_eq!(ended.steps.last().and_then(|seen| seen.frame), Some(15));
    assert_eq!(ended.run.figures.frames_expected, 16);
}

#[test]
fn a_schedule_sees_its_frames_and_waits_for_them() {
    let mut replayed = Scripted::new(RunSettings { lock_step: true, ..settings() }, films(31));
    replayed.follow(Sees::Recorded { film_s: 0.2, frame: Some(5) }).expect("it has the frame");
    replayed.follow(Sees::Recorded { film_s: 0.21, frame: None }).expect("as when it was recorded");
    assert_eq!(replayed.frames(), [Some(5), None]);
    let asked = replayed.run.figures.counts.passes.asked;
    let responses = vec![BodyResponse::UNTOUCHED];
    replayed.follow(Sees::Given { film_s: 0.22, frame: Some(6), responses }).expect("nothing is needed");
    assert_eq!(replayed.run.figures.counts.passes.asked, asked, "responses are given");
    replayed.is_frozen[0] = true;
    let error =
        replayed.follow(Sees::Recorded { film_s: 0.24, frame: Some(7) }).expect_err("a node lacks it");
    assert_eq!(error.to_string(), "frame 7 did not come within 30 s");
}

#[test]
fn a_schedule_ends_where_a_step_has_no_hull_any_more() {
    let mut replayed = Scripted::new(RunSettings { lock_step: true, ..settings() }, films(31));
    replayed.run.sees = Some(Sees::Recorded { film_s: 0.2, frame: Some(5) });
    // The box is where the hull must be asked, and one node answers nothing.
    while replayed.run.figures.counts.passes.asked == 0 {
        if replayed.run.film.frame.is_some() {
            replayed.is_frozen[2] = true;
        }
        replayed.act().expect("it is not asked yet");
    }
    let error = replayed.act().expect_err("it is not asked again");
    assert_eq!(error.to_string(), "recorded frame 5: no answer in time");
}

#[test]
fn a_world_that_another_follows_goes_on_in_the_same_film() {
    let mut reset = Scripted::new(settings(), films(31));
    reset.commands = [(60, Command::Reset)].into();
    reset.go().expect("it goes on");
    assert_eq!(reset.frames(), every_frame(120), "film is not turned back");
    assert_eq!(reset.run.world.steps(), 60);
    let first = run(RunSettings { seconds: Some(0.5), ..settings() }, films(31));
    assert_eq!(reset.digest(), first.digest(), "the person stands still: both worlds see the same");
}

#[test]
fn nodes_learn_the_shapes_of_new_bodies_that_move() {
    let run = Scripted::new(settings(), vec![]).run;
    let spec = run.world.scene().bodies(1)[0].clone();
    let spawn = |name: &str, fixed| {
        Command::Spawn(Box::new(BodySpec { name: name.to_owned(), fixed, ..spec.clone() }))
    };
    let shapes =
        |command: &Command| run.shapes(&run.prepare(command).expect("it can be done")).map(|all| all.len());
    let known = shapes(&Command::Reset).expect("those of the scene");
    assert_eq!(shapes(&spawn("same", false)), Some(known), "the same shape is sent once");
    assert_eq!(shapes(&spawn("fixed", true)), Some(known));
    assert_eq!(shapes(&Command::Pause), None);
    let error = run.prepare(&spawn("box", false)).err().expect("the name is taken").to_string();
    assert!(error.contains("name"), "{error}");
}

#[test]
fn a_live_world_whose_steps_take_too_long_is_given_up_and_others_are_not() {
    for (lock_step, gives_up) in [(false, true), (true, false)] {
        let mut slow = Scripted::new(RunSettings { lock_step, ..settings() }, films(31));
        (0..3).for_each(|_| slow.run.budget.note(1.0));
        let clock = Rc::clone(&slow.now_s);
        let clocks = || Now { monotonic_s: clock.get(), unix_s: 0.0 };
        let action = loop {
            match slow.run.next(&mut slow.roster, &clocks).expect("it goes on") {
                Action::TakeOrders => {}
                Action::Wait { at_most_s } => slow.wait(at_most_s),
                action => break action,
            }
        };
        assert_eq!(matches!(action, Action::StartAfresh), gives_up, "{action:?}");
    }
}

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
