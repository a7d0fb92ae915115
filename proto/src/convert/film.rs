//! What is reported of film: messages and back.

use film_time::{CameraPace, CameraReport, FilmEvent, FrameReport, Stamps};

use super::ConvertError;
use super::bulk::Field;
use super::from_wire::pixel_rect_from_wire;
use super::to_wire::pixel_rect_to_wire;
use crate::text::{MAX_MESSAGE_CHARS, clean};
use crate::{CameraDescription, MAX_MESSAGE_BYTES, v1};

/// The greatest frame number: film of a million years, and exact as a float.
pub(super) const MAX_FRAME: u64 = 1 << 53;
/// Times lie within this, seconds: the year 2286.
pub(super) const MAX_TIME_S: f64 = 1e10;
/// No camera's segmentation takes longer, milliseconds.
const MAX_SEGMENT_MS: f64 = 1e7;
/// No camera films faster, frames per second.
pub(super) const MAX_FRAMES_PER_S: f64 = 1e6;

/// A number within a range; NaN is in none.
pub(super) fn within(value: f64, low: f64, high: f64, field: Field) -> Result<f64, ConvertError> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(field.value(format!("is {value}, expected {low} to {high}")))
}

/// An event of film; `last_frame` is the newest frame that was reported before, if any. Of which run it is, the sender adds.
pub fn film_event_to_wire(event: FilmEvent, last_frame: Option<u64>) -> v1::FrameInfo {
    let end = |failure| {
        let frame = last_frame.unwrap_or_default();
        v1::FrameInfo { frame, ended: true, failure, ..v1::FrameInfo::default() }
    };
    match event {
        FilmEvent::Frame(report) => frame_report_to_wire(report),
        FilmEvent::Ended => end(String::new()),
        FilmEvent::Failed(why) => end(why),
    }
}

fn frame_report_to_wire(report: FrameReport) -> v1::FrameInfo {
    let FrameReport { frame, capture_time_s, captured_unix_s, cameras, skipped } = report;
    let camera = |camera: CameraReport| {
        let CameraReport { rig_index, admitted, area, silhouette_bytes, segment_ms, late_s, stamps, pace } =
            camera;
        let (rig_index, admitted) = (rig_index.into(), admitted.map(pixel_rect_to_wire));
        let stamps = stamps_to_wire(stamps).into();
        let pace = pace.map(pace_to_wire);
        v1::CameraFrame { rig_index, admitted, area, silhouette_bytes, segment_ms, late_s, stamps, pace }
    };
    v1::FrameInfo {
        frame,
        capture_time_s,
        captured_unix_s,
        cameras: cameras.into_iter().map(camera).collect(),
        skipped,
        ..v1::FrameInfo::default()
    }
}

/// An event of film of a node with these cameras. A frame must report some of them, each once, and no other: it may have
/// gone on without one that films nothing.
pub fn film_event_from_wire(
    info: v1::FrameInfo,
    cameras: &[CameraDescription],
) -> Result<FilmEvent, ConvertError> {
    let v1::FrameInfo {
        frame,
        capture_time_s,
        captured_unix_s,
        cameras: found,
        skipped,
        ended,
        failure,
        run: _,
    } = info;
    if ended {
        let why = clean(&failure, MAX_MESSAGE_CHARS);
        return Ok(match (failure.is_empty(), why.is_empty()) {
            (true, _) => FilmEvent::Ended,
            // It failed, even if nothing printable is left of its reason.
            (false, true) => FilmEvent::Failed("it gave no reason".into()),
            (false, false) => FilmEvent::Failed(why),
        });
    }
    let field = |name| Field("FrameInfo", name);
    for (name, number) in [("frame", frame), ("skipped", skipped)] {
        if number > MAX_FRAME {
            return Err(field(name).value(format!("is {number}, expected at most {MAX_FRAME}")));
        }
    }
    if !(1..=cameras.len()).contains(&found.len()) {
        let (found, most) = (found.len(), cameras.len());
        return Err(field("cameras").value(format!("holds {found}, expected 1 to {most}")));
    }
    let mut reports: Vec<CameraReport> = Vec::with_capacity(cameras.len());
    for camera in &found {
        let report = camera_report_from_wire(camera, cameras)?;
        if reports.iter().any(|other| other.rig_index == report.rig_index) {
            return Err(field("cameras").value(format!("holds camera {} twice", report.rig_index)));
        }
        reports.push(report);
    }
    Ok(FilmEvent::Frame(FrameReport {
        frame,
        capture_time_s: within(capture_time_s, -MAX_TIME_S, MAX_TIME_S, field("capture_time_s"))?,
        captured_unix_s: within(captured_unix_s, 0.0, MAX_TIME_S, field("captured_unix_s"))?,
        cameras: reports,
        skipped,
    }))
}

