//! What contacts ask for: the planes of the surface near the samples of bodies, their offset samples, and
//! points around them.

mod result;
mod speculation;
mod ways_out;

use std::sync::Arc;

pub use result::{BodyPlanes, SamplePlane};

use super::found::FoundSample;
use super::{BodyResult, Pass, Response};
use crate::faces::FaceNormals;
pub(super) use speculation::Speculation;

/// What the rounds for contacts know of the bodies of a pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Contacts {
    /// One for each body, and after them one for what is around each; there may be buffers of more.
    bodies: Vec<ContactBody>,
    pub speculation: Speculation,
}

#[derive(Clone, Debug, Default)]
struct ContactBody {
    /// The body that these points are around, if they are no body.
    owner: Option<usize>,
    faces: Option<Arc<FaceNormals>>,
    /// See [`AskedBody::back_m`](super::AskedBody::back_m).
    back_m: Option<[f32; 3]>,
}

impl Contacts {
    /// Begins a pass: forgets the bodies of the one before.
    pub fn restart(&mut self) {
        self.bodies.clear();
    }

    /// Another body.
    pub fn add(&mut self, faces: Option<Arc<FaceNormals>>, back_m: Option<[f32; 3]>) {
        self.bodies.push(ContactBody { owner: None, faces, back_m });
    }

    /// Points around a body.
    pub fn add_around(&mut self, owner: usize) {
        self.bodies.push(ContactBody { owner: Some(owner), faces: None, back_m: None });
    }

    /// Writes what was found for a body; what is around it stands there already.
    pub fn conclude(found: &[FoundSample], planes: &mut BodyPlanes) {
        planes.samples.clear();
        planes.samples.extend(found.iter().map(plane));
    }
}

fn plane(found: &FoundSample) -> SamplePlane {
    SamplePlane { sample: found.sample, plane: found.edge }
}

impl Pass {
    /// The classes are known: says which planes are needed, and takes those that are.
    pub(super) fn begin_contacts(&mut self) {
        self.drop_needless_offset_samples();
        self.add_around();
        self.take_planes();
        self.skip_nearest_planes();
    }

    /// Of bodies that are asked about back along their way the nearest planes are not needed.
    fn skip_nearest_planes(&mut self) {
        let Response::Contacts(contacts) = &self.response else { return };
        let bodies = self.bodies.asked_mut().iter_mut().zip(&contacts.bodies);
        for (body, _) in bodies.filter(|(_, of_contacts)| of_contacts.back_m.is_some()) {
            body.are_edges_known = true;
            body.found.iter_mut().for_each(|found| found.edge = None);
        }
    }

    /// A sample that is inside itself takes the plane where it is: that of its offset sample is not needed. Of a body
    /// that is asked about back along its way no offset sample's plane is.
    fn drop_needless_offset_samples(&mut self) {
        let Response::Contacts(contacts) = &self.response else { return };
        for (body, of_contacts) in self.bodies.asked_mut().iter_mut().zip(&contacts.bodies) {
            let Some(count) = of_contacts.faces.as_ref().map(|faces| faces.sample_count() as u32) else {
                continue;
            };
            let found = &mut body.found;
            let own = found.partition_point(|found| found.sample < count);
            if of_contacts.back_m.is_some() {
                found.truncate(own);
                continue;
            }
            let (mut kept, mut of_own) = (own, 0);
            for at in own..found.len() {
                let sample = found[at].sample - count;
                while of_own < own && found[of_own].sample < sample {
                    of_own += 1;
                }
                if of_own == own || found[of_own].sample != sample {
                    found[kept] = found[at];
                    kept += 1;
                }
            }
            found.truncate(kept);
        }
    }

    /// All points around the bodies that touch.
    fn add_around(&mut self) {
        let Response::Contacts(contacts) = &self.response else { return };
        let (bodies, around) = self.bodies.split_mut();
        for (points, of_contacts) in around.iter_mut().zip(&contacts.bodies[bodies.len()..]) {
            let touches = of_contacts.owner.is_some_and(|owner| !bodies[owner].found.is_empty());
            let count = if touches { points.points.len() as u32 } else { 0 };
            points.found.extend((0..count).map(|sample| FoundSample::new(sample, 0)));
        }
    }

    /// The planes are known: gives the bodies what was found around them, and asks for ways out.
    pub(super) fn after_planes(&mut self) {
        let Pass { response, results, bodies, .. } = self;
        let Response::Contacts(contacts) = response else { return };
        for (body, of_contacts) in bodies.all().iter().zip(&contacts.bodies) {
            let Some(owner) = of_contacts.owner else { continue };
            let BodyResult::Planes(planes) = &mut results[owner] else { continue };
            let near = body.found.iter().filter(|found| found.edge.is_some());
            planes.around.extend(near.map(plane));
        }
        self.ask_ways_out();
    }
}
