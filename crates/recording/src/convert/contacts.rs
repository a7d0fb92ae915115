//! Contacts with the hull's surface as bytes: a step has hundreds.

use sim::HullContact;
use world_encodings::recording::ConvertError;

/// A sample's number, a point, a normal, a depth, a speed and a velocity, four bytes each number.
const CONTACT_BYTES: usize = 48;
/// Unit vectors that were rounded differ from length 1 by less.
const UNIT_TOLERANCE: f32 = 1e-3;

/// The contacts of a body, one after the other.
pub(crate) fn contacts_to_bytes(contacts: &[HullContact]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(contacts.len() * CONTACT_BYTES);
    for HullContact { sample, point_body_m, normal_world, depth_m, speed_m_s, slide_m_s } in contacts {
        bytes.extend_from_slice(&sample.to_le_bytes());
        let speed_m_s = speed_m_s.unwrap_or(f32::NAN);
        let numbers = point_body_m.iter().chain(normal_world).chain([depth_m, &speed_m_s]).chain(slide_m_s);
        numbers.for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
    }
    bytes
}

/// The same back, checked.
pub(crate) fn contacts_from_bytes(bytes: &[u8]) -> Result<Vec<HullContact>, ConvertError> {
    let wrong =
        |problem: &dyn std::fmt::Display| ConvertError::new("Response", format_args!("contacts: {problem}"));
    let (found, rest) = bytes.as_chunks::<CONTACT_BYTES>();
    if !rest.is_empty() {
        return Err(wrong(&format_args!("{} bytes, expected a multiple of {CONTACT_BYTES}", bytes.len())));
    }
    let contact = |bytes: &[u8; CONTACT_BYTES]| {
        let (words, _) = bytes.as_chunks::<4>();
        let number = |at: usize| f32::from_le_bytes(words[at]);
        let contact = HullContact {
            sample: u32::from_le_bytes(words[0]),
            point_body_m: [number(1), number(2), number(3)],
            normal_world: [number(4), number(5), number(6)],
            depth_m: number(7),
            speed_m_s: Some(number(8)).filter(|speed_m_s| !speed_m_s.is_nan()),
            slide_m_s: [number(9), number(10), number(11)],
        };
        let length = contact.normal_world.iter().map(|n| n * n).sum::<f32>().sqrt();
        if !contact
            .point_body_m
            .iter()
            .chain([&contact.depth_m])
            .chain(&contact.speed_m_s)
            .chain(&contact.slide_m_s)
            .all(|number| number.is_finite())
        {
            return Err(wrong(&"a number that is none, expected metres"));
        }
        if length.is_nan() || (length - 1.0).abs() > UNIT_TOLERANCE {
            return Err(wrong(&format_args!("a normal of length {length}, expected 1")));
        }
        Ok(contact)
    };
    found.iter().map(contact).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_survive_and_what_cannot_be_is_refused() {
        let contact = |sample, depth_m| HullContact {
            sample,
            point_body_m: [0.1, -0.2, 0.3],
            normal_world: [0.6, 0.0, -0.8],
            depth_m,
            speed_m_s: (sample == 3).then_some(-0.25),
            slide_m_s: [0.5, 0.0, 0.25],
        };
        let contacts = vec![contact(3, 0.002), contact(70_000, -0.01)];
        let bytes = contacts_to_bytes(&contacts);
        assert_eq!(contacts_from_bytes(&bytes).expect("the same"), contacts);
        let refused = |bytes: &[u8]| contacts_from_bytes(bytes).expect_err("refused").to_string();
        assert_eq!(refused(&bytes[..45]), "Response: contacts: 45 bytes, expected a multiple of 48");
        let deep = contacts_to_bytes(&[contact(1, f32::NAN)]);
        assert_eq!(refused(&deep), "Response: contacts: a number that is none, expected metres");
        let long = contacts_to_bytes(&[HullContact { normal_world: [2.0, 0.0, 0.0], ..contact(1, 0.0) }]);
        assert_eq!(refused(&long), "Response: contacts: a normal of length 2, expected 1");
    }
}
