//! Observing: a coordinator that shows the run of another. Cameras are as their nodes report them, frame by frame; bodies
//! as the nodes remember them, once a second.

use std::time::Duration;

use film_time::Pace;
use sim::World;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until};

use super::watch::Watcher;
use super::{Coordinator, RunError};
use crate::figures::Figures;
use crate::live::{Live, Order, Refusal};
use crate::memory::{Checkpoint, Home, Place, newest_world};

/// How often nodes are asked for the world that they remember.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Frames and commands are looked at so often.
const TURN: Duration = Duration::from_millis(20);

/// Which world is shown, and when the next is asked for.
struct Look {
    home: Home,
    due: Instant,
    asking: Option<JoinHandle<Option<Checkpoint>>>,
    is_warned: bool,
}

impl Coordinator {
    /// Shows the run of the lease holder until `stop` completes or the time is over; commands are refused. Needs a
    /// transport of [`Role::Observes`](node_client::Role). Nodes may come and go.
    pub async fn observe(
        mut self,
        watcher: &mut dyn Watcher,
        stop: impl Future<Output = ()>,
    ) -> Result<(Figures, World), RunError> {
        // How old frames are is told by wall clocks: film time is known to who leads alone.
        self.run.clock.pace = Pace::lock_step(0);
        let place = Place::of(self.run.observers(), self.run.world.scene());
        let home = Home::new(place, self.run.world.scene());
        let mut look = Look { home, due: Instant::now(), asking: None, is_warned: false };
        let until =
            self.run.settings.seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        tokio::pin!(stop);
        while until.is_none_or(|until| Instant::now() < until) {
            tokio::select! {
                biased;
                () = &mut stop => break,
                () = sleep_until(Instant::now() + TURN) => {}
            }
            self.transport.drain();
            self.look(&mut look).await;
            self.show_frame();
            self.refuse_orders();
            self.publish_world();
            self.report(watcher);
            watcher.turned();
        }
        Ok((self.run.figures, self.run.world))
    }

    /// Shows the world that nodes remember, once they have said which; and asks again in time.
    async fn look(&mut self, look: &mut Look) {
        if look.asking.as_ref().is_some_and(JoinHandle::is_finished)
            && let Some(asked) = look.asking.take()
            && let Ok(Some(found)) = asked.await
        {
            self.show_world(&found, &mut look.is_warned);
        }
        if look.asking.is_none() && Instant::now() >= look.due {
            look.due = Instant::now() + LOOK_EVERY;
            look.asking =
                Some(tokio::spawn(newest_world(look.home.clone(), self.transport.clients().to_vec())));
        }
    }

    fn show_world(&mut self, found: &Checkpoint, is_warned: &mut bool) {
        let world = match self.run.world.going_on(&found.world) {
            Ok(world) => world,
            Err(why) if !*is_warned => {
                *is_warned = true;
                tracing::warn!("the world that nodes remember cannot be shown: {why}");
                return;
            }
            Err(_) => return,
        };
        let bodies = |world: &World| -> Vec<_> { world.bodies().iter().map(|body| body.id).collect() };
        let is_other =
            world.scene().name() != self.run.world.scene().name() || world.steps() < self.run.world.steps();
        let is_changed =
            bodies(&world) != bodies(&self.run.world) || world.parameters() != self.run.world.parameters();
        self.run.world = world;
        if is_other {
            self.publisher.generation += 1;
            self.publisher.view.forget_bodies();
        }
        if is_other || is_changed {
            self.publish_scene();
        }
    }

    /// The frame that all nodes have that are there.
    fn show_frame(&mut self) {
        let nodes = self.transport.roster().nodes().iter().filter(|node| node.missing().is_none());
        let newest = nodes.filter_map(|node| Some(node.newest()?.frame)).min();
        if let Some(frame) = newest {
            self.run.film.frame = Some(frame);
            let view = &mut self.publisher.view;
            (view.frame, view.film_s) = (Some(frame), frame as f64 / self.run.settings.fps);
        }
    }

    fn refuse_orders(&mut self) {
        let Some(Live { orders, .. }) = &mut self.publisher.live else { return };
        while let Ok(Order { reply, .. }) = orders.try_recv() {
            // The follower may have gone.
            let _ = reply.send(Err(Refusal::Observes));
        }
    }
}
