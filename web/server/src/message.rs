//! The feed's binary messages: little-endian, a header of 16 bytes, a table, payloads. Pure: no time, no
//! network.
//!
//! ```text
//! header      u32 magic "HTF1" | u8 type | u8 version | u16 count | u32 seq | u32 total bytes
//! frame set   header | u64 frame | f64 captured | f64 film | u32 flags | u32 0 | count × camera | payloads
//! camera      u16 place in the rig | u8 kind | u8 scale | u16 left, top, width, height
//!             | u32 runs offset, length | u32 jpeg offset, length | u32 0
//! world       header | u32 generation | u32 flags | u64 step | f64 film | u64 frame | count × body
//!             | u32 touches | touches × touch | where there are any: u32 patches | patches × patch
//! ```

use bytes::{BufMut as _, Bytes, BytesMut};
use coordinator::live::{BodyState, HullPatch, TouchPoint, WorldState};

use crate::text::VERSION;
use proto::{CameraPicture, FramePictures};
use sim::MAX_PATCHES;

/// The first four bytes of every message, as a little-endian number.
pub const MAGIC: u32 = u32::from_le_bytes(*b"HTF1");
/// Bytes of a header.
pub const HEADER_BYTES: usize = 16;
/// Bytes of a frame set before its cameras, the header included.
pub const FRAME_SET_BYTES: usize = HEADER_BYTES + 32;
/// Bytes of a camera's entry.
pub const CAMERA_BYTES: usize = 32;
/// Bytes of a world before its bodies, the header included.
pub const WORLD_BYTES: usize = HEADER_BYTES + 32;
/// Bytes of a body.
pub const BODY_BYTES: usize = 48;
/// Bytes of a touch.
pub const TOUCH_BYTES: usize = 28;
/// Bytes of a patch.
pub const PATCH_BYTES: usize = 52;
/// The most touches that a message carries: what a page can draw, 115 KB.
pub const MAX_TOUCHES: usize = 4096;

/// A camera's runs are there.
pub const HAS_RUNS: u8 = 1;
/// A camera's JPEG is there.
pub const HAS_JPEG: u8 = 2;
/// Images are thumbnails.
pub const THUMBNAILS: u32 = 1;
/// The world is paused.
pub const PAUSED: u32 = 1;
/// There was no hull at that step.
pub const BLIND: u32 = 2;
/// The body touches the hull.
pub const TOUCHING: u16 = 1;
/// A page or program holds the body.
pub const GRABBED: u16 = 2;
/// The solver has put the body to sleep.
pub const ASLEEP: u16 = 4;

/// The kind of a binary message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum MessageKind {
    /// Silhouettes and colours of one frame.
    FrameSet = 1,
    /// Bodies after a step.
    World = 2,
    /// Whole images.
    Images = 3,
}

/// What a world's message holds besides bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorldParts {
    /// The samples that touch.
    pub touches: bool,
    /// The hull's surface at the bodies.
    pub patches: bool,
}

fn begin(kind: MessageKind, count: usize, seq: u32, total: usize) -> BytesMut {
    let mut bytes = BytesMut::with_capacity(total);
    bytes.put_u32_le(MAGIC);
    bytes.put_u8(kind as u8);
    bytes.put_u8(VERSION);
    bytes.put_u16_le(count as u16);
    bytes.put_u32_le(seq);
    // The images of a thousand cameras are below 4 GB.
    bytes.put_u32_le(total as u32);
    bytes
}

fn padded(length: usize) -> usize {
    length.next_multiple_of(4)
}

/// Silhouettes and colours of one frame.
pub fn frame_set(seq: u32, fps: f64, pictures: &FramePictures) -> Bytes {
    pictures_message(MessageKind::FrameSet, seq, fps, 0, pictures)
}

/// Whole images of one frame.
pub fn images(seq: u32, fps: f64, are_thumbnails: bool, pictures: &FramePictures) -> Bytes {
    pictures_message(MessageKind::Images, seq, fps, if are_thumbnails { THUMBNAILS } else { 0 }, pictures)
}

fn pictures_message(kind: MessageKind, seq: u32, fps: f64, flags: u32, pictures: &FramePictures) -> Bytes {
    let cameras = &pictures.cameras[..pictures.cameras.len().min(usize::from(u16::MAX))];
    let first = FRAME_SET_BYTES + CAMERA_BYTES * cameras.len();
    let payload = |camera: &CameraPicture| padded(camera.runs.len()) + padded(camera.jpeg.len());
    let total = first + cameras.iter().map(payload).sum::<usize>();
    let mut bytes = begin(kind, cameras.len(), seq, total);
    bytes.put_u64_le(pictures.frame);
    bytes.put_f64_le(pictures.captured_unix_s);
    bytes.put_f64_le(pictures.frame as f64 / fps);
    bytes.put_u32_le(flags);
    bytes.put_u32_le(0);
    let mut at = first;
    for camera in cameras {
        let has = |data: &Bytes, bit: u8| if data.is_empty() { 0 } else { bit };
        bytes.put_u16_le(camera.rig_index);
        bytes.put_u8(has(&camera.runs, HAS_RUNS) | has(&camera.jpeg, HAS_JPEG));
        bytes.put_u8(camera.scale_log2);
        camera.crop.iter().for_each(|&side| bytes.put_u16_le(side));
        for data in [&camera.runs, &camera.jpeg] {
            bytes.put_u32_le(at as u32);
            bytes.put_u32_le(data.len() as u32);
            at += padded(data.len());
        }
        bytes.put_u32_le(0);
    }
    for data in cameras.iter().flat_map(|camera| [&camera.runs, &camera.jpeg]) {
        bytes.put_slice(data);
        bytes.put_bytes(0, padded(data.len()) - data.len());
    }
    bytes.freeze()
}

