//! The one client of a camera node. It connects, and again whenever the connection breaks; it checks who
//! answers, puts questions on their way, hands on what the node reports, and counts bytes at the socket. What
//! any of it means is for the caller to decide.

mod agreement;
mod client;
mod clock_estimate;
mod connection;
mod counting;
mod error;
mod pictures;
mod place;
mod reply_limits;
mod status;
mod world;

pub use agreement::{Agreement, ExpectedNode, Role};
pub use client::{NodeClient, NodeEvent};
pub use connection::{Destination, Dial, Socket, Sockets};
pub use counting::ByteCounts;
pub use error::{Mismatch, NodeError};
pub use pictures::{FETCH_TIMEOUT, NodePictures, PicturesError};
pub use place::{FindNode, NodePlace, Sought};
pub use status::{NodeReport, StatusClient};
