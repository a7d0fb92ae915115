//! What a room does when processes, links, sources and signals fail.

#[path = "../shared/link.rs"]
mod link;
#[path = "../shared/namespace.rs"]
mod namespace;
#[path = "../shared/room.rs"]
mod room;

mod far_nodes;
mod film_faults;
mod going_on;
mod signals;
