//! A world as plain data: all that another process needs to go on with it. Who holds what, contacts, sleep and what the
//! hull was known to do are not in it: bodies are where they were, with their velocities.

use super::limits::SampleCount;
use super::{Body, BodyId, CommandError, Parameters, World, WorldError};
use crate::scene::{
    BodySpec, MAX_BODIES, MAX_GRAVITY_M_S2, MAX_NUMBERED_BYTES, Scene, ValueError, all_within, within, wrong,
};
use crate::scene::{FRICTION, RESTITUTION};
use std::collections::BTreeSet;

/// No body is farther out, metres: it would have fallen for hours.
const MAX_FALLEN_M: f64 = 1e9;
/// No body is faster, m/s or rad/s: the same.
const MAX_FALLEN_PER_S: f64 = 1e6;
/// Steps and numbers of bodies are below this: counting goes on from them.
const MAX_COUNT: u64 = 1 << 31;

/// A world at one step. One that exists is possible.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldSnapshot {
    scene: Scene,
    parameters: Parameters,
    steps: u64,
    next_id: BodyId,
    bodies: Vec<BodySnapshot>,
}

/// A body at one step.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySnapshot {
    /// Its number.
    pub id: BodyId,
    /// What it is, where it is, and its velocity.
    pub spec: BodySpec,
    /// Angular velocity in the world, rad/s.
    pub spin_rad_s: [f64; 3],
}

impl WorldSnapshot {
    /// A snapshot of its parts: the scene that the world began as, every parameter, the steps that were made, the number
    /// of the body that comes next, and the bodies by ascending numbers. The error names the first part that cannot be;
    /// solids, masses and surfaces of bodies are taken as checked ([`BodyRequest`](crate::BodyRequest)).
    pub fn new(
        scene: Scene,
        parameters: Parameters,
        steps: u64,
        next_id: BodyId,
        bodies: Vec<BodySnapshot>,
    ) -> Result<WorldSnapshot, ValueError> {
        check_parameters(&parameters)?;
        if steps >= MAX_COUNT {
            return Err(wrong("steps", steps, format_args!("fewer than {MAX_COUNT}")));
        }
        if bodies.len() > MAX_BODIES {
            return Err(wrong("bodies", bodies.len(), format_args!("at most {MAX_BODIES}")));
        }
        if u64::from(next_id) >= MAX_COUNT {
            return Err(wrong("next_id", next_id, format_args!("less than {MAX_COUNT}")));
        }
        let ids = bodies.iter().map(|body| body.id).chain([next_id]);
        if let Some((id, _)) = ids.clone().zip(ids.skip(1)).find(|(id, next)| id >= next) {
            return Err(wrong("bodies.id", id, "less than that of the next body"));
        }
        let mut names = BTreeSet::new();
        for body in &bodies {
            check_body(body)?;
            if !names.insert(&body.spec.name[..]) {
                return Err(wrong(
                    "bodies.name",
                    format_args!("`{}` twice", body.spec.name),
                    "every name once",
                ));
            }
        }
        Ok(WorldSnapshot { scene, parameters, steps, next_id, bodies })
    }

    /// What the world began as.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Every parameter.
    pub fn parameters(&self) -> Parameters {
        self.parameters
    }

    /// How many steps were made.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The number of the body that comes next.
    pub fn next_id(&self) -> BodyId {
        self.next_id
    }

    /// Every body, fixed ones too, by ascending numbers.
    pub fn bodies(&self) -> &[BodySnapshot] {
        &self.bodies
    }
}

/// Every parameter must be there: nothing is left as it was.
fn check_parameters(parameters: &Parameters) -> Result<(), ValueError> {
    let Parameters { answers_hull, hull_restitution, hull_friction, gravity_m_s2 } = *parameters;
    answers_hull.ok_or_else(|| wrong("answers_hull", "none", "whether bodies answer the hull"))?;
    within("hull_restitution", hull_restitution.unwrap_or(f64::NAN), RESTITUTION)?;
    within("hull_friction", hull_friction.unwrap_or(f64::NAN), FRICTION)?;
    let gravity_m_s2 = gravity_m_s2.unwrap_or([f64::NAN; 3]);
    all_within("gravity", &gravity_m_s2, -MAX_GRAVITY_M_S2..=MAX_GRAVITY_M_S2)
}

