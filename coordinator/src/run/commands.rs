//! What followers ask of a run: taken between steps, done before the next.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use film_time::{BACKGROUND_S, unix_now_s};
use futures::future::BoxFuture;
use tokio::time::timeout;

use super::now;
use super::watch::{REPORT_EVERY, Watcher};
use super::{Coordinator, FRAMES_AHEAD, RunError};
use crate::core::clock::frame_at;
use crate::core::holds::HoldChange;
use crate::core::run::{Change, Prepared, Steering};
use crate::live::{Client, Command, MAX_WAITING, Order, Outcome, RESETS_BEYOND, Refusal};
use crate::roster::LOCK_STEP_TIMEOUT;
use crate::transport::{FirstFrame, WantedBackground};

/// Commands between two steps that a recording keeps.
const MAX_KEPT: usize = 10_000;
/// A node that does not take new shapes within this time receives them when it first misses one.
const REGISTER_TIMEOUT: Duration = Duration::from_millis(500);
/// From a message to the cameras until all have received it, seconds.
const MESSAGE_S: f64 = 0.25;
/// Film of a background comes so much late at most: longer, and a camera films none.
const MAX_LATE: Duration = Duration::from_secs(5);
/// Backgrounds are numbered by the time at which they are asked for, in microseconds.
const IDS_PER_S: f64 = 1e6;

impl Coordinator {
    /// Does what is asked by now, as much of it as may wait between two steps.
    pub(super) async fn take_orders(&mut self) {
        self.release_orphans().await;
        for _ in 0..MAX_WAITING {
            // Before each: one may take as long as a node needs for a shape, and a reset is not to wait for all of them.
            self.receive_orders();
            let Some(order) = self.waiting.pop_front() else { break };
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
            if self.waiting.len() < MAX_WAITING + beyond {
                self.waiting.push_back(order);
            } else {
                refuse(order, Refusal::Busy);
            }
        }
        take_superseded(&mut self.waiting).into_iter().for_each(|order| refuse(order, Refusal::Superseded));
    }

