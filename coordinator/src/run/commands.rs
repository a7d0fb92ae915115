//! What others ask of a run: taken between steps, done before the next.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use film_time::BACKGROUND_S;
use hull::Shape;
use sim::World;
use tokio::time::timeout;

use super::now;
use super::watch::{REPORT_EVERY, Watcher};
use super::{Coordinator, FRAMES_AHEAD, RunError};
use crate::core::budget::StepBudget;
use crate::core::clock::frame_at;
use crate::live::{Command, MAX_STEPS, MAX_WAITING, Order, Outcome, RESETS_BEYOND, Refusal};
use crate::query::QueryBody;
use crate::transport::FirstFrame;

/// Commands between two steps that a recording keeps.
const MAX_KEPT: usize = 10_000;
/// A node that does not take new shapes within this time receives them when it first misses one.
const REGISTER_TIMEOUT: Duration = Duration::from_millis(500);
/// From a message to the cameras until all have received it, seconds.
const MESSAGE_S: f64 = 0.25;

/// Whether steps are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Steering {
    /// Step after step.
    #[default]
    Running,
    /// So many steps more.
    Counting {
        left: u64,
        /// They see the frame at which the run was paused: a viewer steps through a moment.
        is_frozen: bool,
    },
    /// No steps until a command.
    Paused,
}

impl Steering {
    pub fn is_paused(self) -> bool {
        self == Steering::Paused
    }

    pub fn is_frozen(self) -> bool {
        matches!(self, Steering::Counting { is_frozen: true, .. })
    }

    /// A step was made.
    pub fn count(&mut self) {
        if let Steering::Counting { left, .. } = self {
            *left -= 1;
            if *left == 0 {
                *self = Steering::Paused;
            }
        }
    }
}

impl Coordinator {
    /// Does what is asked by now, as much of it as may wait between two steps.
    pub(super) async fn take_orders(&mut self) {
        for _ in 0..MAX_WAITING {
            // Before each: one may take as long as a node needs for a shape, and a reset is not to wait for all of them.
            self.receive_orders();
            let Some(order) = self.commands.waiting.pop_front() else { break };
            self.take(order).await;
        }
    }

    /// Receives what was asked since, and refuses what a later reset undoes.
    fn receive_orders(&mut self) {
        let Some(live) = &mut self.publisher.live else { return };
        // The follower of an order may have gone.
        let refuse = |order: Order, why| drop(order.reply.send(Err(why)));
        for order in (0..MAX_WAITING + RESETS_BEYOND).map_while(|_| live.orders.try_recv().ok()) {
            let beyond = if order.command == Command::Reset { RESETS_BEYOND } else { 0 };
            if self.commands.waiting.len() < MAX_WAITING + beyond {
                self.commands.waiting.push_back(order);
            } else {
                refuse(order, Refusal::Busy);
            }
        }
        take_superseded(&mut self.commands.waiting)
            .into_iter()
            .for_each(|order| refuse(order, Refusal::Superseded));
    }

    /// While paused: waits for an order, not for long, and lets film go by; false if the run's time is over.
    pub(super) async fn rest(&mut self, watcher: &mut dyn Watcher) -> bool {
        let Coordinator { transport, publisher, .. } = self;
        let patience = if self.commands.waiting.is_empty() { REPORT_EVERY } else { Duration::ZERO };
        let order = async {
            let live = publisher.live.as_mut()?;
            loop {
                tokio::select! {
                    order = live.orders.recv() => break order,
                    () = transport.next() => {}
                }
            }
        };
        match timeout(patience, order).await {
            Ok(Some(order)) => self.commands.waiting.push_back(order),
            // No viewer is left that could resume.
            Ok(None) => self.commands.steering = Steering::Running,
            Err(_) => {}
        }
        self.take_orders().await;
        self.let_film_pass();
        self.report(watcher, None);
        !self.is_over(self.film_s())
    }

    /// Film that came since the last step was due is passed over.
    fn let_film_pass(&mut self) {
        if self.settings.lock_step {
            return;
        }
        match self.scheduled_film_s() {
            Some(film_s) => self.clock.shift(film_s, now()),
            None => {
                let before = frame_at(self.film_s(), self.settings.fps);
                self.clock.pass(self.film_s(), now());
                self.film.frames_passed += frame_at(self.film_s(), self.settings.fps) - before;
            }
        }
    }

    async fn take(&mut self, order: Order) {
        let Order { command, reply } = order;
        if let (Command::TakeBackground { seconds }, None) = (&command, &self.script.schedule) {
            let taken = self.take_background(*seconds);
            // Steps go on while the nodes answer.
            tokio::spawn(async move { reply.send(taken.await.map(|()| Outcome::Applied)) });
            return;
        }
        let steers = matches!(command, Command::Pause | Command::Resume | Command::Step(_));
        let outcome = if self.script.schedule.is_some() && !steers {
            Err(Refusal::Replay)
        } else {
            self.carry_out(command).await
        };
        // The follower may have gone.
        let _ = reply.send(outcome);
        self.publish_world();
    }

