//! Points to ask about: around a person of the stage, the same on every machine.

pub mod paper_mix;

use std::slice;
use std::sync::Arc;

use hull::cull::{WorldBox, hull_box};
use hull::oracle::DenseView;
use hull::question::Points;
use hull::silhouette::PixelRect;
use hull::{Camera, Observer, ProbeSettings, Rig, Silhouette, View, ViewSet};
use setup::cli::{Failure, Outcome};
use stage::{CameraStage, StageSettings, studio_rig};

use crate::crews::all_see;
use crate::passes::Passes;
use crate::random::Random;

/// The instant of the film that is looked at, seconds: an arm is up.
const TIME_S: f64 = 0.5;
/// Points asked at once: those of one body.
pub const BODY_POINTS: usize = 64;
/// How deep contacts are, metres: from the point to the ray of the nearest edge.
const CONTACT_M: std::ops::Range<f32> = 0.01..0.03;
/// Points thrown at once while points inside are looked for.
const THROW: usize = 1 << 14;
/// Throws without enough points inside mean that there is no person.
const MAX_THROWS: usize = 1000;
/// Distortion of a plain wide-angle lens: 3 % at the middle of a long side.
const BENT: [f64; 5] = [-0.12, 0.02, 0.001, -0.001, 0.0];

/// What the studio's cameras are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StudioPlan {
    /// How many stand around the person.
    pub cameras: usize,
    /// Pixels of each, across and down.
    pub size: (u32, u32),
    /// With distorting lenses.
    pub bent: bool,
}

/// The studio at one instant.
pub struct Studio {
    /// All cameras, as the probes use them.
    pub views: ViewSet,
    /// The same as masks of a byte a pixel.
    pub dense: Vec<DenseView>,
    /// The bounding rectangle of each camera's silhouette.
    pub rects: Vec<Option<PixelRect>>,
    /// The settings that everything is asked under.
    pub settings: ProbeSettings,
    low_m: [f64; 3],
    size_m: [f64; 3],
}

impl Studio {
    /// Cameras around a person who waves.
    pub fn new(plan: StudioPlan) -> Outcome<Studio> {
        let cameras = cameras(plan)?;
        let stage = StageSettings::default();
        let settings = ProbeSettings::default();
        // What each camera sees of the person: 255 is foreground.
        let look = |index: usize| Ok(CameraStage::new(&stage, &cameras[index], index).mask(TIME_S));
        let masks = all_see("looking at the studio", cameras.len(), look)?;
        let (mut views, mut dense, mut rects) = (Vec::new(), Vec::new(), Vec::new());
        for (index, (camera, mask)) in cameras.into_iter().zip(masks).enumerate() {
            let silhouette = Silhouette::from_mask(plan.size.0, plan.size.1, &mask).map_err(Failure::run)?;
            let observer = Observer::new(camera.clone(), index as u16, settings, None);
            views.push(View::new(Arc::new(observer), &silhouette));
            rects.push(silhouette.bounds());
            dense.push(DenseView { camera, mask, ignored: None });
        }
        let bounds = stage.bounds_world(TIME_S);
        let (low, high) = bounds.ok_or_else(|| Failure::run("the stage is empty"))?;
        let size_m = (high - low).into();
        Ok(Studio { views: ViewSet::new(views), dense, rects, settings, low_m: low.into(), size_m })
    }

    /// Each camera in a group of its own, as on nodes of one camera.
    pub fn alone(&self) -> Vec<ViewSet> {
        self.views.views().iter().map(|view| ViewSet::new(vec![view.clone()])).collect()
    }

    /// Half the side of the window for normals, pixels.
    pub fn window_pixels(&self) -> u32 {
        let camera = &self.dense[0].camera;
        self.settings.normal_window().half_side_pixels(camera.width(), camera.height())
    }

    /// The box around the person.
    pub fn person_box(&self) -> WorldBox {
        let max = std::array::from_fn(|axis| self.low_m[axis] + self.size_m[axis]);
        WorldBox { min: self.low_m, max }
    }

    /// The box around the hull.
    pub fn hull_box(&self) -> Option<WorldBox> {
        let frusta: Vec<_> = self.views.views().iter().map(|view| view.frustum().cloned()).collect();
        hull_box(&frusta, self.settings.rule())
    }

    /// Random points in the person's box grown by `margin_m` on every side.
    pub fn in_box(&self, random: &mut Random, count: usize, margin_m: f64) -> Vec<[f64; 3]> {
        let coordinate = |axis: usize, share: f64| {
            self.low_m[axis] - margin_m + (self.size_m[axis] + 2.0 * margin_m) * share
        };
        let mut point = || std::array::from_fn(|axis| coordinate(axis, random.share()));
        (0..count).map(|_| point()).collect()
    }

    /// Random points inside the hull, 1 to 3 cm from an edge's ray if `near_surface`.
    pub fn inside(&self, random: &mut Random, count: usize, near_surface: bool) -> Outcome<Vec<[f64; 3]>> {
        let mut found = Vec::new();
        let mut asked = Passes::new(self.settings, 1);
        for _ in 0..MAX_THROWS {
            let points: Arc<[[f64; 3]]> = self.in_box(random, THROW, 0.0).into();
            let bodies = [Points::World(Arc::clone(&points))];
            asked.ask(&bodies, slice::from_ref(&self.views), &WorldBox::EVERYWHERE)?;
            let paper = asked.pass.results()[0].paper();
            for inside in paper.iter().flat_map(|paper| &paper.inside) {
                let fits =
                    inside.edge.is_some_and(|edge| !near_surface || CONTACT_M.contains(&edge.distance_m));
                if fits && found.len() < count {
                    found.push(points[inside.sample as usize]);
                }
            }
            if found.len() == count {
                return Ok(found);
            }
        }
        Err(Failure::run(format_args!("found {} points inside the hull, expected {count}", found.len())))
    }

    /// Points as bodies of [`BODY_POINTS`] neighbours.
    pub fn bodies(&self, mut points_m: Vec<[f64; 3]>) -> Vec<Points> {
        points_m.sort_by_cached_key(|point| self.morton(point));
        points_m.chunks(BODY_POINTS).map(|points| Points::World(points.into())).collect()
    }

    /// The place on a curve on which neighbours are near: the bits of the coordinates interleaved.
    fn morton(&self, point_m: &[f64; 3]) -> u32 {
        let cell = |axis: usize| ((point_m[axis] - self.low_m[axis]) / self.size_m[axis] * 1023.0) as u32;
        let cells: [u32; 3] = std::array::from_fn(cell);
        let bit = |place: u32| (cells[place as usize % 3] >> (place / 3) & 1) << place;
        (0..30).map(bit).sum()
    }
}

fn cameras(plan: StudioPlan) -> Outcome<Vec<Camera>> {
    let rig = studio_rig(plan.cameras, plan.size);
    let rig: Rig = rig.map_err(|error| Failure::input(format_args!("--size: {error}")))?;
    if !plan.bent {
        return Ok(rig.cameras().to_vec());
    }
    let bend = |camera: &Camera| {
        let (size, rotation) = ((camera.width(), camera.height()), *camera.rotation_rad());
        Camera::new(camera.name(), size, *camera.intrinsics(), BENT, rotation, *camera.translation_m())
            .map_err(Failure::run)
    };
    rig.cameras().iter().map(bend).collect()
}
