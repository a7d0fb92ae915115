//! What nodes and coordinators say besides questions and answers.

use bytes::Bytes;
use prost::Message;

use super::super::{
    claim_from_wire, clock_from_wire, clock_to_wire, description_from_wire, description_to_wire,
    film_event_from_wire, film_event_to_wire, frame_pictures_from_wire, node_clock_from_wire,
    picture_request_from_wire, picture_request_to_wire, settings_from_wire, settings_to_wire,
    shape_from_wire, shape_to_wire, start_from_wire, start_to_wire,
};
use crate::{CameraDescription, v1};

/// A message after its kind (a byte): one that is accepted and written again is the same.
pub fn node_messages(bytes: &[u8]) {
    let Some((&kind, message)) = bytes.split_first() else { return };
    match kind % 9 {
        0 => with(message, |found: v1::DescribeReply| {
            let Ok(read) = description_from_wire(found) else { return };
            assert_eq!(description_from_wire(description_to_wire(&read)), Ok(read));
        }),
        1 => with(message, |found: v1::FrameInfo| {
            let Ok(read) = film_event_from_wire(found, &cameras()) else { return };
            let again = film_event_to_wire(read.clone(), None);
            assert_eq!(film_event_from_wire(again, &cameras()), Ok(read));
        }),
        2 => with(message, |found: v1::FetchPicturesRequest| {
            let Ok(read) = picture_request_from_wire(found) else { return };
            assert_eq!(picture_request_from_wire(picture_request_to_wire(&read)), Ok(read));
        }),
        3 => with(message, |found: v1::Picture| {
            if let Ok(read) = frame_pictures_from_wire(vec![found.clone(), found], &cameras()) {
                panic!("two pictures of one camera: {read:?}");
            }
        }),
        4 => with(message, |found: v1::StartRequest| {
            let Ok(read) = start_from_wire(&found) else { return };
            assert_eq!(start_from_wire(&start_to_wire(read)), Ok(read));
        }),
        5 => with(message, |found: v1::ClockLine| {
            let Ok(read) = clock_from_wire(&found) else { return };
            assert_eq!(clock_from_wire(&clock_to_wire(read)), Ok(read));
        }),
        6 => with(message, |found: v1::Shape| {
            // A digest that fits is not found by chance.
            if let (Err(_), Some(shape)) = (shape_from_wire(&found), shape_of(&found.samples)) {
                assert_eq!(shape_from_wire(&shape_to_wire(&shape)), Ok(shape));
            }
        }),
        7 => with(message, |found: v1::ProbeSettings| {
            let Ok(read) = settings_from_wire(&found) else { return };
            assert_eq!(settings_from_wire(&settings_to_wire(&read)), Ok(read));
        }),
        _ => {
            with(message, |found: v1::HoldRequest| drop(claim_from_wire(found)));
            with(message, |found: v1::KeepTimeReply| {
                assert!(node_clock_from_wire(found).map_or(true, f64::is_finite), "seconds");
            });
        }
    }
}

fn with<M: Message + Default>(bytes: &[u8], check: impl FnOnce(M)) {
    if let Ok(message) = M::decode(bytes) {
        check(message);
    }
}

/// A shape of packed samples.
fn shape_of(samples: &Bytes) -> Option<hull::Shape> {
    let numbers = samples.as_chunks::<12>().0.iter().map(|triple| {
        [0, 4, 8].map(|at| f32::from_le_bytes([triple[at], triple[at + 1], triple[at + 2], triple[at + 3]]))
    });
    hull::Shape::new(numbers.collect()).ok()
}

/// Two cameras, as a node has described them.
fn cameras() -> Vec<CameraDescription> {
    let camera = |rig_index, size| CameraDescription {
        name: format!("camera {rig_index}"),
        rig_index,
        size,
        calibration_digest: [0; 32],
    };
    vec![camera(2, (64, 48)), camera(5, (16_384, 16_384))]
}
