//! What peers without a right may do: nothing.

#[path = "../shared/certified.rs"]
mod certified;
#[path = "../shared/namespace.rs"]
mod namespace;
#[path = "../shared/room.rs"]
mod room;

mod certificates;
mod on_the_wire;
mod page_port;