    /// Does one thing, and keeps it for the record.
    pub(super) async fn carry_out(&mut self, command: Command) -> Result<Outcome, Refusal> {
        let is_kept = self.log.recorder.is_some() && command.changes_world();
        if is_kept && self.log.commands.len() == MAX_KEPT {
            return Err(Refusal::TooManyCommands { limit: MAX_KEPT });
        }
        let outcome = self.apply_command(&command).await?;
        if is_kept {
            keep(&mut self.log.commands, command);
        }
        Ok(outcome)
    }

    async fn apply_command(&mut self, command: &Command) -> Result<Outcome, Refusal> {
        match *command {
            Command::Pause => self.commands.steering = Steering::Paused,
            Command::Resume => self.commands.steering = Steering::Running,
            Command::Step(steps) => self.count_steps(steps)?,
            Command::Reset => self.begin_world(self.world.again()?).await?,
            Command::Choose(ref scene) => {
                let scene = scene.clone().with_gravity(self.world.scene().gravity_m_s2())?;
                self.begin_world(self.world.with_scene(&scene)?).await?;
            }
            Command::GoOn(ref from) => self.begin_world(self.world.going_on(from)?).await?,
            Command::Spawn(ref spec) => {
                let prepared = self.world.prepare((**spec).clone())?;
                let bodies = self.world.moving_bodies().flat_map(sim::Body::asked_shapes);
                let new = prepared.asked_shapes().filter(|_| !spec.fixed);
                let shapes = bodies.chain(new).collect();
                self.register(shapes).await?;
                let id = self.world.spawn(prepared)?;
                self.bodies_changed();
                return Ok(Outcome::Spawned(id));
            }
            Command::Remove(body) => {
                self.world.remove(body)?;
                self.bodies_changed();
            }
            Command::Push { body, impulse_n_s, at_m } => {
                self.world.push(body, impulse_n_s, at_m)?;
            }
            Command::Grab { body, grip_body_m, target_m } => {
                self.world.grab(body, grip_body_m, target_m)?;
            }
            Command::Release { body, velocity_m_s } => {
                self.world.release(body, velocity_m_s)?;
            }
            Command::Set(parameters) => {
                self.world.set(parameters)?;
                self.publish_scene();
            }
            Command::TakeBackground { seconds } => self.take_background(seconds).await?,
        }
        Ok(Outcome::Applied)
    }

    fn count_steps(&mut self, steps: u32) -> Result<(), Refusal> {
        if !(1..=MAX_STEPS).contains(&steps) {
            return Err(Refusal::Steps { found: steps });
        }
        let (left, is_frozen) = match self.commands.steering {
            Steering::Counting { left, is_frozen } => (left, is_frozen),
            // In lock-step film has waited.
            Steering::Paused => (0, !self.settings.lock_step),
            Steering::Running => (0, false),
        };
        let left = (left + u64::from(steps)).min(MAX_STEPS.into());
        self.commands.steering = Steering::Counting { left, is_frozen };
        Ok(())
    }

    /// Puts a new world in the place of the old; film goes on from where it is.
    async fn begin_world(&mut self, world: World) -> Result<(), Refusal> {
        let shapes = world.moving_bodies().flat_map(sim::Body::asked_shapes).collect();
        self.register(shapes).await?;
        self.replace_world(world);
        Ok(())
    }

    /// The same, once its shapes are on their way to the nodes.
    fn replace_world(&mut self, world: World) {
        // A world that goes on has a time of its own already, of which this film is not.
        self.clock.passed_s += self.world.time_s() - world.time_s();
        self.settings.reuse_within_m = world.scene().hull().reuse_within_m;
        self.world = world;
        self.budget = StepBudget::default();
        self.publisher.generation += 1;
        self.publisher.view.forget_bodies();
        self.bodies_changed();
    }

    /// Live: gives up a world whose steps take far too long. Others have no deadline, and are to be the same on any machine.
    pub(super) async fn give_up_slow_world(&mut self) -> Result<(), RunError> {
        if !self.budget.is_exhausted() || self.settings.lock_step || self.script.schedule.is_some() {
            return Ok(());
        }
        self.start_afresh("the solver takes over 0.1 s a step").await
    }

    /// Puts the scene's start in the place of a world whose steps cannot be made: whatever made it so, the room goes on.
    pub(super) async fn start_afresh(&mut self, why: &str) -> Result<(), RunError> {
        tracing::error!(
            "the world is given up, its scene {:?} starts afresh: {why}",
            self.world.scene().name()
        );
        let world = self.world.again()?;
        let shapes = world.moving_bodies().flat_map(sim::Body::asked_shapes).collect();
        if let Err(why) = self.register(shapes).await {
            // They are sent again when a node first misses one.
            tracing::warn!("nodes refuse shapes of the scene: {why}");
        }
        self.replace_world(world);
        if self.log.recorder.is_some() {
            keep(&mut self.log.commands, Command::Reset);
        }
        Ok(())
    }

