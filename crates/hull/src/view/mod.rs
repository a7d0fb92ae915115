//! A camera as the probes use it: what is fixed for the run, and one frame of it.

mod bounds;
pub(crate) mod sieve;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use nalgebra::{Point3, Vector3};

use crate::camera::{Camera, Pixel};
use crate::cull::Frustum;
use crate::probe::coefficients::CameraCoefficients;
use crate::probe::edge_line::{Discs, EdgeLine, edge_line, line_before};
use crate::probe::nearest_edge::{EdgePixel, nearest_foreground};
use crate::rule::{OutOfView, ProbeSettings};
use crate::silhouette::{BitMap, Index, PixelRect, Silhouette, Surroundings};
use crate::vector::VectorPath;
pub(crate) use bounds::Bounds;
use sieve::Sieve;

/// A point's class in one camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Foreground there.
    Inside,
    /// Background there, or out of view where the rule says so.
    Outside,
    /// Silent: out of view under `abstain`, or on an ignored pixel.
    Unknown,
}

/// A camera of the rig with its hull rule: all that does not change from frame to frame.
#[derive(Clone, Debug)]
pub struct Observer {
    camera: Camera,
    coefficients: CameraCoefficients,
    rig_index: u16,
    settings: ProbeSettings,
    ignored: Option<BitMap>,
    ignored_bounds: Option<PixelRect>,
    /// Pixels that are no candidates for a background edge whatever the frame: ignored, without a
    /// ray, and under `abstain` off the image. `None` if there are none.
    blocked: Option<BitMap>,
    window_pixels: u32,
    discs: Discs,
    disc_pixels: f64,
    bounds: Bounds,
}

impl Observer {
    /// An observer; `ignored` marks static occluders as foreground and must have the camera's size.
    pub fn new(
        camera: Camera,
        rig_index: u16,
        settings: ProbeSettings,
        ignored: Option<&Silhouette>,
    ) -> Observer {
        let window_pixels = settings.normal_window().half_side_pixels(camera.width(), camera.height());
        let pad = window_pixels + 1;
        let ignored = ignored.filter(|mask| mask.area() > 0);
        let blocked = blocked_pixels(&camera, settings.rule().out_of_view, ignored, pad);
        let bounds = Bounds::of(&camera, pad);
        let discs = Discs::up_to(window_pixels);
        Observer {
            coefficients: CameraCoefficients::of(&camera),
            rig_index,
            settings,
            ignored: ignored.map(|mask| BitMap::foreground(mask, 0)),
            ignored_bounds: ignored.and_then(Silhouette::bounds),
            blocked,
            window_pixels,
            disc_pixels: discs.reach_pixels(),
            discs,
            bounds,
            camera,
        }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The camera's place in the rig; merging goes by it.
    pub fn rig_index(&self) -> u16 {
        self.rig_index
    }

    /// Its settings.
    pub fn settings(&self) -> &ProbeSettings {
        &self.settings
    }

    /// Half the side of the window for normals, pixels.
    pub fn window_pixels(&self) -> u32 {
        self.window_pixels
    }

    /// No image moves faster than this many pixels per unit of normalised coordinates.
    #[inline]
    pub fn stretch_pixels(&self) -> f64 {
        self.bounds.stretch
    }

    /// No line of an edge is farther than this from its edge pixel, pixels.
    #[inline]
    pub(crate) fn disc_pixels(&self) -> f64 {
        self.disc_pixels
    }

    /// All that is known of how the image stretches and bends.
    #[inline]
    pub(crate) fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// True if this camera is never silent: the rule of the paper, without ignore masks.
    pub fn always_judges(&self) -> bool {
        self.settings.rule().out_of_view == OutOfView::Outside && self.ignored.is_none()
    }

    /// The smallest rectangle outside of which this camera says outside of whatever it sees, given the
    /// foreground's bounds: ignored pixels never reject.
    pub fn admitted(&self, foreground: Option<PixelRect>) -> Option<PixelRect> {
        match (foreground, self.ignored_bounds) {
            (Some(a), Some(b)) => Some(a.union(b)),
            (a, b) => a.or(b),
        }
    }
}

/// One observer at one frame.
#[derive(Clone, Debug)]
pub struct View {
    /// No other frame of any camera has this number.
    serial: u64,
    observer: Arc<Observer>,
    foreground: Arc<Index>,
    /// Of the foreground; made when first asked for.
    surroundings: Arc<OnceLock<Surroundings>>,
    sieve: Sieve,
    /// Zero where a pixel is a candidate for the background edge; `None` if that is the foreground.
    candidates: Option<Arc<Index>>,
    frustum: Option<Frustum>,
    before: Option<Before>,
}

/// The candidates of an earlier frame, and how many frames earlier it is.
#[derive(Clone, Debug)]
struct Before {
    candidates: Arc<Index>,
    frames: f64,
}

/// The hull's surface near an edge, as a plane through the camera's centre.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePlane {
    /// Its outward unit normal, world; not numbers where the lens sees nothing.
    pub normal_world: [f32; 3],
    /// The edge through which it goes.
    pub line: EdgeLine,
}

