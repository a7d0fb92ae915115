//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use coordinator::live::{BodyLook, BodyState, Command, Parameters, SceneState, WorldState};
use hull::Pose;
use rosc::{OscPacket, OscType};
use sim::{Scene, Solid, World, WorldSettings};

use crate::commands::Ask;
use crate::page::incoming::{self, Incoming, Want};
use crate::programs::osc::{MAX_BUNDLE_BYTES, bundles};
use crate::programs::world_service::command_of_call;
use crate::text;

/// Bytes of a page's or program's message, at most (`docs/feed.md`).
const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// No body's name is longer, bytes.
const MAX_NAME_BYTES: usize = 104;
/// Bodies of the world that names are given to.
const MAX_BODIES: usize = 100;

/// The messages of a page, one a line: each is read, and a command does nothing to a world that it should not.
pub fn page(bytes: &[u8]) {
    let Ok(lines) = std::str::from_utf8(&bytes[..bytes.len().min(MAX_MESSAGE_BYTES)]) else { return };
    let (mut want, mut world) = (Want::default(), None);
    for line in lines.lines() {
        let refusal = match incoming::parse(line, &want) {
            Ok(Incoming::Want(changed)) => {
                let rates = [changed.fps, changed.state_hz, changed.thumbnails_hz];
                assert!(rates.iter().all(|rate| (0.0..=240.0).contains(rate)), "{changed:?}");
                want = changed;
                continue;
            }
            Ok(Incoming::Shown(_)) => continue,
            Ok(Incoming::Command(request)) => match request.command {
                Ok(Ask::Run(command)) => {
                    apply(world.get_or_insert_with(begun), command);
                    continue;
                }
                Ok(Ask::Undo { .. }) => continue,
                Err(why) => why,
            },
            Err(why) => why,
        };
        let answer = text::refused(None, &refusal.to_string());
        assert!(answer.len() <= 4 * MAX_MESSAGE_BYTES && !answer.contains('\n'), "one line: {answer}");
    }
    if let Some(world) = &mut world {
        sim::fuzz::steps(world);
    }
}

/// A call of a program, its name's place (a byte) and its message: as a page's command.
pub fn call(bytes: &[u8]) {
    let Some((&call, message)) = bytes.split_first() else { return };
    if message.len() <= MAX_MESSAGE_BYTES
        && let Some(Ok(command)) = command_of_call(call, message)
    {
        let mut world = begun();
        apply(&mut world, command);
        sim::fuzz::steps(&mut world);
    }
}

/// A world as OSC, its bodies named by the lines of a text, as pages may name them: every bundle is OSC, none is larger
/// than receivers read, and no body is lost.
pub fn osc(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let names: Vec<&str> =
        text.lines().filter(|name| name.len() <= MAX_NAME_BYTES).take(MAX_BODIES).collect();
    let ids = || 1u32..;
    let state = |(id, name): (u32, &&str)| BodyState {
        id,
        pose: Pose::IDENTITY,
        velocity_m_s: [0.0; 3],
        spin_rad_s: [0.0; 3],
        inside_samples: name.len() as u32 % 2,
        response_m: None,
        grabbed: false,
        asleep: false,
    };
    let look = |(id, name): (u32, &&str)| BodyLook {
        id,
        name: (*name).to_owned(),
        solid: Solid::Ball { radius_m: 0.1 },
        color: [0.5; 3],
        fixed: false,
    };
    let world = WorldState {
        generation: 0,
        step: 12,
        film_s: 0.1,
        frame: None,
        paused: false,
        bodies: ids().zip(&names).map(state).collect(),
        touches: vec![],
        patches: vec![],
    };
    let scene = SceneState {
        generation: 0,
        version: 0,
        scene: "fuzz".into(),
        bodies: ids().zip(&names).map(look).collect(),
        parameters: Parameters::default(),
        up: [0.0, 1.0, 0.0],
        floor_m: None,
    };
    let mut poses = 0;
    for bundle in bundles(&world, Some(&scene)) {
        assert!(bundle.len() <= MAX_BUNDLE_BYTES, "a bundle of {} bytes", bundle.len());
        let Ok((rest, OscPacket::Bundle(bundle))) = rosc::decoder::decode_udp(&bundle) else {
            panic!("no bundle")
        };
        assert!(rest.is_empty(), "{} bytes behind a bundle", rest.len());
        for packet in bundle.content {
            let OscPacket::Message(message) = packet else { panic!("a bundle in a bundle") };
            assert!(message.args.iter().all(|arg| !matches!(arg, OscType::Nil)), "{message:?}");
            poses += usize::from(message.addr.ends_with("/pose"));
        }
    }
    assert_eq!(poses, names.len(), "a pose a body");
}

/// A world of one ball over a floor.
fn begun() -> World {
    let text = "[[bodies]]\nname = \"ball\"\nshape.ball.radius = 0.1\nplace.at = [0, 1, 0]\n";
    let scene = Scene::from_toml("fuzz", text).expect("a scene");
    World::new(&scene, WorldSettings::default()).expect("a world")
}

/// As the coordinator applies it; a refusal is an answer.
fn apply(world: &mut World, command: Command) {
    let refusal = match command {
        Command::Spawn(spec) => world.prepare(*spec).and_then(|body| world.spawn(body)).err(),
        Command::Remove(body) => world.remove(body).err(),
        Command::Push { body, impulse_n_s, at_m } => world.push(body, impulse_n_s, at_m).err(),
        Command::Grab { body, grip_body_m, target_m } => world.grab(body, grip_body_m, target_m).err(),
        Command::Release { body, velocity_m_s } => world.release(body, velocity_m_s).err(),
        Command::Set(parameters) => world.set(parameters).err(),
        _ => None,
    };
    assert!(refusal.is_none_or(|refusal| !refusal.to_string().contains('\n')), "a refusal of one line");
}
