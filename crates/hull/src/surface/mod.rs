//! The hull's surface near a body from frame to frame: planes hold for their film frame, move on at the speed that the
//! frame before tells, and stay where they are while outlines only flicker.
//!
//! Between frames the surface goes on along its normals. So a body is asked about where it would be had the surface
//! stood still since the frame, and again once it has left that place: what rides on a lifted lid is asked once a
//! frame. Cameras tell how far each plane moved since the frame before. Motion along a surface cannot be seen there:
//! planes around the body are asked for too, and the rigid motion that explains all of them says how the surface
//! slides. Where what first touches a body moved farther than it is thick, edges tell too little: the shift between two frames is
//! found from the places inside the hull ([`shift_m`]). A step may as well take the surface between the frame and the one before ([`HullTime`]): it goes back from
//! the newer by what it moved.

mod entry;
mod level;
mod motion;
mod shift;
mod still;

use nalgebra::{Matrix3, Point3, Vector3};

use crate::body::{Pose, Shape};
use crate::contact::{BodyContacts, Eye, SurfaceContact, contacts, depth_m, normal};
use crate::faces::FaceNormals;
use crate::pass::{BodyPlanes, SamplePlane};
use motion::{Estimate, Motion, Place, Row};
use still::PlaneFilter;

pub use shift::{Occupancy, grid, shift_m};

/// Planes that were found for a pose hold while no sample moves farther against the surface, metres.
const HOLD_WITHIN_M: f64 = 0.004;
/// What a body's surface is taken to do where its contacts do not say weighs so much against each.
const ELSE_WEIGHT: f64 = 0.01;
/// A surface that moves slower than this stands still, m/s.
const LEAST_SPEED_M_S: f64 = 0.002;
/// What a plane says of its speed differs by so much at most from the motion of all that is near, m/s, and by such a share
/// of how fast that is.
const LEAST_OFF_M_S: f64 = 0.1;
const MOST_OFF: f64 = 0.3;
/// A shift tells more than edges do of what is faster than this, m/s: below it is known no better than to a centimetre a frame.
const LEAST_SHIFT_M_S: f64 = 1.5;
/// It is asked for where an edge says that the surface is faster than this, m/s, or nothing: edges may tell a third.
const MAYBE_FAST_M_S: f64 = 0.5;
/// Hull and face meet if their normals are so nearly opposite: cosine of 60 degrees.
const LEAST_OPPOSITE: f64 = 0.5;
/// The hull's own normal stays if they are so nearly opposite that noise would switch it: cosine of 8 degrees.
const MOST_OPPOSITE: f64 = 0.99;
/// Film that shows a frame for so many periods stands still, and its surfaces with it.
const STILL_PERIODS: f64 = 1.5;

/// Of which moment the hull is that a step collides with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HullTime {
    /// Of the step: from the newest frame on, surfaces go on as fast as they came.
    #[default]
    Newest,
    /// Of one frame earlier, between the two newest frames: nothing is guessed, and all comes a frame later.
    Between,
}

impl HullTime {
    /// Its name in options, files and messages.
    pub fn name(self) -> &'static str {
        match self {
            HullTime::Newest => "newest",
            HullTime::Between => "between",
        }
    }

    /// How many frames later bodies meet what was filmed.
    pub fn frames_later(self) -> f64 {
        match self {
            HullTime::Newest => 0.0,
            HullTime::Between => 1.0,
        }
    }
}

/// The frame that a step sees, and how much older it is than the hull that the step collides with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameAge {
    frame: u64,
    fps: f64,
    /// Less than nothing between the frame and the one before.
    age_s: f64,
    is_still: bool,
}

impl FrameAge {
    /// A step that ends at `film_s` and sees `frame` of film of so many frames a second.
    pub fn new(frame: u64, fps: f64, film_s: f64, hull_time: HullTime) -> FrameAge {
        let age_s = (film_s - frame as f64 / fps).max(0.0);
        let is_still = age_s * fps > STILL_PERIODS;
        let age_s = match hull_time {
            HullTime::Newest => age_s,
            // A frame that is late holds.
            HullTime::Between => (age_s - hull_time.frames_later() / fps).min(0.0),
        };
        FrameAge { frame, fps, age_s: if is_still { 0.0 } else { age_s }, is_still }
    }
}

