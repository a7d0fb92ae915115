//! How the hull meets one body, by the response that the bodies of a world have to it.

use crate::contact::BodyContacts;
use crate::pass::PaperResult;

/// What a step knows of the hull at one body.
#[derive(Clone, Debug, PartialEq)]
pub enum BodyCollision {
    /// The paper's response: samples inside, and what moves the body out.
    Paper(PaperResult),
    /// Contacts with the hull's surface.
    Contacts(BodyContacts),
}

impl BodyCollision {
    /// The samples inside the hull, ascending, each with its way to the surface, world, metres; zero if it has none.
    pub fn inside(&self) -> impl Iterator<Item = (u32, [f64; 3])> + '_ {
        let (paper, contacts) = match self {
            BodyCollision::Paper(paper) => (&paper.inside[..], &[][..]),
            BodyCollision::Contacts(found) => (&[][..], &found.contacts[..]),
        };
        let paper = paper.iter().map(|inside| (inside.sample, inside.response_m().unwrap_or_default()));
        let contacts = contacts.iter().filter(|contact| contact.is_inside());
        paper.chain(contacts.map(|contact| (contact.sample, contact.way_out_m())))
    }

    /// How deep the deepest sample inside is, along its normal, metres; `None` where none has a way out.
    pub fn deepest_m(&self) -> Option<f32> {
        match self {
            BodyCollision::Paper(paper) => {
                paper.inside.iter().filter_map(|inside| inside.exit_m).reduce(f32::max)
            }
            BodyCollision::Contacts(found) => {
                let inside = found.contacts.iter().filter(|contact| contact.is_inside());
                inside.map(|contact| contact.depth_m).reduce(f32::max)
            }
        }
    }

    /// The paper's response, metres, world; contacts have none.
    pub fn response_m(&self) -> Option<[f64; 3]> {
        match self {
            BodyCollision::Paper(paper) => paper.response_m.ok(),
            BodyCollision::Contacts(_) => None,
        }
    }

    /// How many samples that response leaves inside.
    pub fn left_inside(&self) -> usize {
        match self {
            BodyCollision::Paper(paper) => paper.left_inside,
            BodyCollision::Contacts(_) => 0,
        }
    }

    /// Whether film decides anything of the body: a sample is inside, or near the surface.
    pub fn is_touched(&self) -> bool {
        match self {
            BodyCollision::Paper(paper) => !paper.is_clear(),
            BodyCollision::Contacts(found) => !found.contacts.is_empty(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use crate::contact::SurfaceContact;
    use crate::pass::InsideSample;
    use crate::question::Edge;

    const UP: [f32; 3] = [0.0, 1.0, 0.0];

    #[test]
    fn samples_inside_have_their_way_out_or_none() {
        let pixel = Pixel { column: 0, row: 0 };
        let edge = Some(Edge { distance_m: 0.02, camera: 0, pixel, normal_world: UP, moved_m: None });
        let sample = |sample, exit_m| InsideSample { sample, inside_count: 2, edge, exit_m };
        let inside = vec![sample(3, Some(0.25)), sample(5, None), sample(8, Some(0.5))];
        let found = PaperResult { inside, response_m: Ok([0.0, 0.5, 0.0]), left_inside: 1 };
        let collision = BodyCollision::Paper(found);
        let inside: Vec<_> = collision.inside().collect();
        assert_eq!(inside, [(3, [0.0, 0.25, 0.0]), (5, [0.0; 3]), (8, [0.0, 0.5, 0.0])]);
        assert_eq!((collision.deepest_m(), collision.left_inside()), (Some(0.5), 1));
        assert_eq!((collision.response_m(), collision.is_touched()), (Some([0.0, 0.5, 0.0]), true));
        assert!(!BodyCollision::Paper(PaperResult::default()).is_touched());
    }

    #[test]
    fn a_contact_above_the_surface_is_not_inside_but_touches() {
        let contact = |sample, depth_m| SurfaceContact {
            sample,
            camera: 0,
            normal_world: UP,
            moved_m: None,
            depth_m,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        };
        let of = |contacts| BodyCollision::Contacts(BodyContacts { contacts, spin_rad_s: [0.0; 3] });
        let collision = of(vec![contact(1, -0.005), contact(2, 0.125)]);
        assert_eq!(collision.inside().collect::<Vec<_>>(), [(2, [0.0, 0.125, 0.0])]);
        assert_eq!((collision.deepest_m(), collision.response_m()), (Some(0.125), None));
        let above = of(vec![contact(1, -0.005)]);
        assert_eq!((above.inside().count(), above.deepest_m(), above.is_touched()), (0, None, true));
        assert!(!of(vec![]).is_touched());
    }
}
