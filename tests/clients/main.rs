//! Viewers and programs that steer, record and replay.

#[path = "../shared/demo.rs"]
mod demo;

mod examples;
mod page;
mod playback;
mod programs;
mod recording;
mod steering;