/// A body and the directions in which it has a surface.
#[derive(Clone, Copy)]
pub struct Sampled<'a> {
    /// Its samples.
    pub shape: &'a Shape,
    /// Points around it.
    pub around: Option<&'a Shape>,
    /// Where it is now.
    pub pose: &'a Pose,
    /// How it moves, world, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Which way its faces look at the samples.
    pub faces: &'a FaceNormals,
}

/// What to ask about a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseToAsk {
    /// Where it is taken to be.
    pub pose: Pose,
    /// See [`AskedBody::back_m`](crate::pass::AskedBody::back_m).
    pub back_m: Option<[f32; 3]>,
}

impl PoseToAsk {
    /// For the surface nearest to it.
    pub fn plain(pose: Pose) -> PoseToAsk {
        PoseToAsk { pose, back_m: None }
    }
}

impl Sampled<'_> {
    /// Where its samples are when it is at a pose, world.
    fn place_at(&self, pose: &Pose) -> impl Fn(u32) -> Point3<f64> {
        let (world_from_body, samples) = (pose.world_from_body(), self.shape.samples_body());
        move |sample| world_from_body(samples[sample as usize])
    }
}

/// What is known of the surface near one body.
#[derive(Clone, Debug, Default)]
pub struct BodySurface {
    /// What was asked last, and of which frame.
    asked: Option<(u64, PoseToAsk)>,
    /// The body came in fast: it is to be asked about once more, back to there, before it has contacts.
    back_m: Option<[f32; 3]>,
    /// Its contacts with the nearest surface, for the case that there is none on the way back.
    nearest: Vec<SurfaceContact>,
    /// It was to be asked about once more, and the next step sees another frame: it has waited long enough.
    has_waited: bool,
    /// Whether what was asked has yet to be taken in.
    is_new: bool,
    /// No sample moved farther between what was asked last and before, metres.
    moved_m: f64,
    /// Of the surface where the body is, world.
    velocity_m_s: Vector3<f64>,
    estimate: Estimate,
    /// How far the surface moved before a frame, if it moved far, world, metres.
    shift: Option<(u64, Vector3<f64>)>,
    filter: PlaneFilter,
}

impl BodySurface {
    /// What to ask about a body whose samples and offset samples are `probes`: what was asked before, while its planes
    /// hold.
    pub fn pose_to_ask(&mut self, at: FrameAge, present: &Pose, probes: &Shape) -> PoseToAsk {
        let pose = self.against_surface(present, at);
        let back_m = self.back_m.take();
        let of_frame = self.asked.filter(|(frame, _)| *frame == at.frame).map(|(_, asked)| asked);
        self.has_waited = back_m.is_some() && of_frame.is_none();
        let asked = match of_frame {
            // Where it was found in the hull: by now it may have gone through.
            Some(asked) if back_m.is_some() => PoseToAsk { back_m, ..asked },
            Some(asked) if probes.moved_at_most_m(&asked.pose, &pose) <= HOLD_WITHIN_M => return asked,
            _ => PoseToAsk::plain(pose),
        };
        let before = self.asked.map(|(_, before)| before.pose);
        self.moved_m = before.map_or(0.0, |before| probes.moved_at_most_m(&before, &pose));
        self.asked = Some((at.frame, asked));
        self.is_new = true;
        asked
    }

