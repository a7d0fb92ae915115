//! The coordinator: asks the nodes, merges their answers and steps the world.
