//! Checkpoints written and read: whole, damaged, of others.

mod agreement;

use proptest::prelude::*;
use prost::Message as _;
use proto::{CheckpointError, MAX_CHECKPOINT_BYTES, open_checkpoint, seal_checkpoint};
use sim::{BodyRequest, BodyResponse, WorldSettings};
use world_encodings::checkpoint::message::{Body, Mass};
use world_encodings::{world_from_bytes, world_to_bytes};

use super::message::Kept;
use super::*;

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

const SHAPES: [&str; 5] = [
    "ball.radius = 0.1",
    "capsule = { radius = 0.1, length = 0.3 }",
    "cylinder = { radius = 0.1, height = 0.3 }",
    "cone = { radius = 0.1, height = 0.3 }",
    "hull.points = [[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3]]",
];

/// A world with a body of every form that has moved for a while.
fn world() -> World {
    let scene = Scene::from_toml("kept", SCENE).expect("a scene");
    let mut world = World::new(&scene, WorldSettings::default()).expect("a world");
    for (place, shape) in SHAPES.iter().enumerate() {
        let keys = format!("shape.{shape}\nposition = [{place}, 2, 0]\nvelocity = [0, 1, 0.1]");
        let request: BodyRequest = toml::from_str(&keys).expect("the keys of a request");
        let prepared = world.prepare(request.check().expect("a body")).expect("room");
        world.spawn(prepared).expect("spawned");
    }
    world.remove(1).expect("gone");
    world.push(0, [0.0, 0.1, 0.2], Some([0.6, 0.2, 0.3])).expect("pushed");
    for _ in 0..20 {
        let responses = vec![BodyResponse::UNTOUCHED; world.moving_bodies().len()];
        world.step(&responses).expect("a step");
    }
    world
}

fn checkpoint() -> Checkpoint {
    let kept = Moment { term: 1, run: 7, sequence: 3, unix_s: 1.8e9 };
    let world = world().snapshot();
    Checkpoint { place: Place { rig: [1; 32], scene: world.scene().digest() }, kept, world }
}

