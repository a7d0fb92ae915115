//! The figures of a run: as JSON, and as a few lines for people.

use coordinator::{Figures, Percentiles};
use hull::Camera;
use recording::Recorded;
use serde_json::{Value, json};
use sim::{BodySummary, ResponseMode, World};

use super::run_setup::Setup;

/// One picture: from where it was taken, and the intersection over union of the hull drawn into real cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Film time, seconds.
    pub film_s: f64,
    /// The frame.
    pub frame: u64,
    /// The viewpoint, which is no camera's.
    pub view: Camera,
    /// Each camera's name and figure.
    pub cameras: Vec<(String, f64)>,
}

/// The run's figures as JSON.
pub fn json(setup: &Setup, figures: &Figures, world: &World, overlaps: &[Overlap]) -> Value {
    let sizes = setup.file.rig.cameras().iter().map(|camera| (camera.width(), camera.height()));
    let (width, height) = sizes.max().unwrap_or((0, 0));
    let stages = coordinator::Stage::ALL.into_iter().zip(&figures.times.stage_ms);
    let stage_ms: serde_json::Map<String, Value> =
        stages.map(|(stage, figures)| (stage.name().to_owned(), percentiles(figures))).collect();
    json!({
        "cameras": setup.file.rig.cameras().len(),
        "width": width,
        "height": height,
        "fps": setup.file.fps,
        "transport": setup.transport.name(),
        "response": setup.world.response.name(),
        "hull_time": setup.world.hull_time.name(),
        "scene": setup.scene.name(),
        "seed": setup.world.seed,
        "lock_step": setup.lock_step,
        "wall_s": figures.wall_s,
        "frames": figures.counts.frames,
        "steps": figures.counts.steps,
        "samples": figures.samples,
        "inside_samples": figures.counts.inside_samples,
        "contacts": figures.counts.contacts,
        "left_inside": figures.left_inside(),
        "questions": {
            "passes": figures.counts.passes.asked,
            "gathered": figures.counts.passes.gathered,
            "round_trips": figures.counts.passes.round_trips,
            "poses": figures.answers.poses_asked,
            "steps_without": figures.answers.steps_without_question,
            "reused_share": figures.answers.reused_share(),
        },
        "step_ms": percentiles(&figures.times.step_ms),
        "response_age_ms": percentiles(&figures.times.response_age_ms),
        "depth_mm": percentiles(&figures.depth_mm),
        "stage_ms": stage_ms,
        "steps_per_s": figures.counts.steps as f64 / figures.wall_s.max(1e-9),
        "bytes": bytes(figures),
        "missed": missed(figures),
        "faults": figures.counts.faults,
        "trajectory_digest": world.digest().to_string(),
        "bodies": world.bodies().iter().zip(world.summaries()).map(body).collect::<Vec<Value>>(),
        "hull_overlap": overlaps.iter().map(overlap).collect::<Vec<Value>>(),
    })
}

fn bytes(figures: &Figures) -> Value {
    let all = figures.counts.bytes.to_nodes + figures.counts.bytes.from_nodes;
    json!({
        "to_nodes": figures.counts.bytes.to_nodes,
        "from_nodes": figures.counts.bytes.from_nodes,
        "per_step": all as f64 / figures.counts.steps.max(1) as f64,
        "silhouettes": figures.counts.bytes.silhouettes,
    })
}

fn missed(figures: &Figures) -> Value {
    let frames = figures.frames_missed();
    json!({
        "frames": frames,
        "frames_expected": figures.frames_expected,
        "share": frames as f64 / figures.frames_expected.max(1) as f64,
        "late_steps": figures.counts.misses.late_steps,
        "blind_steps": figures.counts.misses.blind_steps(),
        "reduced_steps": figures.counts.misses.reduced_steps,
        "slipped_s": figures.counts.slipped_s,
    })
}

fn body((body, record): (&sim::Body, &BodySummary)) -> Value {
    json!({
        "name": record.name,
        "fixed": body.fixed,
        "start": record.start.position_m(),
        "end": record.end.position_m(),
        "start_rotation_xyzw": record.start.rotation_xyzw(),
        "end_rotation_xyzw": record.end.rotation_xyzw(),
        "moved_m": record.moved_m,
        "hull_moved_m": record.hull_moved_m,
        "first_touch_s": record.first_touch_s,
        "moved_before_touch_m": record.moved_before_touch_m,
        "max_speed_m_s": record.max_speed_m_s,
        "max_tilt_deg": record.max_tilt_deg,
    })
}

