//! Points to ask about: around a person of the stage, the same on every machine.

use std::sync::Arc;

use hull::cull::WorldBox;
use hull::oracle::DenseView;
use hull::pass::Pass;
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{Observer, ProbeSettings, Silhouette, View, ViewSet};
use stage::{CameraStage, Stage, StageSettings, studio_rig};

use crate::failure::{Failure, Outcome};
use crate::rig::progress::Progress;

/// Cameras of the studio.
pub const CAMERAS: usize = 8;
/// The instant of the film that is looked at, seconds: an arm is up.
const TIME_S: f64 = 0.5;
/// Points asked at once: those of one body.
pub const BODY_POINTS: usize = 64;
/// How deep contacts are, metres: from the point to the ray of the nearest edge.
const CONTACT_M: std::ops::Range<f32> = 0.01..0.03;
/// Points thrown at once while points inside are looked for.
const THROW: usize = 1 << 14;
/// Throws without enough points inside mean that there is nobody.
const MAX_THROWS: usize = 1000;

/// The studio at one instant.
pub struct Studio {
    /// All cameras, as the probes use them.
    pub views: ViewSet,
    /// The same as masks of a byte a pixel.
    pub dense: Vec<DenseView>,
    /// The settings that everything is asked under.
    pub settings: ProbeSettings,
    low_m: [f64; 3],
    size_m: [f64; 3],
}

impl Studio {
    /// Eight cameras of that size around a person who waves.
    pub fn new(size: (u32, u32)) -> Outcome<Studio> {
        let rig =
            studio_rig(CAMERAS, size).map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let stage = StageSettings::default();
        let settings = ProbeSettings::default();
        let mut progress = Progress::new("looking at the studio", CAMERAS as u64);
        let (mut views, mut dense) = (Vec::new(), Vec::new());
        for (index, camera) in rig.cameras().iter().enumerate() {
            let mask = CameraStage::new(&stage, camera, index).mask(TIME_S);
            let silhouette = Silhouette::from_mask(size.0, size.1, &mask).map_err(Failure::run)?;
            let observer = Observer::new(camera.clone(), index as u16, settings, None);
            views.push(View::new(Arc::new(observer), &silhouette));
            dense.push(DenseView { camera: camera.clone(), mask, ignored: None });
            progress.step();
        }
        let bounds = Stage::new(&stage).bounds_world(TIME_S);
        let (low, high) = bounds.ok_or_else(|| Failure::run("the stage is empty"))?;
        Ok(Studio {
            views: ViewSet::new(views),
            dense,
            settings,
            low_m: low.into(),
            size_m: (high - low).into(),
        })
    }

    /// Random points in the person's box.
    pub fn in_box(&self, random: &mut Random, count: usize) -> Vec<[f64; 3]> {
        let point = |_| std::array::from_fn(|axis| self.low_m[axis] + self.size_m[axis] * random.share());
        (0..count).map(point).collect()
    }

    /// Random points that the hull says are inside, 1 to 3 cm from an edge's ray if `near_surface`.
    pub fn inside(&self, random: &mut Random, count: usize, near_surface: bool) -> Outcome<Vec<[f64; 3]>> {
        let mut found = Vec::new();
        for _ in 0..MAX_THROWS {
            let points: Arc<[[f64; 3]]> = self.in_box(random, THROW).into();
            let bodies = vec![Points::World(Arc::clone(&points))];
            for touch in self.pass(bodies, &mut Scratch::default())?.remove(0).touches {
                let fits =
                    touch.edge.is_some_and(|edge| !near_surface || CONTACT_M.contains(&edge.distance_m));
                if fits && found.len() < count {
                    found.push(points[touch.sample as usize]);
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

    /// A full pass in this process.
    pub fn pass(&self, bodies: Vec<Points>, scratch: &mut Scratch) -> Outcome<Vec<hull::pass::BodyResult>> {
        let mut pass = Pass::new(bodies, Some(&WorldBox::EVERYWHERE), self.settings, 1);
        let mut answer = Answer::default();
        while let Some(question) = pass.question() {
            self.views.answer(question, scratch, &mut answer);
            pass.answer(0, &answer).map_err(Failure::run)?;
        }
        Ok(pass.into_results())
    }

    /// The place on a curve on which neighbours are near: the bits of the coordinates interleaved.
    fn morton(&self, point_m: &[f64; 3]) -> u32 {
        let cell = |axis: usize| ((point_m[axis] - self.low_m[axis]) / self.size_m[axis] * 1023.0) as u32;
        let cells: [u32; 3] = std::array::from_fn(cell);
        let bit = |place: u32| (cells[place as usize % 3] >> (place / 3) & 1) << place;
        (0..30).map(bit).sum()
    }
}

/// Random numbers, the same everywhere (splitmix64).
pub struct Random(pub u64);

impl Random {
    /// From 0 up to 1.
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
