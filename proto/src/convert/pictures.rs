//! Requests for pictures and pictures: messages and back.

use hull::camera::MAX_SIDE_PIXELS;

use super::ConvertError;
use super::bulk::Field;
use super::film::{MAX_TIME_S, described, within};
use crate::{
    CameraDescription, CameraPicture, FramePictures, MAX_MESSAGE_BYTES, MAX_SCALE_LOG2, Picture, PictureKind,
    PictureRequest, v1,
};
use v1::fetch_pictures_request::Kind;

/// The most bytes of a picture's runs, or of its colours: noise at the best quality takes less.
const MOST_BYTES_A_PIXEL: usize = 4;
const MOST_BYTES_BESIDE: usize = 1 << 16;

fn most_bytes_of_a_part((width, height): (u32, u32)) -> usize {
    MOST_BYTES_A_PIXEL * width as usize * height as usize + MOST_BYTES_BESIDE
}

/// No message with a picture of a camera of that width and height, pixels, is longer, bytes: runs and colours.
pub fn most_picture_bytes(size: (u32, u32)) -> usize {
    (2 * most_bytes_of_a_part(size)).min(MAX_MESSAGE_BYTES)
}
/// Stands for the newest frame.
const NEWEST: u64 = u64::MAX;

/// A request, of the cameras it names.
pub fn picture_request_to_wire(request: &PictureRequest) -> v1::FetchPicturesRequest {
    let &PictureRequest { frame, kind, scale_log2, jpeg_quality, ref cameras } = request;
    let kind = match kind {
        PictureKind::Silhouettes => Kind::Silhouettes,
        PictureKind::Crops => Kind::Crops,
        PictureKind::Whole => Kind::Whole,
    };
    v1::FetchPicturesRequest {
        frame: frame.unwrap_or(NEWEST),
        scale_log2: scale_log2.into(),
        jpeg_quality: jpeg_quality.into(),
        kind: kind.into(),
        cameras: cameras.iter().map(|&camera| camera.into()).collect(),
    }
}

/// A request that makes sense; its cameras are for the node to know.
pub fn picture_request_from_wire(request: v1::FetchPicturesRequest) -> Result<PictureRequest, ConvertError> {
    let kind = match request.kind() {
        Kind::Silhouettes => PictureKind::Silhouettes,
        Kind::Crops => PictureKind::Crops,
        Kind::Whole => PictureKind::Whole,
    };
    let v1::FetchPicturesRequest { frame, scale_log2, jpeg_quality, kind: _, cameras } = request;
    let field = |name| Field("FetchPicturesRequest", name);
    let camera = |camera: u32| {
        let wrong = || field("cameras").value(format!("holds {camera}, expected places in the rig"));
        u16::try_from(camera).map_err(|_| wrong())
    };
    Ok(PictureRequest {
        frame: (frame != NEWEST).then_some(frame),
        kind,
        scale_log2: number(scale_log2, 0, MAX_SCALE_LOG2, field("scale_log2"))?,
        jpeg_quality: number(jpeg_quality, 1, 100, field("jpeg_quality"))?,
        cameras: cameras.into_iter().map(camera).collect::<Result<_, _>>()?,
    })
}

fn number(found: u32, low: u8, high: u8, field: Field) -> Result<u8, ConvertError> {
    let number = u8::try_from(found).ok().filter(|number| (low..=high).contains(number));
    number.ok_or_else(|| field.value(format!("is {found}, expected {low} to {high}")))
}

/// A picture.
pub fn picture_to_wire(picture: Picture) -> v1::Picture {
    let Picture { frame, captured_unix_s, camera } = picture;
    let CameraPicture { rig_index, runs, scale_log2, crop, jpeg } = camera;
    let ([left, top, width, height], rig_index, scale_log2) =
        (crop.map(u32::from), rig_index.into(), scale_log2.into());
    v1::Picture { rig_index, runs, left, top, width, height, jpeg, frame, captured_unix_s, scale_log2 }
}

/// The pictures of a node with these cameras: all of one frame, at most one a camera.
pub fn frame_pictures_from_wire(
    pictures: Vec<v1::Picture>,
    cameras: &[CameraDescription],
) -> Result<FramePictures, ConvertError> {
    let mut found = FramePictures { frame: 0, captured_unix_s: 0.0, cameras: Vec::new() };
    let field = |name| Field("Picture", name);
    for (at, picture) in pictures.into_iter().enumerate() {
        let Picture { frame, captured_unix_s, camera } = picture_from_wire(picture, cameras)?;
        if at > 0 && frame != found.frame {
            return Err(field("frame").value(format!("is {frame}, expected {}", found.frame)));
        }
        if found.cameras.iter().any(|other| other.rig_index == camera.rig_index) {
            return Err(field("rig_index").value(format!("is {} twice", camera.rig_index)));
        }
        (found.frame, found.captured_unix_s) = (frame, captured_unix_s);
        found.cameras.push(camera);
    }
    Ok(found)
}

