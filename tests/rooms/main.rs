//! Rooms of node and coordinator processes: how they are found, led, watched, and what they remember.

#[path = "../shared/announcements.rs"]
mod announcements;
#[path = "../shared/certified.rs"]
mod certified;
#[allow(dead_code, reason = "not every test needs it")]
#[path = "../shared/http.rs"]
mod http;
#[path = "../shared/link.rs"]
mod link;
#[path = "../shared/namespace.rs"]
mod namespace;
#[path = "../shared/prometheus.rs"]
mod prometheus;
#[path = "../shared/room.rs"]
mod room;
#[path = "../shared/wall_clock.rs"]
mod wall_clock;

mod clocks;
mod discovery;
mod doctor;
mod live_numbers;
mod names;
mod one_coordinator;
mod pinned_memory;
mod sample;
mod status;
mod traces;
mod watched;
mod world_memory;
