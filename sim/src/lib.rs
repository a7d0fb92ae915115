//! The rigid-body world: scenes, surface samples and the answer to collisions with the visual hull.
