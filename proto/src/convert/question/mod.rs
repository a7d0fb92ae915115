//! Questions to messages and back. Bodies travel once: a stream keeps the last list of bodies with their
//! poses, and a question chooses among its points.

mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::QuestionReader;
pub use write::{QuestionWriter, StreamKnows, WrittenQuestion};

use hull::question::Points;

/// Most bodies of a list.
const MAX_BODIES: usize = 1 << 16;

/// A list with more points of the world than this is not kept: registered shapes are what keeping is for.
const KEPT_WORLD_POINTS: usize = 1 << 16;

fn is_kept(bodies: &[Points]) -> bool {
    let world = |points: &Points| if matches!(points, Points::World(_)) { points.len() } else { 0 };
    bodies.iter().map(world).sum::<usize>() <= KEPT_WORLD_POINTS
}