fn camera_report_from_wire(
    camera: &v1::CameraFrame,
    cameras: &[CameraDescription],
) -> Result<CameraReport, ConvertError> {
    let &v1::CameraFrame { rig_index, admitted, area, silhouette_bytes, segment_ms, late_s, stamps: _, pace } =
        camera;
    let field = |name| Field("CameraFrame", name);
    let described = described(rig_index, cameras, field("rig_index"))?;
    let (width, height) = described.size;
    let admitted = admitted.as_ref().map(pixel_rect_from_wire).transpose()?;
    if let Some(rect) = admitted.filter(|rect| rect.right > width || rect.bottom > height) {
        let found = format!("ends at {} x {}", rect.right, rect.bottom);
        return Err(field("admitted").value(format!("{found}, expected within {width} x {height}")));
    }
    let most =
        admitted.map_or(0, |rect| u64::from(rect.right - rect.left) * u64::from(rect.bottom - rect.top));
    if area > most {
        return Err(field("area").value(format!("is {area}, expected at most {most}, all that is admitted")));
    }
    if silhouette_bytes as usize > MAX_MESSAGE_BYTES {
        let what = format!("is {silhouette_bytes}, expected at most {MAX_MESSAGE_BYTES}");
        return Err(field("silhouette_bytes").value(what));
    }
    let segment_ms = within(segment_ms, 0.0, MAX_SEGMENT_MS, field("segment_ms"))?;
    let late_s = within(late_s, -MAX_TIME_S, MAX_TIME_S, field("late_s"))?;
    let stamps = stamps_from_wire(camera.stamps());
    let pace = pace.map(pace_from_wire).transpose()?;
    let rig_index = described.rig_index;
    Ok(CameraReport { rig_index, admitted, area, silhouette_bytes, segment_ms, late_s, stamps, pace })
}

pub(super) fn pace_to_wire(CameraPace { phase, frames_per_s }: CameraPace) -> v1::CameraPace {
    v1::CameraPace { phase, frames_per_s }
}

pub(super) fn pace_from_wire(pace: v1::CameraPace) -> Result<CameraPace, ConvertError> {
    let field = |name| Field("CameraPace", name);
    Ok(CameraPace {
        phase: within(pace.phase, 0.0, 1.0, field("phase"))?,
        frames_per_s: within(pace.frames_per_s, 0.0, MAX_FRAMES_PER_S, field("frames_per_s"))?,
    })
}

pub(super) fn stamps_to_wire(stamps: Stamps) -> v1::Stamps {
    match stamps {
        Stamps::Index => v1::Stamps::Index,
        Stamps::Counter => v1::Stamps::Counter,
        Stamps::Capture => v1::Stamps::Capture,
        Stamps::Arrival => v1::Stamps::Arrival,
    }
}

pub(super) fn stamps_from_wire(stamps: v1::Stamps) -> Stamps {
    match stamps {
        v1::Stamps::Index => Stamps::Index,
        v1::Stamps::Counter => Stamps::Counter,
        v1::Stamps::Capture => Stamps::Capture,
        v1::Stamps::Arrival => Stamps::Arrival,
    }
}