/// How an edge's plane turned since the frame before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    /// It was looked for so far, pixels; negative: not yet.
    steps: i32,
    /// So many pixels away its normal differs by so much.
    by: Option<(i32, Vector3<f64>)>,
}

impl SurfacePlane {
    /// No plane.
    pub const NONE: SurfacePlane = SurfacePlane { normal_world: [f32::NAN; 3], line: EdgeLine::NONE };

    /// Whether the lens sees something there.
    #[inline(always)]
    pub fn has_normal(&self) -> bool {
        !self.normal_world[0].is_nan()
    }
}

impl Turn {
    /// That of an edge that was not looked for.
    pub const UNKNOWN: Turn = Turn { steps: -1, by: None };
}

/// The serial number of the next view.
static NEXT_SERIAL: AtomicU64 = AtomicU64::new(1);

/// Frames back to which motion is measured.
const MAX_FRAMES_BACK: u64 = 3;
/// A surface that moves farther in a frame is another surface, metres.
const MAX_MOVED_M: f64 = 0.2;
/// An edge is looked for no farther from where it is, pixels.
const MAX_STEPS: f64 = 96.0;
/// Edges of two frames are of one surface if their planes' normals are so near: cosine of 25 degrees.
const SAME_SURFACE: f64 = 0.906;

impl View {
    /// Prepares a frame for probing. The silhouette must have the camera's size.
    pub fn new(observer: Arc<Observer>, silhouette: &Silhouette) -> View {
        let foreground = Arc::new(Index::foreground(silhouette, 1));
        let sieve =
            Sieve::new(&observer.coefficients, &observer.bounds, foreground.map(), silhouette.bounds());
        let candidates = observer.blocked.as_ref().map(|blocked| {
            let mut map = blocked.clone();
            map.add(silhouette);
            Arc::new(Index::new(map, silhouette.width().max(silhouette.height())))
        });
        let admitted = observer.admitted(silhouette.bounds());
        let frustum = admitted.map(|rect| Frustum::of(&observer.camera, rect));
        let serial = NEXT_SERIAL.fetch_add(1, Ordering::Relaxed);
        let surroundings = Arc::default();
        View { serial, observer, foreground, surroundings, sieve, candidates, frustum, before: None }
    }

    /// A number that no other frame has: what is known of this one may be kept under it.
    #[inline]
    pub(crate) fn serial(&self) -> u64 {
        self.serial
    }

    /// The same, `frames` after another of the same camera: edges tell how far they moved since.
    pub fn after(mut self, before: &View, frames: u64) -> View {
        let candidates = Arc::clone(before.candidates.as_ref().unwrap_or(&before.foreground));
        let is_near = (1..=MAX_FRAMES_BACK).contains(&frames);
        self.before = is_near.then_some(Before { candidates, frames: frames as f64 });
        self.serial = NEXT_SERIAL.fetch_add(1, Ordering::Relaxed);
        self
    }