    /// Bodies have come or gone: what was known of them by their places no longer holds.
    pub(super) fn bodies_changed(&mut self) {
        let bodies = || self.world.moving_bodies();
        self.figures.samples = bodies().map(|body| body.probes.samples_body().len()).sum();
        self.surfaces.set_bodies(bodies().count());
        let asked = bodies().map(|body| QueryBody {
            shape: Arc::clone(&body.probes),
            around: body.around.clone(),
            faces: body.faces.clone(),
        });
        self.query.set_bodies(asked.collect(), self.settings.reuse_within_m);
        self.publish_scene();
    }

    /// Makes shapes known to all nodes before they are asked about.
    async fn register(&mut self, shapes: Vec<Arc<Shape>>) -> Result<(), Refusal> {
        let distinct: HashMap<[u8; 32], Arc<Shape>> =
            shapes.into_iter().map(|shape| (shape.digest(), shape)).collect();
        Ok(self.transport.register_shapes(distinct.into_values().collect(), REGISTER_TIMEOUT).await?)
    }

    /// Has all cameras learn their backgrounds, or fails with the reason; it does not need the run any more.
    fn take_background(&self, seconds: f64) -> impl Future<Output = Result<(), Refusal>> + Send + use<> {
        let fps = self.settings.fps;
        let taken = if BACKGROUND_S.contains(&seconds) {
            let frames = (seconds * fps).ceil() as u64;
            // In lock-step cameras wait for the run, which is where it is now.
            let first = frame_at(self.film_s(), fps) + FRAMES_AHEAD + 1;
            let first = if self.settings.lock_step {
                FirstFrame::At(first)
            } else {
                FirstFrame::AfterNewest((MESSAGE_S * fps).ceil() as u64)
            };
            Ok(self.transport.take_background(first, frames))
        } else {
            Err(Refusal::Background { found_s: seconds })
        };
        async move { Ok(taken?.await?) }
    }

    /// Does what a schedule has before a step.
    pub(super) async fn follow(&mut self, commands: Vec<Command>) -> Result<(), RunError> {
        for command in commands.into_iter().filter(Command::changes_world) {
            self.carry_out(command).await.map_err(RunError::Command)?;
        }
        Ok(())
    }
}

/// Takes out the commands for a world that a later reset, or another scene, ends.
fn take_superseded(waiting: &mut VecDeque<Order>) -> Vec<Order> {
    let ends_world = |order: &Order| matches!(order.command, Command::Reset | Command::Choose(_));
    let Some(end) = waiting.iter().rposition(ends_world) else { return vec![] };
    let before: Vec<Order> = waiting.drain(..end).collect();
    let (superseded, kept): (Vec<_>, Vec<_>) =
        before.into_iter().partition(|order| order.command.changes_world() && !ends_world(order));
    kept.into_iter().rev().for_each(|order| waiting.push_front(order));
    superseded
}

/// Keeps a command. Of a body that is drawn from place to place before a step only the last place counts.
fn keep(commands: &mut Vec<Command>, command: Command) {
    let grabbed =
        |command: &Command| if let Command::Grab { body, .. } = *command { Some(body) } else { None };
    if let Some(body) = grabbed(&command) {
        let others = commands.iter().rposition(|kept| grabbed(kept).is_none());
        let drawn = commands.iter().rposition(|kept| grabbed(kept) == Some(body));
        if let Some(place) = drawn.filter(|&place| others.is_none_or(|others| place > others)) {
            commands[place] = command;
            return;
        }
    }
    commands.push(command);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reset_supersedes_what_was_asked_of_its_world_before() {
        let push = |x| Command::Push { body: 0, impulse_n_s: [x, 0.0, 0.0], at_m: None };
        let mut waiting: VecDeque<Order> = [
            Command::Pause,
            push(1.0),
            Command::Reset,
            push(2.0),
            Command::Step(3),
            Command::Reset,
            push(3.0),
        ]
        .map(|command| Order { command, reply: tokio::sync::oneshot::channel().0 })
        .into();
        let superseded = take_superseded(&mut waiting);
        let commands = |orders: Vec<Order>| orders.into_iter().map(|order| order.command).collect::<Vec<_>>();
        assert_eq!(commands(superseded), [push(1.0), push(2.0)]);
        let expected = [Command::Pause, Command::Reset, Command::Step(3), Command::Reset, push(3.0)];
        assert_eq!(commands(waiting.into()), expected);
    }

    #[test]
    fn of_a_body_that_is_drawn_the_last_place_is_kept() {
        let grab = |body, x| Command::Grab { body, grip_body_m: [0.0; 3], target_m: [x, 0.0, 0.0] };
        let mut kept = Vec::new();
        let all = [grab(1, 0.1), grab(2, 0.2), grab(1, 0.3), Command::Reset, grab(1, 0.4), grab(1, 0.5)];
        all.into_iter().for_each(|command| keep(&mut kept, command));
        assert_eq!(kept, [grab(1, 0.3), grab(2, 0.2), Command::Reset, grab(1, 0.5)]);
    }
}
