//! A run that is steered while it goes on: over every layout, from orders and from a record.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use camera_node::service::{Access, Node};
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use coordinator::hooks::{EndRecord, FrameRecord, Recorder, Schedule, Scheduled, Sees, StepRecord};
use coordinator::live::{
    Client, ClientKind, Command, Follower, MAX_WAITING, Outcome, Parameters, Refusal, WorldState, live,
};
use coordinator::{
    AskEvery, Coordinator, Figures, LocalFrames as _, Placement, Progress, RunSettings, Snapshot, Transport,
    Watcher,
};
use film_time::BackgroundFilm;
use hull::{Observer, ProbeSettings, Rig};
use node_client::Agreement;
use proto::Address;
use segment::SegmentSettings;
use setup::{InProcess, expected_node};
use sim::{BodyRequest, BodyResponse, BodySnapshot, Scene, World, WorldSettings, WorldSnapshot};
use stage::{Motion, Prop};
use testkit::{Watch, timely};

const FPS: f64 = 30.0;
const TIMEOUT: Duration = Duration::from_secs(60);

/// Cameras in a small studio, and what is to happen there.
struct Studio {
    rig: Rig,
    stage: StageConfig,
    seconds: f64,
    lock_step: bool,
}

impl Studio {
    fn new(motion: Motion, seconds: f64) -> Studio {
        let stage = StageConfig { motion, ..StageConfig::default() };
        Studio { rig: stage::studio_rig(4, (160, 120)).expect("a rig"), stage, seconds, lock_step: true }
    }

    fn config(&self, cameras: std::ops::Range<usize>) -> NodeConfig {
        let camera = |index: usize| NodeCamera {
            camera: self.rig.cameras()[index].clone(),
            rig_index: index as u16,
            source: SourceConfig::Stage(self.stage.clone()),
            background: None,
            segmentation: SegmentSettings::default(),
            ignored: None,
        };
        NodeConfig { cameras: cameras.map(camera).collect(), settings: ProbeSettings::default(), fps: FPS }
    }

    fn in_process(&self) -> Transport {
        Transport::in_process(Box::new(InProcess::prepare(&self.config(0..4)).expect("films")))
    }

    /// Two nodes of two cameras each, served in this process.
    async fn over(&self, layout: &str, world: &World) -> Transport {
        if layout == "inprocess" {
            return self.in_process();
        }
        let mut nodes = vec![];
        for cameras in [0..2, 2..4] {
            let listen = SocketAddr::from(([127, 0, 0, 1], 0));
            let node =
                Node::open(self.config(cameras.clone()), listen, Access::default()).await.expect("opens");
            let address: Address = node.address().expect("bound").to_string().parse().expect("an address");
            tokio::spawn(node.serve(std::future::pending()));
            nodes.push(expected_node(&self.rig, address, &cameras.collect::<Vec<_>>()));
        }
        let shapes = world.moving_bodies().map(|body| Arc::clone(&body.shape)).collect();
        let placement = match layout {
            "gather" => Placement::Here(self.observers()),
            _ => Placement::Nodes,
        };
        Transport::connect(nodes, placement, Agreement::new(ProbeSettings::default(), FPS, shapes))
    }

    fn observers(&self) -> Vec<Arc<Observer>> {
        self.config(0..4).observers()
    }

    fn world(&self) -> World {
        let scene = Scene::from_toml("steered", SCENE).expect("a scene");
        World::new(&scene, WorldSettings::default()).expect("a world")
    }

    fn coordinator(&self, transport: Transport) -> Coordinator {
        let settings = RunSettings {
            probes: ProbeSettings::default(),
            fps: FPS,
            latency_s: Some(0.3),
            hold_s: 0.0,
            going_on: coordinator::GoingOn::default(),
            seconds: Some(self.seconds),
            lock_step: self.lock_step,
            ask_every: AskEvery::Frame,
            reuse_within_m: 0.0,
            connect_timeout: TIMEOUT,
        };
        Coordinator::new(transport, self.world(), self.observers(), settings)
    }
}

const SCENE: &str = "
    [[bodies]]
    name = 'box'
    shape.box.size = [0.2, 0.2, 0.2]
    count = 3
    place.stack.foot = [0.6, 0.0, 0.3]";