    /// Where to look for how far the surface moved since the frame before: about what was found inside of a body that touched
    /// nothing, if that may have come fast. `None` where it need not be known, or is.
    pub fn place_to_look(&self, at: FrameAge, planes: &BodyPlanes, body: &Sampled<'_>) -> Option<Pose> {
        let (_, asked) = self.asked.filter(|_| self.is_new && self.filter.is_empty() && !at.is_still)?;
        if self.shift_at(at).is_some() {
            return None;
        }
        let may_be_fast = |of: &SamplePlane| {
            let moved_m =
                of.plane.map(|plane| plane.moved_m.map_or(f64::INFINITY, |moved_m| f64::from(moved_m).abs()));
            moved_m.is_some_and(|moved_m| moved_m * at.fps > MAYBE_FAST_M_S)
        };
        if !planes.samples.iter().chain(&planes.around).any(may_be_fast) {
            return None;
        }
        let place = body.place_at(&asked.pose);
        let count = body.shape.samples_body().len();
        let inside =
            || planes.samples.iter().map(|found| found.sample).filter(|&sample| (sample as usize) < count);
        let sum: Vector3<f64> = inside().map(|sample| place(sample).coords).sum();
        let number = inside().count();
        if number == 0 {
            return None;
        }
        Some(Pose::IDENTITY.moved((sum / number as f64).into()))
    }

    /// Takes in how far the surface there moved before a frame, world, metres.
    pub fn take_shift(&mut self, at: FrameAge, shift_m: Vector3<f64>) {
        self.shift = Some((at.frame, shift_m));
    }

    fn shift_at(&self, at: FrameAge) -> Option<Vector3<f64>> {
        self.shift.filter(|(frame, _)| *frame == at.frame).map(|(_, shift_m)| shift_m)
    }

    /// The contacts of a body with the planes found for its samples and offset samples, and around it, where body and
    /// surface are now. `eyes` are those of the rig's cameras.
    pub fn contacts(
        &mut self,
        at: FrameAge,
        planes: &BodyPlanes,
        body: &Sampled<'_>,
        eyes: &[Eye],
    ) -> BodyContacts {
        if std::mem::take(&mut self.is_new) {
            self.look(at, planes, body, eyes);
        }
        let pose = self.against_surface(body.pose, at);
        let place = body.place_at(&pose);
        let contact = |filtered: &SurfaceContact| {
            let depth_m = filtered.depth_at_m(&place(filtered.sample), eyes)?;
            let is_contact = filtered.is_near(depth_m, &pose, body.faces);
            is_contact.then(|| against_face(filtered, depth_m, &pose, body.faces))
        };
        let mut contacts: Vec<SurfaceContact> = self.filter.contacts().filter_map(contact).collect();
        level::level(&mut contacts, &place, eyes);
        if at.is_still {
            contacts.iter_mut().for_each(|contact| *contact = contact.at_rest());
        }
        self.velocity_m_s = velocity_m_s(&contacts);
        let spin_rad_s = if at.is_still { [0.0; 3] } else { self.spin_rad_s(at.fps) };
        BodyContacts { contacts, spin_rad_s }
    }

    /// Takes in what was asked about a body.
    fn look(&mut self, at: FrameAge, planes: &BodyPlanes, body: &Sampled<'_>, eyes: &[Eye]) {
        let back_m = self.asked.and_then(|(_, asked)| asked.back_m);
        let pose = match self.asked {
            // These planes are of where it was asked about.
            Some((_, asked)) if back_m.is_some() => asked.pose,
            _ => self.against_surface(body.pose, at),
        };
        let place = body.place_at(&pose);
        let is_contact = |found: &SurfaceContact, depth_m: f64| found.is_near(depth_m, &pose, body.faces);
        let mut seen = contacts(planes, body.shape, &pose, body.faces, eyes);
        if let Some(back_m) = back_m {
            entry::keep_first(&mut seen, back_m);
            if seen.is_empty() {
                std::mem::swap(&mut seen, &mut self.nearest);
            }
        }
        seen.iter_mut().for_each(|contact| contact.speed_m_s = speed_m_s(contact, at.fps));
        let slides = self.tell_slides(at, planes, body, &pose, &mut seen, eyes);
        if back_m.is_none() && self.came_fast(at, body, planes, &seen) {
            return;
        }
        self.filter.update(&seen, self.moved_m, slides, place, is_contact, eyes);
        // What comes fast is met where it is now, not where it would be had it stood still.
        let filtered: Vec<SurfaceContact> = self.filter.contacts().copied().collect();
        self.velocity_m_s = if at.is_still { Vector3::zeros() } else { velocity_m_s(&filtered) };
    }

