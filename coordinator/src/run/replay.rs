//! A schedule that is followed: its next step, and the run again from its beginning.

use sim::World;

use super::{Coordinator, RunError, now};
use crate::core::run::Follow;
use crate::hooks::Scheduled;
use crate::live::Live;

impl Coordinator {
    /// Takes the next step of a schedule, if there is one; false at its end.
    pub(super) async fn follow_schedule(&mut self) -> Result<bool, RunError> {
        if self.script.schedule.is_none() {
            return Ok(true);
        }
        let has_page = self.publisher.live.as_ref().is_some_and(Live::has_page);
        let was_paused = self.run.steering.is_paused();
        let mut follow = self.run.follow(has_page, &now);
        loop {
            follow = match follow {
                Follow::BeginAgain => {
                    self.begin_again().await?;
                    Follow::Take
                }
                Follow::Take => match self.script.schedule.as_mut().and_then(|schedule| schedule.next()) {
                    Some(Scheduled { commands, sees }) => {
                        (self.run.sees, self.script.commands) = (Some(sees), Some(commands));
                        Follow::GoOn
                    }
                    None => self.run.end_of_schedule(&now),
                },
                Follow::GoOn => break,
                Follow::End => return Ok(false),
            };
        }
        if self.run.arrive() {
            self.publish_late_scene();
            self.publish_world();
        } else if was_paused != self.run.steering.is_paused() {
            tracing::warn!("the recording has ended; the run stays while a page is open (not with --once)");
            self.publish_world();
        }
        Ok(true)
    }

    /// Begins the run again as it began: with the same world, and with the first frame.
    async fn begin_again(&mut self) -> Result<(), RunError> {
        let Some((scene, settings)) = &self.script.beginning else { return Ok(()) };
        let world = World::new(scene, *settings)?;
        if let Some(schedule) = &mut self.script.schedule {
            schedule.begin_again();
        }
        self.script.commands = None;
        self.log.commands.clear();
        self.transport.start(self.run.clock.pace, None).await?;
        self.run.begin_again(world, (self.transport.roster(), self.transport.answering()));
        self.regroup();
        self.begin_generation();
        self.publish_scene();
        Ok(())
    }
}