struct Quiet;

impl Watcher for Quiet {
    fn progress(&mut self, _: &Progress) {}

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

/// What was kept of a run.
#[derive(Clone, Debug, Default, PartialEq)]
struct Kept {
    steps: Vec<Scheduled>,
    digests: Vec<String>,
    generations: Vec<u32>,
    touches: usize,
    /// Foreground pixels of all cameras, by frame.
    areas: Vec<(u64, u64)>,
    ended: bool,
}

struct Keeper(Arc<Mutex<Kept>>);

impl Recorder for Keeper {
    fn frame(&mut self, record: FrameRecord<'_>) {
        let areas = record.reports.iter().flat_map(|report| &report.cameras).map(|camera| camera.area);
        self.0.lock().expect("whole").areas.push((record.frame, areas.sum()));
    }

    fn step(&mut self, record: &StepRecord<'_>) {
        let mut kept = self.0.lock().expect("whole");
        let sees = Sees::Recorded { film_s: record.film_s, frame: record.frame };
        kept.steps.push(Scheduled { commands: record.commands.to_vec(), sees });
        kept.digests.push(record.world.digest().to_string());
        kept.generations.push(record.generation);
        kept.touches += record.responses.iter().map(|response| response.inside_samples).sum::<usize>();
    }

    fn end(&mut self, record: &EndRecord<'_>) {
        assert!(record.figures.counts.steps > 0);
        self.0.lock().expect("whole").ended = true;
    }
}

/// What to do, by the number of steps made before.
struct Plan<F>(u64, F);

impl<F: Fn(u64) -> Vec<Command> + Send> Schedule for Plan<F> {
    fn next(&mut self) -> Option<Scheduled> {
        self.0 += 1;
        Some(Scheduled { commands: self.1(self.0 - 1), sees: Sees::Film })
    }

    fn begin_again(&mut self) {
        self.0 = 0;
    }
}

/// The steps of a record, and how many were made.
struct Again(Vec<Scheduled>, usize);

impl Schedule for Again {
    fn next(&mut self) -> Option<Scheduled> {
        self.1 += 1;
        self.0.get(self.1 - 1).cloned()
    }

