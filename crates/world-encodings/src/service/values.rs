//! Vectors of the gRPC service.

use proto::v1::Vector;
use thiserror::Error;

/// A field that must be there is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{field} is missing, expected {expected}")]
pub struct Missing {
    /// Its path in the message.
    pub field: &'static str,
    /// What would be right.
    pub expected: &'static str,
}

/// Numbers as a vector.
pub fn vector([x, y, z]: [f64; 3]) -> Vector {
    Vector { x, y, z }
}

/// A vector's numbers; none of them is checked.
pub fn numbers(Vector { x, y, z }: Vector) -> [f64; 3] {
    [x, y, z]
}

/// The same of a field that must be there.
pub fn needed(field: &'static str, found: Option<Vector>) -> Result<[f64; 3], Missing> {
    found.map(numbers).ok_or(Missing { field, expected: "a vector" })
}
