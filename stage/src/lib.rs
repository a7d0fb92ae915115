//! A synthetic studio: an actor, props and a room, rendered for every camera, with ground truth.