/// What is said of a checkpoint whose message was changed before it was sealed.
fn error_of(change: impl FnOnce(&mut Kept)) -> String {
    let bytes = checkpoint().to_bytes().expect("short");
    let mut message = Kept::decode(open_checkpoint(&bytes).expect("whole")).expect("a message");
    change(&mut message);
    let bytes = seal_checkpoint(&message.encode_to_vec()).expect("short");
    let error = Checkpoint::from_bytes(&bytes).expect_err("refused").to_string();
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

fn body(message: &mut Kept) -> &mut Body {
    &mut message.world.as_mut().expect("a world").bodies[0]
}

#[test]
fn a_checkpoint_is_read_as_it_was_written_to_the_bit() {
    let written = checkpoint();
    let bytes = written.to_bytes().expect("short");
    assert!(bytes.len() < 3000, "{} bytes of 8 bodies", bytes.len());
    assert_eq!(Checkpoint::from_bytes(&bytes), Ok(written.clone()));
    assert_eq!(world_from_bytes(&world_to_bytes(&written.world)), Ok(written.world));
}

#[test]
fn a_node_that_has_come_back_is_handed_a_world_before_its_turn() {
    let mut way = Way { free: Arc::new(Semaphore::new(1)), connections: 1 };
    let mut is_admitted = |connections, is_due| way.admit(connections, is_due).is_some();
    assert!(!is_admitted(1, false) && is_admitted(1, true));
    assert!(is_admitted(2, false), "it is back");
    assert!(!is_admitted(2, false), "it was handed one");
    let on_its_way = way.admit(2, true).expect("free");
    assert!(
        way.admit(3, false).is_none() && way.admit(3, true).is_none(),
        "it has yet to take the one before"
    );
    drop(on_its_way);
    assert!(way.admit(3, false).is_some());
}

#[test]
fn a_thousand_bodies_take_a_fifth_of_what_a_node_keeps() {
    let bodies = "[[bodies]]\nname = 'box'\nshape.box.size = [0.2, 0.2, 0.2]\ncount = 1000\nplace.stack.foot = [0, 0, 0]";
    let scene = Scene::from_toml("crowded", bodies).expect("a scene");
    let world = World::new(&scene, WorldSettings::default()).expect("a world").snapshot();
    let bytes = Checkpoint { world, ..checkpoint() }.to_bytes().expect("short");
    assert!(bytes.len() < MAX_CHECKPOINT_BYTES / 5, "{} bytes", bytes.len());
}

#[test]
fn a_quaternion_of_zeros_is_refused() {
    let error = error_of(|message| body(message).rotation_xyzw = vec![0.0; 4]);
    assert_eq!(
        error,
        "a checkpoint of no world: body 0: pose holds 0, expected finite numbers and a unit quaternion"
    );
}

#[test]
fn numbers_that_are_none_are_refused_wherever_they_stand() {
    type Change = fn(&mut Kept);
    let changes: [Change; 10] = [
        |message| body(message).position_m[1] = f64::NAN,
        |message| body(message).rotation_xyzw[1] = f64::NAN,
        |message| body(message).velocity_m_s[2] = f64::NAN,
        |message| body(message).spin_rad_s[0] = f64::INFINITY,
        |message| body(message).friction = f64::NAN,
        |message| body(message).color[0] = f32::NAN,
        |message| body(message).mass = Some(Mass::Kg(f64::NAN)),
        |message| message.world.as_mut().expect("a world").gravity_m_s2[0] = f64::NAN,
        |message| message.world.as_mut().expect("a world").solids[0].extents_m[0] = f64::NAN,
        |message| message.kept_unix_s = f64::NAN,
    ];
    for (place, change) in changes.into_iter().enumerate() {
        let error = error_of(change);
        assert!(error.starts_with("a checkpoint "), "{place}: {error}");
    }
}

#[test]
fn counts_and_names_that_cannot_be_are_refused_by_their_names() {
    type Change = fn(&mut Kept);
    let changes: [(Change, &str); 7] = [
        (|message| body(message).position_m.truncate(2), "position_m holds 2 numbers, expected 3"),
        (|message| body(message).solid = 99, "body 0: no form of a body has this place"),
        (|message| body(message).mass = None, "mass is missing"),
        (|message| body(message).id = 77, "bodies.id: 77, expected less than that of the next body"),
        (|message| message.world = None, "world is missing"),
        (
            |message| message.world.as_mut().expect("a world").solids[1].extents_m[0] = 80.0,
            "shape.box.size: 80, expected a number from 0.01 to 5",
        ),
        (
            |message| {
                let world = message.world.as_mut().expect("a world");
                let body = world.bodies[0].clone();
                world.bodies = vec![body; 1001];
            },
            "Kept.world.bodies: 1001 entries, expected at most 1000",
        ),
    ];
    for (change, expected) in changes {
        assert_eq!(error_of(change), format!("a checkpoint of no world: {expected}"));
    }
    assert_eq!(error_of(|message| message.rig.truncate(5)), "a checkpoint with a wrong rig");
    let error = error_of(|message| message.term = u64::MAX);
    assert_eq!(error, format!("a checkpoint of term {}, expected at most {}", u64::MAX, 1u64 << 62));
}

#[test]
fn half_a_million_empty_bodies_are_counted_before_they_are_decoded() {
    // Field 7, a message of so many bytes; in it field 11 as often as it fits, empty.
    let bodies = [0x5a, 0x00].repeat(500_000);
    let mut contents = vec![0x3a];
    prost::encoding::encode_varint(bodies.len() as u64, &mut contents);
    contents.extend_from_slice(&bodies);
    let bytes = seal_checkpoint(&contents).expect("short");
    let expected = "Kept.world.bodies: 500000 entries, expected at most 1000";
    let error = Checkpoint::from_bytes(&bytes).expect_err("refused").to_string();
    assert_eq!(error, format!("a checkpoint of no world: {expected}"));
}

#[test]
fn one_that_is_cut_in_half_is_refused() {
    let bytes = checkpoint().to_bytes().expect("short");
    let error = Checkpoint::from_bytes(&bytes[..bytes.len() / 2]).expect_err("cut");
    let expected = CheckpointError::Length { found: bytes.len() / 2, expected: bytes.len() };
    assert_eq!(error.to_string(), expected.to_string());
}

proptest! {
    #[test]
    fn flipped_bytes_are_always_refused(
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), 1..=255u8), 1..4),
    ) {
        let whole = checkpoint().to_bytes().expect("short");
        let mut bytes = whole.clone();
        for (place, by) in changes {
            let place = place.index(bytes.len());
            bytes[place] ^= by;
        }
        // Two flips at one place may undo each other.
        prop_assert_eq!(Checkpoint::from_bytes(&bytes).is_ok(), bytes == whole);
    }

    /// A peer may seal what it likes: what is read then is a world that the solver takes, or it is refused.
    #[test]
    fn flipped_bytes_below_a_right_digest_do_no_harm(
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), 1..=255u8), 1..4),
    ) {
        let whole = checkpoint().to_bytes().expect("short");
        let mut contents = open_checkpoint(&whole).expect("whole").to_vec();
        for (place, by) in changes {
            let place = place.index(contents.len());
            contents[place] ^= by;
        }
        let read = Checkpoint::from_bytes(&seal_checkpoint(&contents).expect("short"));
        if let Ok(Checkpoint { world: kept, .. }) = read
            && let Ok(mut going_on) = world().going_on(&kept)
        {
            let responses = vec![BodyResponse::UNTOUCHED; going_on.moving_bodies().len()];
            going_on.step(&responses).expect("a step");
            prop_assert!(going_on.bodies().iter().all(|body| body.pose.position_m().iter().all(|x| x.is_finite())));
        }
    }
}
