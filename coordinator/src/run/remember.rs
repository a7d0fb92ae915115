//! The memory of the nodes: what a run goes on from, and what it hands them.

use film_time::unix_now_s;

use super::Coordinator;
use super::watch::{GoneOn, Watcher};
use crate::core::budget::StepBudget;
use crate::core::roster::RosterNode;
use crate::live::Command;
use crate::memory::{Memory, MemoryUse};

impl Coordinator {
    /// Begins to use the memory of the nodes, which are connected. Live runs alone do: others are to be the same
    /// whenever they are made.
    pub(super) async fn begin_memory(&mut self, watcher: &mut dyn Watcher) {
        let clients = self.transport.clients().to_vec();
        let is_replay = self.script.schedule.is_some();
        if self.remembering.memory_use == MemoryUse::Off
            || self.run.settings.lock_step
            || is_replay
            || clients.is_empty()
        {
            return;
        }
        let mut memory = Memory::new(self.run.observers(), self.run.world.scene(), clients.len());
        let newest = memory.recall(&clients).await;
        if self.remembering.memory_use == MemoryUse::GoOn
            && let Some(found) = newest
        {
            let (age_s, world) = (unix_now_s() - found.kept.unix_s, Box::new(found.world));
            // As a command, so that a recording has it, too.
            match self.carry_out(Command::GoOn(world)).await {
                Ok(_) => {
                    self.run.budget = StepBudget::on_probation();
                    watcher.gone_on(&self.gone_on(age_s));
                }
                Err(why) => tracing::warn!("the world that nodes remember cannot go on: {why}"),
            }
        }
        self.remembering.memory = Some(memory);
    }

    fn gone_on(&self, age_s: f64) -> GoneOn {
        GoneOn {
            scene: self.run.world.scene().name().to_owned(),
            bodies: self.run.world.bodies().len(),
            steps: self.run.world.steps(),
            time_s: self.run.world.time_s(),
            age_s,
        }
    }

    /// Hands the nodes the world, if it is time and the world is fit to go on from.
    pub(super) fn remember(&mut self) {
        if let Some(memory) = &mut self.remembering.memory
            && self.run.budget.is_met()
        {
            let nodes = self.transport.roster().nodes();
            memory.keep(&self.run.world, self.transport.clients(), nodes.iter().map(RosterNode::connections));
        }
    }
}