fn picture_from_wire(picture: v1::Picture, cameras: &[CameraDescription]) -> Result<Picture, ConvertError> {
    let v1::Picture { rig_index, runs, left, top, width, height, jpeg, frame, captured_unix_s, scale_log2 } =
        picture;
    let field = |name| Field("Picture", name);
    let described = described(rig_index, cameras, field("rig_index"))?;
    let sides = [left, top, width, height];
    if let Some(side) = sides.into_iter().find(|&side| side > MAX_SIDE_PIXELS) {
        return Err(field("left, top, width, height")
            .value(format!("holds {side}, expected at most {MAX_SIDE_PIXELS}")));
    }
    let (across, down) = described.size;
    if left + width > across || top + height > down {
        let found = format!("end at {} x {}", left + width, top + height);
        return Err(
            field("left, top, width, height").value(format!("{found}, expected within {across} x {down}"))
        );
    }
    let most = most_bytes_of_a_part(described.size);
    for (name, length) in [("runs", runs.len()), ("jpeg", jpeg.len())] {
        if length > most {
            return Err(field(name).value(format!("holds {length} bytes, expected at most {most}")));
        }
    }
    let captured_unix_s = within(captured_unix_s, 0.0, MAX_TIME_S, field("captured_unix_s"))?;
    let scale_log2 = number(scale_log2, 0, MAX_SCALE_LOG2, field("scale_log2"))?;
    let crop = sides.map(|side| side as u16);
    let camera = CameraPicture { rig_index: described.rig_index, runs, scale_log2, crop, jpeg };
    Ok(Picture { frame, captured_unix_s, camera })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras() -> Vec<CameraDescription> {
        let (name, size) = (String::from("left"), (64, 48));
        vec![CameraDescription { name, rig_index: 4, size, calibration_digest: [0; 32] }]
    }

    fn picture() -> Picture {
        let camera =
            CameraPicture { rig_index: 4, crop: [8, 8, 16, 24], scale_log2: 1, ..Default::default() };
        Picture { frame: 9, captured_unix_s: 1.7e9, camera }
    }

    #[test]
    fn pictures_and_requests_come_back() {
        let back = frame_pictures_from_wire(vec![picture_to_wire(picture())], &cameras());
        let Picture { frame, captured_unix_s, camera } = picture();
        assert_eq!(back, Ok(FramePictures { frame, captured_unix_s, cameras: vec![camera] }));
        for frame in [None, Some(7)] {
            let request = PictureRequest {
                frame,
                kind: PictureKind::Crops,
                scale_log2: 3,
                jpeg_quality: 80,
                cameras: vec![1, 4],
            };
            assert_eq!(picture_request_from_wire(picture_request_to_wire(&request)), Ok(request));
        }
    }

    #[test]
    fn a_picture_that_cannot_be_is_refused_by_field() {
        type Lie = fn(&mut v1::Picture);
        let lies: [(Lie, &str); 6] = [
            (
                |picture| picture.rig_index = 5,
                "Picture.rig_index: is 5, expected one of the node's cameras 4",
            ),
            (|picture| picture.width = 70_000, "Picture.left, top, width, height: holds 70000"),
            (
                |picture| picture.width = 57,
                "Picture.left, top, width, height: end at 65 x 32, expected within 64 x 48",
            ),
            (
                |picture| picture.jpeg = vec![0; 80_000].into(),
                "Picture.jpeg: holds 80000 bytes, expected at most 77824",
            ),
            (|picture| picture.captured_unix_s = f64::NAN, "Picture.captured_unix_s: is NaN"),
            (|picture| picture.scale_log2 = 4, "Picture.scale_log2: is 4, expected 0 to 3"),
        ];
        for (lie, expected) in lies {
            let mut wire = picture_to_wire(picture());
            lie(&mut wire);
            let error = frame_pictures_from_wire(vec![wire], &cameras()).expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        let twice = vec![picture_to_wire(picture()), picture_to_wire(picture())];
        let error = frame_pictures_from_wire(twice, &cameras()).expect_err("twice").to_string();
        assert_eq!(error, "Picture.rig_index: is 4 twice");
    }
}
