//! The world under gravity alone, and with answers from hulls that are simple enough to work out.

mod answers;
mod commands;
mod contacts;
mod foresight;
mod limits;
mod patches;
mod settling;
mod surfaces;
mod true_solids;

use super::*;
use crate::response::BodyResponse;

fn world_of(text: &str, seed: u64) -> World {
    let scene = Scene::from_toml("test", text).expect("a scene");
    World::new(&scene, WorldSettings { seed, ..WorldSettings::default() }).expect("a world")
}

fn untouched(world: &World) -> Vec<BodyResponse> {
    vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()]
}

fn run(world: &mut World, seconds: f64) {
    let responses = untouched(world);
    while world.time_s() < seconds - 1e-9 {
        let report = world.step(&responses).expect("a step");
        assert_eq!(report, StepReport::default());
    }
}

const STACK: &str = "
    [[bodies]]
    name = 'box'
    shape.box.size = [0.28, 0.28, 0.28]
    count = 4
    place.stack.foot = [0.0, 0.0, 0.0]";
