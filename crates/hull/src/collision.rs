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
