//! Runs over nodes that follow a script: no node, no socket, no thread, and no clock but a number.

mod playback;

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
use crate::core::command::Command;
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
