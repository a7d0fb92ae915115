//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use crate::scene::{MAX_BODIES, MAX_NUMBERED_BYTES};
use crate::{BodyResponse, Scene, World, WorldSettings};

/// Worlds of more bodies are not stepped here: that takes long, and finds nothing else.
const MAX_STEPPED: usize = 8;

/// A scene file: one that is accepted has places for all its bodies, and makes a world that steps.
pub fn scene(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let scene = match Scene::from_toml("fuzz", text) {
        Ok(scene) => scene,
        Err(error) => return assert!(!error.to_string().contains('\n'), "an error of one line: {error}"),
    };
    assert_eq!(Scene::from_toml(scene.name(), scene.text()).as_ref(), Ok(&scene), "its text is all of it");
    let bodies = scene.bodies(1);
    assert!(bodies.len() <= MAX_BODIES, "{} bodies", bodies.len());
    for body in &bodies {
        assert!(body.pose.position_m().iter().all(|part| part.is_finite()), "{body:?}");
        assert!(body.name.len() <= MAX_NUMBERED_BYTES, "a name of {} bytes", body.name.len());
    }
    if bodies.len() <= MAX_STEPPED
        && let Ok(mut world) = World::new(&scene, WorldSettings::default())
    {
        steps(&mut world);
    }
}

/// Steps a world: no body may leave the numbers.
pub fn steps(world: &mut World) {
    for _ in 0..3 {
        let responses = vec![BodyResponse::default(); world.moving_bodies().len()];
        let stepped = world.step(&responses);
        assert!(stepped.is_ok(), "a world that exists steps: {stepped:?}");
    }
    for body in world.bodies() {
        let numbers = [body.pose.position_m(), body.velocity_m_s, body.spin_rad_s];
        assert!(numbers.as_flattened().iter().all(|number| number.is_finite()), "{:?}", body.pose);
    }
}
