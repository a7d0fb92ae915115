//! Commands: checked first, so that nodes can be told of new shapes, and then carried out.

use std::collections::HashMap;
use std::sync::Arc;

use hull::Shape;
use sim::{Body, PreparedBody, World};

use super::Run;
use crate::core::budget::StepBudget;
use crate::core::command::{Command, MAX_STEPS, Outcome, Refusal};
use crate::core::query::QueryBody;

/// Whether steps are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Steering {
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

/// A command that was checked, and what it needs.
pub(crate) enum Prepared<'a> {
    /// Another world takes the place of the old.
    World(Box<World>),
    /// Another body.
    Body(Box<PreparedBody>),
    /// It needs nothing.
    Command(&'a Command),
}

/// What a command changed of what followers see.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    /// Bodies move, or steps stop: the world's state shows that.
    State,
    /// Bodies have come or gone, or parameters are others.
    Scene,
    /// It is another world.
    World,
}

impl Run {
    /// Checks a command and makes what it needs.
    pub fn prepare<'a>(&self, command: &'a Command) -> Result<Prepared<'a>, Refusal> {
        let world = match command {
            Command::Reset => self.world.again()?,
            Command::Choose(scene) => {
                let scene = scene.clone().with_gravity(self.world.scene().gravity_m_s2())?;
                self.world.with_scene(&scene)?
            }
            Command::GoOn(from) => self.world.going_on(from)?,
            Command::Spawn(spec) => {
                let prepared = self.world.prepare((**spec).clone())?;
                return Ok(Prepared::Body(Box::new(prepared)));
            }
            command => return Ok(Prepared::Command(command)),
        };
        Ok(Prepared::World(Box::new(world)))
    }

    /// The shapes that nodes must know before the command is carried out; `None` if these are those that they know.
    pub fn shapes(&self, prepared: &Prepared) -> Option<Vec<Arc<Shape>>> {
        match prepared {
            Prepared::World(world) => Some(distinct(world.asked_shapes())),
            Prepared::Body(body) => Some(distinct(self.world.asked_shapes().chain(body.asked_shapes()))),
            Prepared::Command(_) => None,
        }
    }

    /// Does what is asked. Backgrounds are taken by cameras: nothing is to be done here.
    pub fn carry_out(&mut self, prepared: Prepared) -> Result<(Outcome, Change), Refusal> {
        let command = match prepared {
            Prepared::World(world) => {
                let former = Command::GoOn(Box::new(self.world.snapshot()));
                self.replace_world(*world);
                return Ok((Outcome::Revocable(Box::new(former)), Change::World));
            }
            Prepared::Body(body) => {
                let id = self.world.spawn(*body)?;
                self.bodies_changed();
                return Ok((Outcome::Spawned(id), Change::Scene));
            }
            Prepared::Command(command) => command,
        };
        let mut change = Change::State;
        match *command {
            Command::Pause => self.steering = Steering::Paused,
            Command::Resume => {
                self.steering = Steering::Running;
                if let Some(playback) = &mut self.playback {
                    playback.resume();
                }
            }
            Command::Step(steps) => self.count_steps(steps)?,
            Command::Seek { film_s } => self.seek(film_s)?,
            Command::SetSpeed(speed) => self.set_speed(speed)?,
            Command::SetLoop(loops) => self.recording()?.set_loop(loops),
            Command::Remove(id) => {
                let removed = self.world.body(id).map(Body::spec);
                self.world.remove(id)?;
                self.bodies_changed();
                let outcome = removed.map_or(Outcome::Applied, |spec| {
                    Outcome::Revocable(Box::new(Command::Spawn(Box::new(spec))))
                });
                return Ok((outcome, Change::Scene));
            }
            Command::Push { body, impulse_n_s, at_m } => self.world.push(body, impulse_n_s, at_m)?,
            Command::Grab { body, grip_body_m, target_m } => {
                self.world.grab(body, grip_body_m, target_m)?;
            }
            Command::Release { body, velocity_m_s } => self.world.release(body, velocity_m_s)?,
            Command::Set(parameters) => {
                self.world.set(parameters)?;
                change = Change::Scene;
            }
            Command::Reset | Command::Choose(_) | Command::GoOn(_) | Command::Spawn(_) => {
                return self.carry_out(self.prepare(command)?);
            }
            Command::TakeBackground { .. } | Command::RestoreBackground { .. } => {}
        }
        Ok((Outcome::Applied, change))
    }

    fn count_steps(&mut self, steps: u32) -> Result<(), Refusal> {
        if !(1..=MAX_STEPS).contains(&steps) {
            return Err(Refusal::Steps { found: steps });
        }
        let (left, is_frozen) = match self.steering {
            Steering::Counting { left, is_frozen } => (left, is_frozen),
            // In lock-step film has waited.
            Steering::Paused => (0, !self.settings.lock_step),
            Steering::Running => (0, false),
        };
        let left = (left + u64::from(steps)).min(MAX_STEPS.into());
        self.steering = Steering::Counting { left, is_frozen };
        Ok(())
    }

    /// Puts a new world in the place of the old; film goes on from where it is.
    fn replace_world(&mut self, world: World) {
        // A world that goes on has a time of its own already, of which this film is not.
        self.clock.passed_s += self.world.time_s() - world.time_s();
        self.settings.reuse_within_m = world.scene().hull().reuse_within_m;
        self.world = world;
        self.budget = StepBudget::default();
        self.hull.forget_surfaces();
        self.bodies_changed();
    }

    /// Bodies have come or gone: what was known of them by their places no longer holds.
    pub(super) fn bodies_changed(&mut self) {
        let bodies = || self.world.moving_bodies();
        self.figures.samples = bodies().map(|body| body.probes.samples_body().len()).sum();
        let asked = bodies().map(|body| QueryBody {
            shape: Arc::clone(&body.probes),
            around: body.around.clone(),
            faces: body.faces.clone(),
        });
        let ids = bodies().map(|body| body.id).collect();
        self.hull.set_bodies(ids, asked.collect(), self.settings.reuse_within_m);
    }
}

fn distinct(shapes: impl Iterator<Item = Arc<Shape>>) -> Vec<Arc<Shape>> {
    let distinct: HashMap<[u8; 32], Arc<Shape>> = shapes.map(|shape| (shape.digest(), shape)).collect();
    distinct.into_values().collect()
}
