//! Who wants to lead a node.

/// A claim to a node: one coordinator at a time leads it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// A number that no other peer knows; never 0.
    pub id: u64,
    /// A higher one displaces a holder that is there.
    pub term: u64,
    /// For messages.
    pub name: String,
}