    /// While paused: waits for an order, not for long, and lets film go by.
    pub(super) async fn rest(&mut self, watcher: &mut dyn Watcher) {
        let Coordinator { transport, publisher, .. } = self;
        let patience = if self.waiting.is_empty() { REPORT_EVERY } else { Duration::ZERO };
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
            Ok(Some(order)) => self.waiting.push_back(order),
            // No viewer is left that could resume.
            Ok(None) => self.run.steering = Steering::Running,
            Err(_) => {}
        }
        self.take_orders().await;
        self.run.let_film_pass(&now);
        self.report(watcher);
    }

    async fn take(&mut self, order: Order) {
        let Order { command, client, reply } = order;
        if self.script.schedule.is_none()
            && let Some(backgrounds) = self.change_backgrounds(&command)
        {
            // Steps go on while cameras film.
            tokio::spawn(async move { reply.send(backgrounds.await) });
            return;
        }
        let outcome = if self.script.schedule.is_some() && !command.is_of_playback() {
            Err(Refusal::Replay)
        } else {
            self.carry_out_for(&client, command).await
        };
        // The follower may have gone.
        let _ = reply.send(outcome);
        self.publish_world();
    }

    /// Does one thing for a client, unless another one holds the body.
    async fn carry_out_for(&mut self, client: &Client, command: Command) -> Result<Outcome, Refusal> {
        if let Some((body, holder)) = self.holds.conflict(client, &command) {
            let name = self.run.world.body(body).map_or_else(|| body.to_string(), |body| body.name.clone());
            return Err(Refusal::Held { body: name, holder: holder.seen_by(client.kind()) });
        }
        let change = HoldChange::of(&command);
        let outcome = self.carry_out(command).await?;
        if let Some(change) = change {
            self.holds.note(client, change);
        }
        Ok(outcome)
    }

    /// Releases what clients hold that are gone.
    async fn release_orphans(&mut self) {
        for body in self.holds.orphans() {
            let released = self.carry_out(Command::Release { body, velocity_m_s: None }).await;
            // There is room for it after the next step.
            if !matches!(released, Err(Refusal::TooManyCommands { .. })) {
                self.holds.forget(body);
                self.publish_world();
            }
        }
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
        let prepared = self.run.prepare(command)?;
        if let Some(shapes) = self.run.shapes(&prepared) {
            self.transport.register_shapes(shapes, REGISTER_TIMEOUT).await?;
        }
        let (outcome, change) = self.run.carry_out(prepared)?;
        self.publish_change(change);
        Ok(outcome)
    }

    fn publish_change(&mut self, change: Change) {
        if change == Change::World {
            self.begin_generation();
        }
        if change != Change::State {
            self.publish_scene();
        }
    }

    /// Another world has begun.
    pub(super) fn begin_generation(&mut self) {
        self.publisher.generation += 1;
        self.holds.clear();
        self.publisher.view.forget_bodies();
    }

    /// Puts the scene's start in the place of a world whose steps cannot be made: whatever made it so, the room goes on.
    pub(super) async fn start_afresh(&mut self, why: &str) -> Result<(), RunError> {
        let world = &self.run.world;
        tracing::error!("the world is given up, its scene {:?} starts afresh: {why}", world.scene().name());
        let prepared = Prepared::World(Box::new(world.again()?));
        if let Some(shapes) = self.run.shapes(&prepared)
            && let Err(why) = self.transport.register_shapes(shapes, REGISTER_TIMEOUT).await
        {
            // They are sent again when a node first misses one.
            tracing::warn!("nodes refuse shapes of the scene: {why}");
        }
        let (_, change) = self.run.carry_out(prepared).map_err(RunError::Command)?;
        self.publish_change(change);
        if self.log.recorder.is_some() {
            keep(&mut self.log.commands, Command::Reset);
        }
        Ok(())
    }

    /// Has the cameras carry out a command about their backgrounds; `None` for other commands. What is returned needs the run no
    /// more.
    fn change_backgrounds(&self, command: &Command) -> Option<BoxFuture<'static, Result<Outcome, Refusal>>> {
        Some(match *command {
            Command::TakeBackground { seconds, allow_foreground } => {
                Box::pin(self.take_background(seconds, allow_foreground))
            }
            Command::RestoreBackground { id } => {
                let restored = self.transport.restore_background(id);
                Box::pin(async move { Ok(restored.await.map(|()| Outcome::Applied)?) })
            }
            _ => return None,
        })
    }

    /// Has all cameras learn their backgrounds, or fails with the reason.
    fn take_background(
        &self,
        seconds: f64,
        allow_foreground: bool,
    ) -> impl Future<Output = Result<Outcome, Refusal>> + Send + use<> {
        let fps = self.run.settings.fps;
        let id = (unix_now_s() * IDS_PER_S) as u64;
        let frames = (seconds * fps).ceil() as u64;
        // In lock-step cameras wait for the run, which is where it is now, and may stand still.
        let (first, takes_at_most) = if self.run.settings.lock_step {
            (FirstFrame::At(frame_at(self.run.film_s(), fps) + FRAMES_AHEAD + 1), LOCK_STEP_TIMEOUT)
        } else {
            let later = FirstFrame::AfterNewest((MESSAGE_S * fps).ceil() as u64);
            (later, Duration::try_from_secs_f64(seconds + MESSAGE_S).unwrap_or_default() + MAX_LATE)
        };
        let wanted = WantedBackground { id, first, frames, allow_foreground, takes_at_most };
        let taken = match Arc::clone(&self.background_turn).try_lock_owned() {
            _ if !BACKGROUND_S.contains(&seconds) => Err(Refusal::Background { found_s: seconds }),
            Err(_) => Err(Refusal::BackgroundBusy),
            Ok(turn) => Ok((turn, self.transport.take_background(wanted))),
        };
        async move {
            let (_turn, taken) = taken?;
            taken.await?;
            Ok(Outcome::Revocable(Box::new(Command::RestoreBackground { id })))
        }
    }

    /// Does what a schedule has before its next step.
    pub(super) async fn follow_commands(&mut self) -> Result<(), RunError> {
        let commands = self.script.commands.take().unwrap_or_default();
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
    use crate::live::ClientKind;

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
        .map(|command| Order {
            command,
            client: Client::new(ClientKind::Page),
            reply: tokio::sync::oneshot::channel().0,
        })
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
