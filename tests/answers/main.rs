//! The same answers in process, gathered and from nodes; those of an independent program; on film of real people.

#[path = "../../crates/segment/tests/common/mod.rs"]
#[allow(dead_code, reason = "only the folder is wanted here")]
mod datasets;

mod cluster;
mod contract;
mod every_scene;
mod golden;
mod many_cameras;
mod quantised;
mod recordings;
mod shared_steps;