    /// The fixed side of this camera.
    #[inline]
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// The camera.
    #[inline]
    pub fn camera(&self) -> &Camera {
        &self.observer.camera
    }

    /// The camera's numbers, flat.
    #[inline]
    pub(crate) fn coefficients(&self) -> &CameraCoefficients {
        &self.observer.coefficients
    }

    /// Decides for most points without looking up a pixel.
    #[inline]
    pub(crate) fn sieve(&self) -> &Sieve {
        &self.sieve
    }

    /// Ones at foreground pixels, zeros elsewhere.
    #[inline]
    pub fn foreground(&self) -> &Index {
        &self.foreground
    }

    /// How far the foreground is from what is around it.
    #[inline]
    pub(crate) fn surroundings(&self) -> &Surroundings {
        let longer = self.camera().width().max(self.camera().height());
        self.surroundings.get_or_init(|| Surroundings::new(&self.foreground, longer))
    }

    /// Zeros at the pixels that count as background for the nearest edge and its normal (spec §3.1).
    #[inline]
    pub fn edge_candidates(&self) -> &Index {
        self.candidates.as_ref().unwrap_or(&self.foreground)
    }

    /// The hull's surface near an edge pixel, which must be the candidate nearest to `start`, and whether it depends on
    /// that. No normal where the lens sees nothing.
    #[inline(always)]
    pub(crate) fn plane(&self, edge: Pixel, start: Pixel, path: VectorPath) -> (SurfacePlane, bool) {
        let fit = edge_line(self.edge_candidates().map(), edge, start, &self.observer.discs, path);
        let normal = self.plane_normal(&fit.line);
        let normal_world = match normal {
            Some(normal) => [normal.x as f32, normal.y as f32, normal.z as f32],
            None => [f32::NAN; 3],
        };
        (SurfacePlane { normal_world, line: fit.line }, fit.depends_on_start)
    }

    /// The pixel of the foreground nearest to one of the background, no farther than so many pixels squared, how far it
    /// is, squared, and the edge pixel beside it.
    #[inline(always)]
    pub(crate) fn edge_beside(
        &self,
        start: Pixel,
        (clear_squared, limit_squared): (i32, i32),
        path: VectorPath,
    ) -> Option<(i64, Pixel, Pixel)> {
        let EdgePixel { pixel: found, squared } =
            nearest_foreground(&self.foreground, start, clear_squared, i64::from(limit_squared), path)?;
        let (across, down) = (start.column - found.column, start.row - found.row);
        // One pixel nearer to the start: no foreground, or it would have been found.
        let edge = if across.abs() >= down.abs() {
            Pixel { column: found.column + across.signum(), ..found }
        } else {
            Pixel { row: found.row + down.signum(), ..found }
        };
        (self.is_plain() || !self.edge_candidates().map().get(edge)).then_some((squared, found, edge))
    }

    /// Whether it may tell how far surfaces moved.
    #[inline]
    pub(crate) fn tells_motion(&self) -> bool {
        self.before.is_some()
    }

    /// How far from an edge its surface is looked for in the frame before, near where this camera sees `at_world`, pixels.
    #[inline(always)]
    fn steps_before(&self, to_camera: &Vector3<f64>, frames: f64) -> i32 {
        let pixel_m = to_camera.norm() / self.observer.camera.intrinsics()[(0, 0)];
        (MAX_MOVED_M * frames / pixel_m).min(MAX_STEPS) as i32
    }

    /// How far the surface of an edge moved out in a frame near where this camera sees `at_world`, metres; `None` where
    /// the frame before does not tell. What is found is kept in `turn` for other places with the same edge.
    #[inline(always)]
    pub(crate) fn moved_m(
        &self,
        line: &EdgeLine,
        at_world: &Point3<f64>,
        turn: &mut Turn,
        path: VectorPath,
    ) -> Option<f64> {
        let before = self.before.as_ref()?;
        let to_camera = self.observer.camera.centre_world() - at_world;
        let steps = self.steps_before(&to_camera, before.frames);
        if turn.steps < steps {
            *turn = self.turn_since(before, line, steps, path);
        }
        let by = turn.by.filter(|&(away, _)| away <= steps)?.1;
        let moved_m = by.dot(&to_camera) / before.frames;
        (moved_m.abs() <= MAX_MOVED_M).then_some(moved_m)
    }