    /// Whether a body that touched nothing before is to be asked about once more: a fast surface has reached it.
    fn came_fast(
        &mut self,
        at: FrameAge,
        body: &Sampled<'_>,
        planes: &BodyPlanes,
        seen: &[SurfaceContact],
    ) -> bool {
        let count = body.shape.samples_body().len();
        let is_inside = planes.samples.first().is_some_and(|found| (found.sample as usize) < count);
        if self.has_waited || !self.filter.is_empty() || !is_inside {
            return false;
        }
        let moved_m = self.estimate.motion().map(|motion| motion.moved_m(&Vector3::zeros()));
        let surface_m_s = match moved_m {
            _ if at.is_still => Vector3::zeros(),
            Some(moved_m) => moved_m * at.fps,
            None => velocity_m_s(seen),
        };
        if surface_m_s.norm() <= entry::FAST_M_S {
            // It is the body that is fast: by the next step it may be through.
            return false;
        }
        self.back_m = entry::back_m(&(body.velocity_m_s - surface_m_s), at.fps);
        if self.back_m.is_some() {
            self.nearest = seen.to_vec();
        }
        self.back_m.is_some()
    }

    fn spin_rad_s(&self, fps: f64) -> [f32; 3] {
        let turned_rad = self.estimate.motion().map_or(Vector3::zeros(), Motion::turned_rad);
        (turned_rad * fps).map(|part| part as f32).into()
    }

    /// Says of the contacts how their surface moves, as far as the motion of all that is near tells, and whether it does.
    fn tell_slides(
        &mut self,
        at: FrameAge,
        planes: &BodyPlanes,
        body: &Sampled<'_>,
        pose: &Pose,
        seen: &mut [SurfaceContact],
        eyes: &[Eye],
    ) -> bool {
        // What touched before goes on as it did.
        let is_first = self.filter.is_empty();
        if seen.is_empty() && (planes.samples.is_empty() || !is_first) {
            self.estimate = Estimate::default();
            return false;
        }
        let world_from_body = pose.world_from_body();
        let centre = Point3::from(pose.position_m());
        let found = |camera: u16, normal: Vector3<f64>, moved_m: Option<f32>, at_world: Point3<f64>| {
            let depth_m = depth_m(camera, &normal, &at_world, eyes)?;
            let pixel_m = eyes.get(usize::from(camera))?.pixel_m(&at_world);
            let lever = at_world + normal * depth_m - centre;
            Some((Place { normal, lever }, moved_m, pixel_m))
        };
        let told = |(place, moved_m, pixel_m): (Place, Option<f32>, f64)| {
            Some(Row { place, moved_m: f64::from(moved_m?), pixel_m })
        };
        let place = |shape: &Shape, sample: u32| world_from_body(shape.samples_body()[sample as usize]);
        let near = |shape: &Shape, of: &SamplePlane| {
            let plane = of.plane?;
            found(plane.camera, normal(&plane.normal_world), plane.moved_m, place(shape, of.sample))
        };
        let own = seen.iter().filter_map(|contact| {
            let at_world = place(body.shape, contact.sample);
            found(contact.camera, contact.normal(), contact.moved_m, at_world)
        });
        let own: Vec<_> = own.collect();
        let is_told = |&(_, moved_m, _): &(Place, Option<f32>, f64)| is_first || moved_m.is_some();
        let mut places: Vec<Place> =
            own.iter().filter(|found| is_told(found)).map(|&(place, ..)| place).collect();
        if is_first && places.is_empty() {
            // It is in the hull, and no surface near it faces it.
            let samples =
                planes.samples.iter().filter(|of| (of.sample as usize) < body.shape.samples_body().len());
            places.extend(samples.filter_map(|of| near(body.shape, of)).map(|(place, ..)| place));
        }
        let own: Vec<Row> = own.into_iter().filter_map(told).collect();
        let around = body.around.into_iter();
        let around = around.flat_map(|shape| planes.around.iter().filter_map(|of| near(shape, of)));
        let around: Vec<Row> = around.filter_map(told).collect();
        self.estimate.take(at.frame, &places, &own, &around);
        let shift_m =
            self.shift_at(at).filter(|shift_m| is_first && shift_m.norm() * at.fps > LEAST_SHIFT_M_S);
        if let Some(shift_m) = shift_m {
            self.estimate.replace(shift_m);
        }
        let Some(motion) = self.estimate.motion() else { return false };
        for contact in seen {
            let moved_m = motion.moved_m(&(place(body.shape, contact.sample) - centre));
            let normal = contact.normal();
            let slide_m_s = (moved_m - normal * moved_m.dot(&normal)) * at.fps;
            contact.slide_m_s = slide_m_s.map(|part| part as f32).into();
            if !is_first {
                continue;
            }
            let fitted_m_s = moved_m.dot(&normal) * at.fps;
            let most_off_m_s = LEAST_OFF_M_S + MOST_OFF * moved_m.norm() * at.fps;
            let measured_m_s = contact.speed_m_s.filter(|_| shift_m.is_none()).map_or(fitted_m_s, f64::from);
            let speed_m_s = measured_m_s.clamp(fitted_m_s - most_off_m_s, fitted_m_s + most_off_m_s);
            contact.speed_m_s = Some(speed_m_s as f32);
        }
        true
    }

