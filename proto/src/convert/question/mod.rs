//! Questions to messages and back. Bodies are told once: a stream keeps a few lists of bodies with their
//! poses, and a question names one and chooses among its points.

mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::QuestionReader;
pub use write::{QuestionWriter, StreamKnows, WrittenQuestion};

use hull::question::Points;

/// Lists of bodies that a stream keeps: one for each part of a pass that is asked apart.
pub const LISTS: usize = 8;

/// Bodies in one list.
const MAX_BODIES: usize = 1 << 16;

/// A list with more points of the world than this is not kept: registered shapes are what keeping is for.
const KEPT_WORLD_POINTS: usize = 1 << 16;

fn is_kept(bodies: &[Points]) -> bool {
    let world = |points: &Points| if matches!(points, Points::World(_)) { points.len() } else { 0 };
    bodies.iter().map(world).sum::<usize>() <= KEPT_WORLD_POINTS
}