/// Bodies after a step, with some of what there is at them.
pub fn world(seq: u32, world: &WorldState, parts: WorldParts) -> Bytes {
    let bodies = &world.bodies[..world.bodies.len().min(usize::from(u16::MAX))];
    let touches = if parts.touches { &world.touches[..] } else { &[] };
    let touches = &touches[..touches.len().min(MAX_TOUCHES)];
    let patches = if parts.patches { &world.patches[..] } else { &[] };
    let patches = &patches[..patches.len().min(MAX_PATCHES * bodies.len())];
    let patches_bytes = if patches.is_empty() { 0 } else { 4 + PATCH_BYTES * patches.len() };
    let total = WORLD_BYTES + BODY_BYTES * bodies.len() + 4 + TOUCH_BYTES * touches.len() + patches_bytes;
    let mut bytes = begin(MessageKind::World, bodies.len(), seq, total);
    bytes.put_u32_le(world.generation);
    let flag = |is: bool, bit: u32| if is { bit } else { 0 };
    bytes.put_u32_le(flag(world.paused, PAUSED) | flag(world.frame.is_none(), BLIND));
    bytes.put_u64_le(world.step);
    bytes.put_f64_le(world.film_s);
    bytes.put_u64_le(world.frame.unwrap_or(u64::MAX));
    bodies.iter().for_each(|body| put_body(&mut bytes, body));
    bytes.put_u32_le(touches.len() as u32);
    touches.iter().for_each(|touch| put_touch(&mut bytes, touch));
    // A world without any is what it was before there were patches.
    if !patches.is_empty() {
        bytes.put_u32_le(patches.len() as u32);
        patches.iter().for_each(|patch| put_patch(&mut bytes, patch));
    }
    bytes.freeze()
}

fn put_body(bytes: &mut BytesMut, body: &BodyState) {
    let flag = |is: bool, bit: u16| if is { bit } else { 0 };
    bytes.put_u32_le(body.id);
    bytes.put_u16_le(
        flag(body.inside_samples > 0, TOUCHING) | flag(body.grabbed, GRABBED) | flag(body.asleep, ASLEEP),
    );
    bytes.put_u16_le(body.inside_samples.min(u32::from(u16::MAX)) as u16);
    let position = body.pose.position_m();
    let rotation = body.pose.rotation_xyzw();
    let response = body.response_m.unwrap_or_default();
    position.iter().chain(&rotation).chain(&response).for_each(|&value| bytes.put_f32_le(value as f32));
}

fn put_touch(bytes: &mut BytesMut, touch: &TouchPoint) {
    bytes.put_u32_le(touch.body);
    touch.point_m.iter().chain(&touch.response_m).for_each(|&value| bytes.put_f32_le(value));
}

fn put_patch(bytes: &mut BytesMut, patch: &HullPatch) {
    let HullPatch { body, point_m, normal_world, velocity_m_s, depth_m, radius_m, samples } = patch;
    bytes.put_u32_le(*body);
    bytes.put_u32_le(*samples);
    let numbers = point_m.iter().chain(normal_world).chain(velocity_m_s).chain([depth_m, radius_m]);
    numbers.for_each(|&value| bytes.put_f32_le(value));
}

#[cfg(test)]
mod tests {
    use super::*;
    use hull::Pose;

    fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
        bytes[at..at + N].try_into().expect("long enough")
    }

    fn pictures() -> FramePictures {
        let camera = |camera: u16, runs: &'static [u8], jpeg: &'static [u8]| CameraPicture {
            rig_index: camera,
            runs: Bytes::from_static(runs),
            scale_log2: u8::from(!jpeg.is_empty()),
            crop: if jpeg.is_empty() { [0; 4] } else { [16, 32, 48, 64] },
            jpeg: Bytes::from_static(jpeg),
        };
        FramePictures {
            frame: 90,
            captured_unix_s: 1_700_000_000.25,
            cameras: vec![camera(0, &[1, 2, 3], &[9; 5]), camera(3, &[4, 5, 6, 7], &[])],
        }
    }

    #[test]
    fn payloads_are_aligned_and_found_by_their_offsets() {
        let bytes = frame_set(7, 30.0, &pictures());
        assert_eq!(&bytes[..4], b"HTF1");
        assert_eq!((bytes[4], bytes[5]), (1, 1));
        assert_eq!(u16::from_le_bytes(number(&bytes, 6)), 2);
        assert_eq!(u32::from_le_bytes(number(&bytes, 12)) as usize, bytes.len());
        assert_eq!(f64::from_le_bytes(number(&bytes, 32)), 3.0, "film time is frame over fps");
        for (place, expected) in [(0, (&[1u8, 2, 3][..], &[9u8; 5][..])), (1, (&[4, 5, 6, 7], &[]))] {
            let entry = FRAME_SET_BYTES + place * CAMERA_BYTES;
            let payload = |at: usize| {
                let offset = u32::from_le_bytes(number(&bytes, entry + at)) as usize;
                let length = u32::from_le_bytes(number(&bytes, entry + at + 4)) as usize;
                assert_eq!(offset % 4, 0);
                &bytes[offset..offset + length]
            };
            assert_eq!((payload(12), payload(20)), expected);
        }
        assert_eq!(bytes[FRAME_SET_BYTES + 2], HAS_RUNS | HAS_JPEG);
        assert_eq!(bytes[FRAME_SET_BYTES + CAMERA_BYTES + 2], HAS_RUNS);
    }

    pub(crate) fn a_world() -> WorldState {
        let body = |id: u32, touching: bool| BodyState {
            id,
            pose: Pose::new([f64::from(id), 0.5, -0.25], [0.0, 1.0, 0.0, 0.0]).expect("a pose"),
            velocity_m_s: [0.0; 3],
            spin_rad_s: [0.0; 3],
            inside_samples: if touching { 70_000 } else { 0 },
            response_m: touching.then_some([0.0, 0.125, 0.0]),
            grabbed: touching,
            asleep: !touching,
        };
        let touch = TouchPoint { body: 1, point_m: [1.0, 0.5, -0.25], response_m: [0.0, 0.5, 0.0] };
        WorldState {
            generation: 2,
            step: 360,
            film_s: 3.0,
            frame: Some(90),
            paused: true,
            bodies: vec![body(4, false), body(5, true)],
            touches: vec![touch],
            patches: vec![],
        }
    }

    const TOUCHES: WorldParts = WorldParts { touches: true, patches: false };

    #[test]
    fn patches_follow_the_touches_where_they_are_wanted_and_there_are_any() {
        let patch = HullPatch {
            body: 1,
            point_m: [1.0, 0.5, -0.25],
            normal_world: [0.0, 1.0, 0.0],
            velocity_m_s: [0.5, 0.25, 0.0],
            depth_m: -0.125,
            radius_m: 0.0625,
            samples: 9,
        };
        let all = WorldParts { touches: true, patches: true };
        let before = world(8, &a_world(), all);
        assert_eq!(before, world(8, &a_world(), TOUCHES), "without any, nothing says so");
        let touched = WorldState { patches: vec![patch; 3], ..a_world() };
        assert_eq!(world(8, &touched, TOUCHES), before);
        let bytes = world(8, &touched, all);
        assert_eq!(bytes.len(), before.len() + 4 + 3 * PATCH_BYTES);
        let at = before.len();
        assert_eq!(u32::from_le_bytes(number(&bytes, at)), 3);
        assert_eq!([4, 8].map(|more| u32::from_le_bytes(number(&bytes, at + more))), [1, 9]);
        let numbers = (0..11).map(|place| f32::from_le_bytes(number(&bytes, at + 12 + 4 * place)));
        let expected = [1.0, 0.5, -0.25, 0.0, 1.0, 0.0, 0.5, 0.25, 0.0, -0.125, 0.0625];
        assert!(numbers.eq(expected), "point, normal, velocity, depth, radius");
        let crowded = WorldState { patches: vec![patch; 99], ..a_world() };
        assert_eq!(world(8, &crowded, all).len(), before.len() + 4 + 8 * PATCH_BYTES, "four a body");
    }

    #[test]
    fn bodies_stand_where_the_header_says() {
        let bytes = world(8, &a_world(), TOUCHES);
        assert_eq!(bytes.len(), WORLD_BYTES + 2 * BODY_BYTES + 4 + TOUCH_BYTES);
        assert_eq!(u32::from_le_bytes(number(&bytes, 20)), PAUSED);
        assert_eq!(u64::from_le_bytes(number(&bytes, 40)), 90);
        let second = WORLD_BYTES + BODY_BYTES;
        assert_eq!(u16::from_le_bytes(number(&bytes, second + 4)), TOUCHING | GRABBED);
        assert_eq!(u16::from_le_bytes(number(&bytes, second + 6)), u16::MAX, "counts saturate");
        assert_eq!(f32::from_le_bytes(number(&bytes, second + 8)), 5.0);
        assert_eq!(f32::from_le_bytes(number(&bytes, second + 40)), 0.125);
        assert_eq!(world(8, &a_world(), WorldParts::default()).len(), bytes.len() - TOUCH_BYTES);
        let blind = WorldState { frame: None, paused: false, ..a_world() };
        assert_eq!(u32::from_le_bytes(number(&world(8, &blind, WorldParts::default()), 20)), BLIND);
    }
}