fn overlap(overlap: &Overlap) -> Value {
    let cameras: serde_json::Map<String, Value> =
        overlap.cameras.iter().map(|(name, figure)| (name.clone(), json!(figure))).collect();
    json!({ "film_s": overlap.film_s, "frame": overlap.frame, "view": view(&overlap.view), "cameras": cameras })
}

/// Pinhole and place: rows of matrices; pixel centres at whole numbers; from world to camera, metres.
fn view(camera: &Camera) -> Value {
    let rows = |matrix: &nalgebra::Matrix3<f64>| -> Vec<[f64; 3]> {
        matrix.row_iter().map(|row| [row[0], row[1], row[2]]).collect()
    };
    json!({
        "size": [camera.width(), camera.height()],
        "matrix": rows(camera.intrinsics()),
        "rotation": rows(camera.rotation()),
        "translation": <[f64; 3]>::from(*camera.translation_m()),
    })
}

fn percentiles(figures: &Percentiles) -> Value {
    json!({ "p50": figures.p50(), "p99": figures.p99(), "max": figures.max() })
}

/// The stages of a step that took place: how often in a frame, and their milliseconds.
fn stage_table(figures: &Figures) -> String {
    let mut text = format!("{:<12}{:>9}{:>9}{:>9}{:>9}\n", "stage", "a frame", "p50 ms", "p99 ms", "max ms");
    for (stage, figures_ms) in coordinator::Stage::ALL.into_iter().zip(&figures.times.stage_ms) {
        let shown = (figures_ms.p50(), figures_ms.p99(), figures_ms.max());
        let (Some(p50), Some(p99), Some(max)) = shown else { continue };
        let (name, a_frame) = (stage.name(), figures_ms.count() as f64 / figures.counts.frames.max(1) as f64);
        text += &format!("{name:<12}{a_frame:>9.2}{p50:>9.2}{p99:>9.2}{max:>9.2}\n");
    }
    text
}

/// The run in a few lines.
pub fn summary(setup: &Setup, figures: &Figures, world: &World) -> String {
    let ms = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let mut text = format!(
        "{} frames of {} cameras ({} missed), {} steps in {:.1} s: {:.1} frames/s\n\
         step p50 {} ms, p99 {} ms; response age p50 {} ms\n\
         {} passes of {:.2} round trips, {} steps without a question\n\
         {} samples inside over all steps, {:.1} % not freed by their response\n",
        figures.counts.frames,
        setup.file.rig.cameras().len(),
        figures.frames_missed(),
        figures.counts.steps,
        figures.wall_s,
        figures.counts.frames as f64 / figures.wall_s.max(1e-9),
        ms(figures.times.step_ms.p50()),
        ms(figures.times.step_ms.p99()),
        ms(figures.times.response_age_ms.p50()),
        figures.counts.passes.asked,
        figures.counts.passes.round_trips as f64 / figures.counts.passes.asked.max(1) as f64,
        figures.answers.steps_without_question,
        figures.counts.inside_samples,
        100.0 * figures.left_inside(),
    );
    text += &stage_table(figures);
    if figures.counts.misses.blind_steps() > 0 {
        text += &format!("{} steps without a hull\n", figures.counts.misses.blind_steps());
    }
    if figures.counts.misses.reduced_steps > 0 {
        text +=
            &format!("{} steps without a camera that was not there\n", figures.counts.misses.reduced_steps);
    }
    for record in world.summaries() {
        text += &touched(record, setup.world.response);
    }
    text
}

/// What became of a body that the hull touched. Only the paper's responses move bodies themselves: contacts push them
/// in the solver, where gravity and other bodies do so too.
fn touched(record: &BodySummary, response: ResponseMode) -> String {
    let BodySummary { name, first_touch_s, moved_m, hull_moved_m, .. } = record;
    let Some(touched_s) = first_touch_s else { return String::new() };
    let by_hull = match response {
        ResponseMode::Paper => format!(", by the hull {hull_moved_m:.2} m"),
        ResponseMode::Contacts => String::new(),
    };
    format!("  {name:<16} touched at {touched_s:.2} s, moved {moved_m:.2} m{by_hull}\n")
}

/// What was recorded, in a line.
pub fn recorded(file: &str, recorded: &Recorded) -> String {
    let Recorded { steps, frames, frames_lost } = recorded;
    let lost = if *frames_lost > 0 { format!(", {frames_lost} frames are missing") } else { String::new() };
    format!("recorded in {file}: {steps} steps, {frames} frames{lost}\n")
}

/// The same as JSON.
pub fn recorded_json(file: &str, recorded: &Recorded) -> Value {
    let Recorded { steps, frames, frames_lost } = recorded;
    json!({ "file": file, "steps": steps, "frames": frames, "frames_lost": frames_lost })
}