/// The one of a node's cameras that has this place in the rig.
pub(super) fn described(
    rig_index: u32,
    cameras: &[CameraDescription],
    field: Field,
) -> Result<&CameraDescription, ConvertError> {
    let found = cameras.iter().find(|camera| u32::from(camera.rig_index) == rig_index);
    found.ok_or_else(|| {
        let places: Vec<String> = cameras.iter().map(|camera| camera.rig_index.to_string()).collect();
        field.value(format!("is {rig_index}, expected one of the node's cameras {}", places.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hull::silhouette::PixelRect;

    /// A node of cameras 2 and 5, of 64 × 48 pixels.
    fn cameras() -> Vec<CameraDescription> {
        let camera = |rig_index| CameraDescription {
            name: format!("camera {rig_index}"),
            rig_index,
            size: (64, 48),
            calibration_digest: [0; 32],
        };
        vec![camera(2), camera(5)]
    }

    fn report() -> FrameReport {
        let rect = PixelRect { left: 3, top: 4, right: 64, bottom: 48 };
        let camera = |rig_index, admitted, area| CameraReport {
            rig_index,
            admitted,
            area,
            silhouette_bytes: 90,
            segment_ms: 0.5,
            late_s: 0.02,
            stamps: Stamps::Capture,
            pace: Some(CameraPace { phase: 0.25, frames_per_s: 29.97 }),
        };
        FrameReport {
            frame: 7,
            capture_time_s: 7.0 / 30.0,
            captured_unix_s: 1.7e9,
            cameras: vec![camera(2, Some(rect), 61 * 44), camera(5, None, 0)],
            skipped: 1,
        }
    }

    #[test]
    fn a_failure_without_a_printable_reason_is_no_end() {
        let wire = film_event_to_wire(FilmEvent::Failed("\u{0}".into()), None);
        let expected = FilmEvent::Failed("it gave no reason".into());
        assert_eq!(film_event_from_wire(wire, &cameras()), Ok(expected));
    }

    #[test]
    fn events_come_back() {
        for event in [FilmEvent::Frame(report()), FilmEvent::Ended, FilmEvent::Failed("no disk".into())] {
            let wire = film_event_to_wire(event.clone(), Some(6));
            assert_eq!(film_event_from_wire(wire, &cameras()), Ok(event));
        }
    }

    #[test]
    fn a_report_that_cannot_be_is_refused_by_field() {
        type Lie = fn(&mut v1::FrameInfo);
        let lies: [(Lie, &str); 15] = [
            (
                |info| info.cameras[0].rig_index = 65_538,
                "CameraFrame.rig_index: is 65538, expected one of the node's cameras 2, 5",
            ),
            (
                |info| info.cameras[0].rig_index = 3,
                "CameraFrame.rig_index: is 3, expected one of the node's cameras 2, 5",
            ),
            (
                |info| info.cameras[0].pace = Some(v1::CameraPace { phase: 1.5, frames_per_s: 30.0 }),
                "CameraPace.phase: is 1.5, expected 0 to 1",
            ),
            (
                |info| info.cameras[0].pace = Some(v1::CameraPace { phase: 0.5, frames_per_s: f64::NAN }),
                "CameraPace.frames_per_s: is NaN, expected 0 to 1000000",
            ),
            (|info| info.cameras[0].rig_index = 5, "FrameInfo.cameras: holds camera 5 twice"),
            (|info| info.cameras.clear(), "FrameInfo.cameras: holds 0, expected 1 to 2"),
            (
                |info| info.cameras = vec![v1::CameraFrame::default(); 1_000_000],
                "FrameInfo.cameras: holds 1000000, expected 1 to 2",
            ),
            (
                |info| info.cameras[0].area += 1,
                "CameraFrame.area: is 2685, expected at most 2684, all that is admitted",
            ),
            (
                |info| info.cameras[1].area = 1,
                "CameraFrame.area: is 1, expected at most 0, all that is admitted",
            ),
            (
                |info| {
                    info.cameras[0].admitted = Some(v1::PixelRect { left: 0, top: 0, right: 65, bottom: 9 });
                },
                "CameraFrame.admitted: ends at 65 x 9, expected within 64 x 48",
            ),
            (
                |info| info.cameras[0].segment_ms = f64::NAN,
                "CameraFrame.segment_ms: is NaN, expected 0 to 10000000",
            ),
            (
                |info| info.cameras[0].silhouette_bytes = u32::MAX,
                "CameraFrame.silhouette_bytes: is 4294967295, expected at most 50331648",
            ),
            (
                |info| info.capture_time_s = f64::NAN,
                "FrameInfo.capture_time_s: is NaN, expected -10000000000 to 10000000000",
            ),
            (|info| info.captured_unix_s = 1e308, "FrameInfo.captured_unix_s: is 1"),
            (
                |info| info.frame = u64::MAX,
                "FrameInfo.frame: is 18446744073709551615, expected at most 9007199254740992",
            ),
        ];
        for (lie, expected) in lies {
            let mut wire = film_event_to_wire(FilmEvent::Frame(report()), None);
            lie(&mut wire);
            let error = film_event_from_wire(wire, &cameras()).expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    #[test]
    fn a_failure_is_one_clean_line() {
        let failure = format!("\x1b[2J{}\nforged", "x".repeat(200_000));
        let info = v1::FrameInfo { ended: true, failure, ..v1::FrameInfo::default() };
        let Ok(FilmEvent::Failed(why)) = film_event_from_wire(info, &cameras()) else { panic!("a failure") };
        assert!(why.chars().count() <= 301 && !why.chars().any(char::is_control), "{why}");
    }
}