    /// Where a body would be had the surface stood still since the frame.
    fn against_surface(&self, pose: &Pose, at: FrameAge) -> Pose {
        // The very same bits where nothing moves: answers are found again by them.
        if self.velocity_m_s == Vector3::zeros() || at.age_s == 0.0 {
            return *pose;
        }
        pose.moved((self.velocity_m_s * -at.age_s).into())
    }
}

/// A contact at that depth, metres, as bodies meet it. Within a flat face two bodies meet with opposite normals: the
/// hull's there is that of the place nearest to the sample, which on a fist is some way beside the place that touches.
/// Along the face's normal the plane is as much farther, and passes as much faster.
fn against_face(contact: &SurfaceContact, depth_m: f64, pose: &Pose, faces: &FaceNormals) -> SurfaceContact {
    let found = SurfaceContact { depth_m: depth_m as f32, ..*contact };
    let Some(face) = faces.flat_at(contact.sample as usize, pose) else { return found };
    let normal = contact.normal();
    let cosine = -face.dot(&normal);
    if !(LEAST_OPPOSITE..MOST_OPPOSITE).contains(&cosine) {
        return found;
    }
    let moved_m_s = Vector3::from(contact.slide_m_s.map(f64::from))
        + normal * f64::from(contact.speed_m_s.unwrap_or(0.0));
    let slide_m_s = moved_m_s - face * moved_m_s.dot(&face);
    SurfaceContact {
        normal_world: (-face).map(|part| part as f32).into(),
        depth_m: (depth_m / cosine) as f32,
        speed_m_s: contact.speed_m_s.map(|speed_m_s| (f64::from(speed_m_s) / cosine) as f32),
        slide_m_s: slide_m_s.map(|part| part as f32).into(),
        ..found
    }
}

/// How fast the surface of a contact moves out along its normal, m/s.
fn speed_m_s(contact: &SurfaceContact, fps: f64) -> Option<f32> {
    let speed_m_s = f64::from(contact.moved_m?) * fps;
    Some(if speed_m_s.abs() < LEAST_SPEED_M_S { 0.0 } else { speed_m_s as f32 })
}

/// The velocity that explains the contacts' speeds best and, where they do not say, is that along the surface, m/s.
fn velocity_m_s(contacts: &[SurfaceContact]) -> Vector3<f64> {
    let (mut normals, mut speeds) = (Matrix3::zeros(), Vector3::zeros());
    for contact in contacts {
        let Some(speed_m_s) = contact.speed_m_s else { continue };
        let normal = contact.normal();
        normals += normal * normal.transpose() + Matrix3::identity() * ELSE_WEIGHT;
        speeds += normal * f64::from(speed_m_s);
        speeds += Vector3::from(contact.slide_m_s.map(f64::from)) * ELSE_WEIGHT;
    }
    if speeds == Vector3::zeros() {
        return speeds;
    }
    normals.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * speeds)
}

#[cfg(test)]
mod tests;
