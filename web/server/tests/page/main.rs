//! The page's port over real sockets: pages, programs, and what is hostile to both. One program, because each takes half a minute
//! to build.

mod common;
mod crowds;
mod hostile;
mod http;
mod https;
mod json_frames;
mod links;
mod pages;
mod paused;
mod vectors;
