//! Containers, Kubernetes and systemd run what is shipped.

#[path = "../shared/arguments.rs"]
mod arguments;
#[allow(dead_code, reason = "not every test needs it")]
#[path = "../shared/http.rs"]
mod http;
#[path = "../shared/room.rs"]
mod room;

mod containers;
mod kubernetes;
mod systemd;
