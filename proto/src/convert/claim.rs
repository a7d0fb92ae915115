//! Claims to a node: messages and back.

use super::ConvertError;
use super::bulk::Field;
use crate::text::{MAX_NAME_CHARS, clean};
use crate::{Claim, v1};

/// A coordinator that takes over claims the term after the greatest one, and that is a number too.
const MAX_TERM: u64 = 1 << 62;

/// A claim.
pub fn claim_to_wire(claim: Claim) -> v1::HoldRequest {
    let Claim { id, term, name } = claim;
    v1::HoldRequest { holder: id, term, name }
}

/// A claim of a peer; its name is cleaned.
pub fn claim_from_wire(request: v1::HoldRequest) -> Result<Claim, ConvertError> {
    let v1::HoldRequest { holder, term, name } = request;
    if holder == 0 {
        return Err(Field("HoldRequest", "holder").value("is 0, expected a number that no other peer knows"));
    }
    if term > MAX_TERM {
        return Err(Field("HoldRequest", "term").value(format!("is {term}, expected at most {MAX_TERM}")));
    }
    Ok(Claim { id: holder, term, name: clean(&name, MAX_NAME_CHARS) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_has_an_id_and_a_clean_name() {
        let claim = Claim { id: 7, term: 3, name: "left".into() };
        assert_eq!(claim_from_wire(claim_to_wire(claim.clone())), Ok(claim.clone()));
        let anonymous = v1::HoldRequest { holder: 0, ..claim_to_wire(claim.clone()) };
        assert!(claim_from_wire(anonymous).is_err());
        for term in [u64::MAX, u64::MAX - 1, MAX_TERM + 1] {
            let for_ever = v1::HoldRequest { term, ..claim_to_wire(claim.clone()) };
            assert!(claim_from_wire(for_ever).is_err(), "{term}");
        }
        let dirty = v1::HoldRequest { name: "a\x1b[2Jb\n".repeat(1000), ..claim_to_wire(claim) };
        let name = claim_from_wire(dirty).expect("a claim").name;
        assert!(name.chars().count() <= MAX_NAME_CHARS + 1 && !name.chars().any(char::is_control), "{name}");
    }
}
