//! How bodies answer the hull in an experiment.

use clap::ValueEnum;
use hull::surface::HullTime;
use sim::{BodyResponse, ResponseMode};

/// How bodies answer the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Response {
    /// As the paper has it.
    Paper,
    /// With contacts in the solver.
    Contacts,
    /// With contacts in the solver, and the hull between the two newest frames.
    Between,
    /// With contacts in the solver, of surfaces whose motion is unknown.
    NoSpeeds,
    /// With the deepest of each body's contacts alone.
    OneContact,
    /// Without a hull: on the studio's true solids. A reference.
    Solids,
    /// With contacts, seen by cameras of 7680x4320. A reference.
    #[value(name = "8k")]
    EightK,
}

impl Response {
    /// The references.
    pub const REFERENCES: [Response; 2] = [Response::Solids, Response::EightK];

    /// Whether others are compared with it.
    pub fn is_reference(self) -> bool {
        Response::REFERENCES.contains(&self)
    }

    /// Whether bodies in a recording can answer so: it has no references, and its film tells speeds.
    pub fn is_of_recordings(self) -> bool {
        !self.is_reference() && self.tells_speeds()
    }

    /// What the world is made with.
    pub fn mode(self) -> ResponseMode {
        match self {
            // Where no hull is asked either will do.
            Response::Paper | Response::Solids => ResponseMode::Paper,
            Response::Contacts
            | Response::Between
            | Response::NoSpeeds
            | Response::OneContact
            | Response::EightK => ResponseMode::Contacts,
        }
    }

    /// Of which moment the hull is that bodies collide with.
    pub fn hull_time(self) -> HullTime {
        if self == Response::Between { HullTime::Between } else { HullTime::Newest }
    }

    /// Whether cameras tell how far planes moved since the frame before.
    pub fn tells_speeds(self) -> bool {
        self != Response::NoSpeeds
    }

    /// What becomes of the hull's answer before the world gets it.
    pub fn alter(self) -> fn(&mut BodyResponse) {
        match self {
            Response::OneContact => keep_deepest,
            _ => |_| (),
        }
    }

    /// Its name in options and tables.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Leaves a body the deepest of its contacts.
fn keep_deepest(response: &mut BodyResponse) {
    let deepest = response.contacts.iter().copied().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
    response.contacts.clear();
    response.contacts.extend(deepest);
}

#[cfg(test)]
mod tests {
    use sim::HullContact;

    use super::*;

    #[test]
    fn one_contact_is_the_deepest() {
        let contact = |sample, depth_m| HullContact {
            sample,
            point_body_m: [0.0; 3],
            normal_world: [0.0, 1.0, 0.0],
            depth_m,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        };
        let contacts = vec![contact(0, -0.01), contact(3, 0.002), contact(5, 0.001)];
        let mut response = BodyResponse { contacts, ..BodyResponse::default() };
        Response::Contacts.alter()(&mut response);
        assert_eq!(response.contacts.len(), 3);
        for _ in 0..2 {
            Response::OneContact.alter()(&mut response);
            assert_eq!(response.contacts, [contact(3, 0.002)]);
        }
        let mut untouched = BodyResponse::UNTOUCHED;
        Response::OneContact.alter()(&mut untouched);
        assert_eq!(untouched, BodyResponse::UNTOUCHED);
    }
}