    #[inline(always)]
    fn turn_since(&self, before: &Before, line: &EdgeLine, steps: i32, path: VectorPath) -> Turn {
        let found = line_before(before.candidates.map(), line, steps, &self.observer.discs, path);
        // What is as far is found first, however far others look.
        let Some((away, line_before)) = found else { return Turn { steps, by: None } };
        let normals = self.plane_normal(line).zip(self.plane_normal(&line_before));
        let by =
            normals.filter(|(now, then)| now.dot(then) > SAME_SURFACE).map(|(now, then)| (away, now - then));
        Turn { steps: i32::MAX, by }
    }

    #[inline(always)]
    fn plane_normal(&self, line: &EdgeLine) -> Option<Vector3<f64>> {
        let seen = self.observer.camera.normalised(&line.image)?;
        self.observer.camera.hull_normal_world(&seen, &line.normal)
    }

    /// The bounding frustum of what this camera does not reject; `None` if it rejects all it sees.
    pub fn frustum(&self) -> Option<&Frustum> {
        self.frustum.as_ref()
    }

    /// True if the foreground alone says what is inside and what an edge is.
    #[inline(always)]
    pub(crate) fn is_plain(&self) -> bool {
        self.candidates.is_none()
    }

    /// What this camera says of a point that projects to `pixel` (`None`: unseen).
    #[inline(always)]
    pub fn class_at(&self, pixel: Option<Pixel>) -> Class {
        let observer = &*self.observer;
        match pixel.filter(|&pixel| observer.camera.holds(pixel)) {
            None if observer.settings.rule().out_of_view == OutOfView::Outside => Class::Outside,
            None => Class::Unknown,
            Some(pixel) if observer.ignored.as_ref().is_some_and(|ignored| ignored.get(pixel)) => {
                Class::Unknown
            }
            Some(pixel) if self.foreground.map().get(pixel) => Class::Inside,
            Some(_) => Class::Outside,
        }
    }
}

/// Ones at the pixels that never are background candidates, over the image and `pad` around it.
fn blocked_pixels(
    camera: &Camera,
    out_of_view: OutOfView,
    ignored: Option<&Silhouette>,
    pad: u32,
) -> Option<BitMap> {
    let image = PixelRect { left: 0, top: 0, right: camera.width(), bottom: camera.height() };
    let abstain = out_of_view == OutOfView::Abstain;
    let all_have_rays = border_has_rays(camera, pad);
    if !abstain && ignored.is_none() && all_have_rays {
        return None;
    }
    let mut map = BitMap::filled(image, pad, abstain, true);
    if abstain {
        for row in 0..camera.height() as i32 {
            map.set(row, 0, camera.width() as i32, false);
        }
    }
    if let Some(mask) = ignored {
        map.add(mask);
    }
    if !all_have_rays {
        for row in map.top()..map.bottom() {
            for column in map.left()..map.right() {
                if camera.normalised(&Pixel { column, row }.centre()).is_none() {
                    map.set(row, column, column + 1, true);
                }
            }
        }
    }
    Some(map)
}

/// True if every pixel around the padded image has a ray; then those within have one too, because the
/// pixels with rays are the one-to-one image of a disc.
fn border_has_rays(camera: &Camera, pad: u32) -> bool {
    if camera.lens().is_straight() {
        return true;
    }
    let pad = pad as i32;
    let (left, right) = (-pad, camera.width() as i32 + pad);
    let (top, bottom) = (-pad, camera.height() as i32 + pad);
    let horizontal = (left..right).flat_map(|column| [(column, top), (column, bottom - 1)]);
    let vertical = (top..bottom).flat_map(|row| [(left, row), (right - 1, row)]);
    horizontal
        .chain(vertical)
        .all(|(column, row)| camera.normalised(&Pixel { column, row }.centre()).is_some())
}