fn check_body(body: &BodySnapshot) -> Result<(), ValueError> {
    let BodySnapshot { id: _, spec, spin_rad_s } = body;
    let is_printable = !spec.name.is_empty() && !spec.name.chars().any(char::is_control);
    if !is_printable || spec.name.len() > MAX_NUMBERED_BYTES {
        let expected = format_args!("1 to {MAX_NUMBERED_BYTES} bytes of printable characters");
        return Err(wrong("bodies.name", format_args!("{:?}", spec.name), expected));
    }
    let key = |key: &str| format!("body `{}`, {key}", spec.name);
    all_within(&key("position"), &spec.pose.position_m(), -MAX_FALLEN_M..=MAX_FALLEN_M)?;
    all_within(&key("velocity"), &spec.velocity_m_s, -MAX_FALLEN_PER_S..=MAX_FALLEN_PER_S)?;
    all_within(&key("spin"), spin_rad_s, -MAX_FALLEN_PER_S..=MAX_FALLEN_PER_S)
}

impl Body {
    /// What would spawn this body where it is, with its velocity. Its spin is not in it.
    pub fn spec(&self) -> BodySpec {
        BodySpec {
            name: self.name.clone(),
            solid: self.solid.clone(),
            pose: self.pose,
            velocity_m_s: self.velocity_m_s,
            mass: self.mass,
            friction: self.friction,
            restitution: self.restitution,
            fixed: self.fixed,
            color: self.color,
        }
    }
}

impl World {
    /// The world as it is now.
    pub fn snapshot(&self) -> WorldSnapshot {
        let body = |body: &Body| BodySnapshot { id: body.id, spec: body.spec(), spin_rad_s: body.spin_rad_s };
        WorldSnapshot {
            scene: self.scene.clone(),
            parameters: self.parameters(),
            steps: self.steps,
            next_id: self.next_id,
            bodies: self.bodies.iter().map(body).collect(),
        }
    }

    /// The world of a snapshot, with this one's seed, length of a step and response to the hull.
    pub fn going_on(&self, from: &WorldSnapshot) -> Result<World, CommandError> {
        let settings = self.start.on(from.scene.hull());
        let specs: Vec<BodySpec> = from.bodies.iter().map(|body| body.spec.clone()).collect();
        let mut world = World::without_bodies(&from.scene, settings, &specs)?;
        world.set(from.parameters)?;
        let mut count = SampleCount::default();
        for BodySnapshot { id, spec, spin_rad_s } in from.bodies.iter().cloned() {
            let samples = world.samples_of(&spec)?;
            count.admit(&spec, &samples)?;
            world.next_id = id;
            world.take_in(spec, samples);
            world.turn_last(spin_rad_s)?;
        }
        (world.next_id, world.steps) = (from.next_id, from.steps);
        world.trajectory.add(world.bodies.iter().map(|body| &body.pose));
        Ok(world)
    }

