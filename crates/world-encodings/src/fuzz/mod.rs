//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use sim::{Scene, World, WorldSettings};

use crate::{world_from_bytes, world_to_bytes};

/// Worlds of more bodies are not stepped here: that takes long, and finds nothing else.
const MAX_STEPPED: usize = 8;

/// A world as a node has kept it: one that is accepted is written as the same, and a run that goes on from it steps.
pub fn world(bytes: &[u8]) {
    let world = match world_from_bytes(bytes) {
        Ok(world) => world,
        Err(error) => return assert!(!error.to_string().contains('\n'), "an error of one line: {error}"),
    };
    assert_eq!(world_from_bytes(&world_to_bytes(&world)).as_ref(), Ok(&world), "what was written again");
    if world.bodies().len() <= MAX_STEPPED
        && let Ok(empty) = Scene::from_toml("empty", "")
        && let Ok(begun) = World::new(&empty, WorldSettings::default())
        && let Ok(mut going_on) = begun.going_on(&world)
    {
        sim::fuzz::steps(&mut going_on);
    }
}