    fn begin_again(&mut self) {
        self.1 = 0;
    }
}

fn spawned(text: &str) -> Command {
    let request: BodyRequest = toml::from_str(text).expect("the keys of a request");
    Command::Spawn(Box::new(request.check().expect("a body")))
}

/// A ball and a hull fall on the person, a box is dragged into him and thrown, one goes; then all over again.
fn acts(step: u64) -> Vec<Command> {
    match step {
        10 => vec![
            spawned("shape.ball.radius = 0.12\nposition = [0.02, 1.9, 0.02]"),
            spawned(
                "shape.capsule = { radius = 0.08, length = 0.3 }\nposition = [0.1, 1.2, 0.5]\nvelocity = [0, 1, -2]",
            ),
        ],
        30 => vec![Command::Grab { body: 2, grip_body_m: [0.1, 0.0, 0.0], target_m: [0.1, 1.1, 0.1] }],
        60 => vec![
            Command::Release { body: 2, velocity_m_s: Some([0.0, 1.0, 2.0]) },
            Command::Remove(3),
            Command::Push { body: 0, impulse_n_s: [-1.0, 0.5, -0.3], at_m: None },
        ],
        80 => vec![Command::Set(Parameters { hull_restitution: Some(1.0), ..Parameters::default() })],
        100 => vec![Command::Reset, spawned("shape.ball.radius = 0.2\nposition = [0, 2, 0]")],
        _ => vec![],
    }
}

async fn play(studio: &Studio, layout: &str, schedule: Box<dyn Schedule>) -> (Kept, Figures, World) {
    let transport = studio.over(layout, &studio.world()).await;
    let kept = Arc::new(Mutex::new(Kept::default()));
    let coordinator = studio
        .coordinator(transport)
        .with_recorder(Box::new(Keeper(Arc::clone(&kept))))
        .with_schedule(schedule);
    let (figures, world) = coordinator.run(&mut Quiet, std::future::pending()).await.expect("runs");
    let kept = kept.lock().expect("whole").clone();
    (kept, figures, world)
}

#[tokio::test]
async fn commands_at_the_same_steps_are_the_same_run_over_every_layout_and_from_its_record() {
    let studio = Studio::new(Motion::Wave, 1.5);
    let (first, figures, world) = play(&studio, "inprocess", Box::new(Plan(0, acts))).await;
    assert!(first.ended && figures.counts.steps == 180, "{}", figures.counts.steps);
    assert_eq!((first.generations[99], first.generations[100], world.steps()), (0, 1, 80));
    assert!(first.touches > 100, "bodies meet the person: {}", first.touches);
    assert_eq!(world.bodies().len(), 4);
    for layout in ["gather", "cluster"] {
        let (kept, ..) = play(&studio, layout, Box::new(Plan(0, acts))).await;
        assert_eq!(kept.digests, first.digests, "{layout}");
        assert_eq!(kept.steps, first.steps, "{layout}");
    }
    let again = Again(first.steps.clone(), 0);
    let (kept, _, end) = play(&studio, "cluster", Box::new(again)).await;
    assert_eq!((&kept.digests, &kept.steps), (&first.digests, &first.steps));
    assert_eq!(end.digest(), world.digest());
    let (other, ..) = play(&studio, "inprocess", Box::new(Plan(1, acts))).await;
    assert_ne!(other.digests, first.digests, "a step earlier is another run");
}

#[tokio::test]
async fn a_world_goes_on_from_an_earlier_run_and_film_starts_over_over_every_layout_and_from_a_record() {
    let studio = Studio::new(Motion::Wave, 0.5);
    let mut earlier = studio.world();
    earlier.remove(1).expect("gone");
    earlier.push(2, [0.2, 1.0, 0.0], None).expect("pushed");
    for _ in 0..250 {
        let responses = vec![BodyResponse::UNTOUCHED; earlier.moving_bodies().len()];
        earlier.step(&responses).expect("a step");
    }
    let kept = earlier.snapshot();
    let goes_on = move |step: u64| match step {
        0 => vec![Command::GoOn(Box::new(kept.clone()))],
        _ => vec![],
    };
    let (first, figures, world) = play(&studio, "inprocess", Box::new(Plan(0, goes_on.clone()))).await;
    assert_eq!((figures.counts.steps, world.steps(), figures.frames_expected), (60, 310, 16));
    for (step, film_frame) in [(0, 0), (3, 1), (59, 15)] {
        let Sees::Recorded { film_s, frame } = first.steps[step].sees else { panic!("as it was kept") };
        assert!((film_s - (step + 1) as f64 / 120.0).abs() < 1e-9, "step {step} at {film_s} s");
        assert_eq!(frame, Some(film_frame));
    }
    let ids: Vec<u32> = world.bodies().iter().map(|body| body.id).collect();
    assert_eq!((ids, first.generations[0]), (vec![0, 2], 1));
    let (cluster, ..) = play(&studio, "cluster", Box::new(Plan(0, goes_on))).await;
    let (again, ..) = play(&studio, "inprocess", Box::new(Again(first.steps.clone(), 0))).await;
    assert_eq!((&cluster.digests, &again.digests), (&first.digests, &first.digests));
}

/// The world once it is as asked.
async fn seen(follower: &mut Follower, is_it: impl Fn(&WorldState) -> bool) -> Arc<WorldState> {
    let found = follower.world.wait_for(|world| world.as_deref().is_some_and(&is_it));
    let found = tokio::time::timeout(TIMEOUT, found).await.expect("in time").expect("the run goes on");
    found.clone().expect("a world")
}

#[tokio::test]
async fn a_run_is_paused_stepped_changed_and_begun_again_by_those_who_follow_it() {
    let studio = Studio::new(Motion::Idle, 1000.0);
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        seen(&mut follower, |world| world.step > 5).await;
        follower.order(Command::Pause).await.expect("paused");
        let paused = seen(&mut follower, |world| world.paused).await;
        let spawn = spawned("shape.ball.radius = 0.1\nposition = [1, 1, 1]\nname = 'mine'");
        assert_eq!(follower.order(spawn.clone()).await.expect("spawned"), Outcome::Spawned(3));
        let refused = follower.order(spawn).await.expect_err("the name is taken");
        assert_eq!(refused.to_string(), "name: `mine`, expected one that no body has");
        let scene = follower.scene.borrow().clone().expect("a scene");
        assert_eq!((scene.generation, scene.bodies.len(), &scene.bodies[3].name[..]), (0, 4, "mine"));
        let spawned = seen(&mut follower, |world| world.bodies.len() == 4).await;
        assert_eq!((spawned.step, spawned.paused), (paused.step, true), "seen before a step is made");
        follower.order(Command::Step(7)).await.expect("counted");
        let stepped = seen(&mut follower, |world| world.paused && world.step > paused.step).await;
        assert_eq!(stepped.step, paused.step + 7);
        assert!(stepped.bodies[3].pose.position_m()[1] < 1.0, "it falls");
        follower.order(Command::Remove(3)).await.expect("gone");
        assert_eq!(
            follower.order(Command::Remove(3)).await.expect_err("twice").to_string(),
            "there is no body 3"
        );
        follower.order(Command::Reset).await.expect("again");
        let again = seen(&mut follower, |world| world.generation == 1).await;
        assert_eq!((again.step, again.bodies.len(), again.paused), (0, 3, true));
        follower.order(Command::Choose(Scene::named("crowd").expect("shipped"))).await.expect("chosen");
        assert_eq!(follower.scene.borrow().clone().expect("a scene").scene, "crowd");
        follower.order(Command::Resume).await.expect("resumed");
        let on = seen(&mut follower, |world| world.generation == 2 && world.step > 20).await;
        assert!(
            on.bodies.len() == 40 && on.film_s > stepped.film_s && on.frame > stepped.frame,
            "film goes on"
        );
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    let (_, world) = ran.expect("runs");
    assert_eq!(world.scene().name(), "crowd");
    assert!(follower.order(Command::Pause).await.is_err(), "it is over");
}

#[tokio::test]
async fn a_body_is_held_by_one_client_until_that_one_releases_it_or_is_gone() {
    let studio = Studio::new(Motion::Idle, 1000.0);
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        let [page, other] = [(); 2].map(|()| follower.for_client(Client::new(ClientKind::Page)));
        let grab =
            |height_m| Command::Grab { body: 2, grip_body_m: [0.0; 3], target_m: [0.6, height_m, 0.6] };
        let throw = Command::Release { body: 2, velocity_m_s: Some([0.0, 9.0, 0.0]) };
        let is_held = |world: &WorldState| world.bodies[2].grabbed;
        page.order(grab(1.2)).await.expect("held");
        page.order(grab(1.3)).await.expect("held on");
        seen(&mut follower, is_held).await;
        let name = follower.scene.borrow().clone().expect("a scene").bodies[2].name.clone();
        for command in [grab(0.5), throw.clone()] {
            let refused = other.order(command.clone()).await.expect_err("held").to_string();
            assert_eq!(refused, format!("body `{name}` is held by another page"));
            let refused = follower.order(command).await.expect_err("held").to_string();
            assert_eq!(refused, format!("body `{name}` is held by a page"));
        }
        page.order(throw).await.expect("thrown");
        other.order(grab(1.0)).await.expect("it is free");
        drop(other);
        seen(&mut follower, |world| !is_held(world)).await;
        page.order(grab(1.0)).await.expect("it is free again");
        // Also while the world stands.
        follower.order(Command::Pause).await.expect("paused");
        drop(page);
        seen(&mut follower, |world| world.paused && !is_held(world)).await;
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    ran.expect("runs");
}

#[tokio::test]
async fn what_a_command_took_away_comes_back_by_the_command_that_it_is_answered_with() {
    let studio = Studio::new(Motion::Idle, 1000.0);
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        seen(&mut follower, |world| world.step > 5).await;
        follower.order(Command::Pause).await.expect("paused");
        let before = seen(&mut follower, |world| world.paused).await;
        let undo = async |follower: &Follower, command: Command| {
            let Outcome::Revocable(back) = follower.order(command).await.expect("done") else {
                panic!("it can be undone")
            };
            *back
        };
        let back = undo(&follower, Command::Remove(1)).await;
        let two = seen(&mut follower, |world| world.bodies.len() == 2).await;
        assert_eq!(two.step, before.step);
        let spawned = follower.order(back).await.expect("it comes back");
        assert_eq!(spawned, Outcome::Spawned(3));
        let three = seen(&mut follower, |world| world.bodies.len() == 3).await;
        let (was, is) = (&before.bodies[1], &three.bodies[2]);
        assert_eq!((is.pose.position_m(), is.velocity_m_s), (was.pose.position_m(), was.velocity_m_s));
        let names = |follower: &Follower| {
            let scene = follower.scene.borrow().clone().expect("a scene");
            scene.bodies.iter().map(|body| body.name.clone()).collect::<std::collections::BTreeSet<_>>()
        };
        let known = names(&follower);
        let back = undo(&follower, Command::Reset).await;
        seen(&mut follower, |world| world.generation == 1 && world.step == 0).await;
        follower.order(back).await.expect("the world comes back");
        let again = seen(&mut follower, |world| world.generation == 2).await;
        // Rotations are brought to length one again.
        let places =
            |world: &WorldState| world.bodies.iter().map(|body| body.pose.position_m()).collect::<Vec<_>>();
        assert_eq!((again.step, places(&again)), (before.step, places(&three)));
        assert_eq!(names(&follower), known);
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    ran.expect("runs");
}

/// A world of the studio's scene with these bodies instead of its own, each as fast as `velocity_m_s` says of its place.
fn world_with(studio: &Studio, bodies: &str, velocity_m_s: impl Fn([f64; 3]) -> [f64; 3]) -> Command {
    let scene = Scene::from_toml("heap", bodies).expect("a scene");
    let begun = studio.world();
    let mut kept = vec![];
    for (id, mut spec) in scene.bodies(1).into_iter().enumerate() {
        spec.velocity_m_s = velocity_m_s(spec.pose.position_m());
        kept.push(BodySnapshot { id: id as u32, spec, spin_rad_s: [0.0; 3] });
    }
    let next_id = kept.len() as u32;
    let world = WorldSnapshot::new(begun.scene().clone(), begun.parameters(), 0, next_id, kept);
    Command::GoOn(Box::new(world.expect("possible")))
}

/// Runs a live studio that gets a command, until its world is given up and steps again.
async fn given_up(bodies: &str, velocity_m_s: impl Fn([f64; 3]) -> [f64; 3]) {
    let studio = Studio { lock_step: false, ..Studio::new(Motion::Idle, 1000.0) };
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let command = world_with(&studio, bodies, velocity_m_s);
    let steer = async {
        let _watching = follower.watch();
        seen(&mut follower, |world| world.step > 5).await;
        follower.order(command).await.expect("within the limits");
        let afresh = seen(&mut follower, |world| world.generation == 2 && world.step > 5).await;
        assert_eq!(afresh.bodies.len(), 3, "the scene's own");
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    ran.expect("runs");
}

#[tokio::test]
async fn a_world_whose_bodies_fly_to_one_place_starts_afresh_before_they_meet() {
    let row = |index: usize| {
        let x = 0.03 * index as f64;
        format!(
            "[[bodies]]\nname = 'b{index}'\nshape.box.size = [0.027, 0.027, 0.027]\nplace.at = [{x}, 5, 0]\n"
        )
    };
    let row: String = (0..200).map(row).collect();
    given_up(&row, |[x, ..]| [(3.0 - x) * 120.0, 0.0, 0.0]).await;
}

#[tokio::test]
async fn a_world_whose_steps_take_seconds_starts_afresh() {
    // A hundred balls of 256 corners at one place: as many pairs as a world may have, of the slowest kind.
    let corner = |index: usize| {
        let (y, turn) = (1.0 - (index as f64 + 0.5) / 128.0, index as f64 * 2.4);
        let level = (1.0 - y * y).sqrt();
        [level * libm::cos(turn), y, level * libm::sin(turn)].map(|part| 0.15 * part)
    };
    let corners: Vec<[f64; 3]> = (0..256).map(corner).collect();
    let body = |index| {
        format!("[[bodies]]\nname = 'b{index}'\nshape.hull.points = {corners:?}\nplace.at = [0, 5, 0]\n")
    };
    let heap: String = (0..100).map(body).collect();
    given_up(&heap, |_| [0.0; 3]).await;
}

#[tokio::test]
async fn a_reset_is_done_at_once_while_steps_are_slow_and_hundreds_of_commands_wait() {
    let studio = Studio { lock_step: false, ..Studio::new(Motion::Idle, 1000.0) };
    let (live, mut follower) = live();
    // Three bodies: a step takes 0.3 s.
    let slow = |_: &mut BodyResponse| std::thread::sleep(Duration::from_millis(100));
    let coordinator = studio.coordinator(studio.in_process()).with_live(live).with_altered(slow);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        let before = seen(&mut follower, |world| world.step > 2).await;
        let spawn = spawned("shape.ball.radius = 0.1\nposition = [1, 1, 1]");
        let spawns = (0..MAX_WAITING + 40).map(|_| follower.order(spawn.clone()));
        let (answers, reset) =
            tokio::join!(futures::future::join_all(spawns), follower.order(Command::Reset));
        reset.expect("it has room, and is done");
        let is = |expected: fn(&Refusal) -> bool| {
            answers.iter().filter(|answer| answer.as_ref().is_err_and(expected)).count()
        };
        let superseded = is(|why| matches!(why, Refusal::Superseded));
        assert_eq!((superseded, is(|why| matches!(why, Refusal::Busy))), (MAX_WAITING, 40));
        let world = follower.world.borrow().clone().expect("a world");
        assert_eq!((world.generation, world.bodies.len()), (1, 3));
        assert!(
            before.step + world.step < 10,
            "steps {} and {}: it waited for many",
            before.step,
            world.step
        );
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    let (figures, _) = ran.expect("runs");
    assert!(figures.counts.steps < 10, "{} steps", figures.counts.steps);
}

#[tokio::test]
async fn steps_out_of_a_pause_see_the_frame_at_which_a_live_run_was_paused() {
    let watch = Watch::start();
    let studio = Studio { lock_step: false, ..Studio::new(Motion::Idle, 1000.0) };
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        seen(&mut follower, |world| world.step > 5 && world.frame.is_some()).await;
        follower.order(Command::Pause).await.expect("paused");
        let paused = seen(&mut follower, |world| world.paused).await;
        // Longer than a ring of frames lasts.
        tokio::time::sleep(Duration::from_millis(1500)).await;
        for steps in [1, 3] {
            let before = follower.world.borrow().clone().expect("a world").step;
            follower.order(Command::Step(steps)).await.expect("counted");
            let stepped =
                seen(&mut follower, |world| world.paused && world.step == before + u64::from(steps)).await;
            assert_eq!(stepped.frame, paused.frame, "the person stands still");
        }
        follower.order(Command::Resume).await.expect("resumed");
        seen(&mut follower, |world| world.frame > paused.frame.map(|frame| frame + 30)).await;
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    let (figures, _) = ran.expect("runs");
    // The pause alone was 45 frames; a busy machine's lag is expected film.
    let lag = figures.counts.slipped_s * FPS;
    let expected = figures.frames_expected as f64 - lag;
    timely!(
        watch,
        expected < figures.counts.frames as f64 + 30.0,
        "film that no step wanted is not expected: {expected}"
    );
}

#[tokio::test]
async fn film_goes_by_while_a_live_run_is_paused_and_nothing_counts_as_missed() {
    let watch = Watch::start();
    let studio = Studio { lock_step: false, ..Studio::new(Motion::Idle, 1000.0) };
    let (live, mut follower) = live();
    let coordinator = studio.coordinator(studio.in_process()).with_live(live);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let mut quiet = Quiet;
    let run = coordinator.run(&mut quiet, async { drop(stopped.await) });
    let steer = async {
        let _watching = follower.watch();
        seen(&mut follower, |world| world.step > 5).await;
        follower.order(Command::Pause).await.expect("paused");
        let before = seen(&mut follower, |world| world.paused).await;
        tokio::time::sleep(Duration::from_millis(1500)).await;
        follower.order(Command::Resume).await.expect("resumed");
        let after = seen(&mut follower, |world| world.step > before.step).await;
        assert!(after.film_s - before.film_s > 1.2, "{} {}", before.film_s, after.film_s);
        assert!(after.step - before.step < 60, "steps are not made good");
        drop(stop);
    };
    let (ran, ()) = tokio::join!(run, steer);
    let (figures, _) = ran.expect("runs");
    let missed = figures.frames_missed();
    timely!(watch, missed < 30, "a second and a half of film went by on purpose, not {missed} frames missed");
}

#[tokio::test]
async fn a_background_with_a_person_is_taken_on_request_alone_and_can_be_undone() {
    for layout in ["cluster", "inprocess"] {
        take_background_with_a_person(layout).await;
    }
}

async fn take_background_with_a_person(layout: &str) {
    let mut studio = Studio::new(Motion::Idle, 7.0);
    studio.stage.props = vec![Prop::Table];
    let world = studio.world();
    let (live, mut follower) = live();
    let kept = Arc::new(Mutex::new(Kept::default()));
    let coordinator = studio
        .coordinator(studio.over(layout, &world).await)
        .with_live(live)
        .with_recorder(Box::new(Keeper(Arc::clone(&kept))));
    let take = |seconds, allow_foreground| Command::TakeBackground { seconds, allow_foreground };
    let ordered = async {
        let _watching = follower.watch();
        let error = follower.order(take(60.0, false)).await.expect_err("too long");
        assert_eq!(error.to_string(), "a background of 60 s, expected 0.2 to 30 s");
        let refused = follower.order(take(1.0, false)).await.expect_err("not empty").to_string();
        let says = |part: &str| refused.contains(part);
        assert!(says("keeps its background: ") && says("foreground, expected an empty room"), "{refused}");
        let refused_s = seen(&mut follower, |_| true).await.film_s;
        let taken = follower.order(take(1.0, true)).await.expect("taken");
        let Outcome::Revocable(undo) = taken else { panic!("{taken:?} cannot be undone") };
        let taken_s = seen(&mut follower, |_| true).await.film_s;
        seen(&mut follower, |world| world.film_s > taken_s + 0.5).await;
        assert_eq!(follower.order(*undo).await.expect("undone"), Outcome::Applied);
        (refused_s, taken_s)
    };
    let mut quiet = Quiet;
    let (ran, (refused_s, taken_s)) =
        tokio::join!(coordinator.run(&mut quiet, std::future::pending()), ordered);
    ran.expect("runs");
    let areas = kept.lock().expect("whole").areas.clone();
    let (first, last) = (areas[1].1, areas[areas.len() - 1].1);
    assert!(first > 1000, "the person and the table are seen: {areas:?}");
    let at = |film_s: f64| (film_s * FPS) as u64;
    let mut after_refusal = areas.iter().filter(|(frame, _)| (2..at(refused_s) + 10).contains(frame));
    assert!(after_refusal.all(|(_, area)| 2 * area > first), "the old one stays: {areas:?}");
    let mut taken = areas.iter().filter(|(frame, _)| (at(taken_s) + 5..at(taken_s) + 10).contains(frame));
    assert!(taken.all(|(_, area)| *area < first / 10), "no person is seen any more: {areas:?}");
    assert!(2 * last > first, "the person is back: {areas:?}");
}

#[tokio::test]
async fn cameras_without_a_background_say_so_and_none_of_the_others_learns() {
    let studio = Studio::new(Motion::Idle, 0.3);
    let mut config = studio.config(0..4);
    config.cameras[2].segmentation.method = segment::Method::Chroma;
    let cameras = InProcess::prepare(&config).expect("films");
    let film = BackgroundFilm { id: 1, first_frame: 1, frames: 30, allow_foreground: true };
    let refused = cameras.take_background(film).await.expect_err("refused");
    assert_eq!(refused.to_string(), "camera \"cam_2\" learns no background: it is keyed by colour");
}