    /// Gives the body that came last its spin.
    fn turn_last(&mut self, spin_rad_s: [f64; 3]) -> Result<(), WorldError> {
        let index = self.bodies.len() - 1;
        let body = &mut self.bodies[index];
        if !body.fixed {
            self.solver.set_spin(index, spin_rad_s);
            body.spin_rad_s = spin_rad_s;
        }
        // Numbers that the solver's precision does not hold would only come out at the first step.
        match self.solver.state(index).pose() {
            Some(_) => Ok(()),
            None => Err(WorldError::Solid { body: body.name.clone() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::BodyRequest;
    use crate::{BodyResponse, WorldSettings};
    use hull::Pose;

    const SCENE: &str = "
        [[bodies]]
        name = 'box'
        shape.box.size = [0.2, 0.2, 0.2]
        count = 3
        place.stack.foot = [0.6, 0.0, 0.3]
        [[bodies]]
        name = 'shelf'
        shape.box.size = [1.0, 0.05, 1.0]
        place.at = [2.0, 1.0, 0.0]
        fixed = true";

    fn begun() -> World {
        let scene = Scene::from_toml("kept", SCENE).expect("a scene");
        World::new(&scene, WorldSettings::default()).expect("a world")
    }

    fn step(world: &mut World, steps: usize) {
        for _ in 0..steps {
            let responses = vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()];
            world.step(&responses).expect("a step");
        }
    }

    /// A world in which a body has gone, one that was thrown has come, and gravity is another.
    fn lived() -> World {
        let mut world = begun();
        step(&mut world, 5);
        let ball = "shape.ball.radius = 0.1\nposition = [0.6, 1.5, 0.3]\nvelocity = [1, 2, 0]\nmass = 2.5";
        let request: BodyRequest = toml::from_str(ball).expect("the keys of a request");
        let prepared = world.prepare(request.check().expect("a body")).expect("room");
        world.spawn(prepared).expect("spawned");
        world.remove(1).expect("gone");
        let lighter = Parameters { gravity_m_s2: Some([0.0, -5.0, 0.0]), ..Parameters::default() };
        world.set(lighter).expect("possible");
        world.push(0, [0.0, 0.1, 0.2], Some([0.6, 0.2, 0.3])).expect("pushed");
        step(&mut world, 20);
        world
    }

    #[test]
    fn a_world_goes_on_where_it_was_kept() {
        let world = lived();
        let kept = world.snapshot();
        let again = begun().going_on(&kept).expect("a world");
        assert_eq!((again.steps(), again.time_s()), (25, world.time_s()));
        assert_eq!(again.snapshot().bodies().len(), 4);
        for (body, before) in again.bodies().iter().zip(world.bodies()) {
            assert_eq!((body.id, &body.name, &body.solid), (before.id, &before.name, &before.solid));
            let moved_m = body.shape.moved_at_most_m(&before.pose, &body.pose);
            assert!(moved_m < 1e-6, "{}: {moved_m} m", body.name);
            assert_eq!(body.velocity_m_s, before.velocity_m_s, "{}", body.name);
            assert_eq!(body.spin_rad_s, before.spin_rad_s, "{}", body.name);
        }
        assert_eq!(again.parameters(), world.parameters());
        // They fly on as they would have: the ball is in the air.
        let (mut again, mut world) = (again, world);
        step(&mut again, 10);
        step(&mut world, 10);
        let ball = |world: &World| world.body(4).expect("the ball").pose;
        let apart_m = again.body(4).expect("the ball").shape.moved_at_most_m(&ball(&world), &ball(&again));
        assert!(apart_m < 1e-4, "{apart_m} m");
    }

    #[test]
    fn bodies_that_come_later_get_numbers_that_were_never_given() {
        let mut again = begun().going_on(&lived().snapshot()).expect("a world");
        let request: BodyRequest =
            toml::from_str("shape.ball.radius = 0.1\nposition = [0, 2, 0]").expect("keys");
        let prepared = again.prepare(request.check().expect("a body")).expect("room");
        assert_eq!(again.spawn(prepared), Ok(5));
    }

    #[test]
    fn the_scenes_start_is_still_known() {
        let again = begun().going_on(&lived().snapshot()).expect("a world");
        let reset = again.again().expect("a world");
        assert_eq!((reset.digest(), reset.steps()), (begun().digest(), 0));
    }

    #[test]
    fn the_same_snapshot_goes_on_the_same_way() {
        let kept = lived().snapshot();
        let digest = || {
            let mut world = begun().going_on(&kept).expect("a world");
            step(&mut world, 30);
            world.digest()
        };
        assert_eq!(digest(), digest());
    }

    #[test]
    fn parts_that_cannot_be_are_named() {
        let kept = lived().snapshot();
        let with = |change: &dyn Fn(&mut WorldSnapshot)| {
            let mut wrong = kept.clone();
            change(&mut wrong);
            let WorldSnapshot { scene, parameters, steps, next_id, bodies } = wrong;
            WorldSnapshot::new(scene, parameters, steps, next_id, bodies)
        };
        assert_eq!(with(&|_| {}), Ok(kept.clone()));
        type Change<'a> = (&'a dyn Fn(&mut WorldSnapshot), &'a str);
        let far = Pose::new([2e9, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).expect("a pose");
        let changes: [Change<'_>; 9] = [
            (&|kept| kept.bodies[0].spec.velocity_m_s[1] = f64::NAN, "body `box_0`, velocity: NaN"),
            (&|kept| kept.bodies[0].spin_rad_s[1] = f64::INFINITY, "body `box_0`, spin: inf"),
            (&|kept| kept.bodies[0].spec.pose = far, "body `box_0`, position: 2000000000"),
            (&|kept| kept.bodies[1].spec.name = "box_0".into(), "bodies.name: `box_0` twice"),
            (&|kept| kept.bodies[1].spec.name = "a\nb".into(), "bodies.name: \"a\\nb\""),
            (&|kept| kept.bodies[1].id = 0, "bodies.id: 0, expected less than that of the next"),
            (&|kept| kept.next_id = 4, "bodies.id: 4, expected less than that of the next"),
            (&|kept| kept.steps = u64::MAX, "steps: 18446744073709551615"),
            (&|kept| kept.parameters.hull_friction = None, "hull_friction: NaN"),
        ];
        for (change, expected) in changes {
            let error = with(change).expect_err(expected).to_string();
            assert!(error.starts_with(expected) && error.lines().count() == 1, "{error}");
        }
        let many = |kept: &mut WorldSnapshot| {
            let body = kept.bodies[0].clone();
            kept.bodies = vec![body; MAX_BODIES + 1];
        };
        let error = with(&many).expect_err("too many").to_string();
        assert_eq!(error, "bodies: 1001, expected at most 1000");
    }
}
