//! The feed: everything that viewers and programs see of a run and ask of it, over one HTTP port.
//!
//! A [`Feed`] runs on a thread of its own, with its own runtime: the loop never waits for a viewer. It serves
//! the page itself, its binary feed (a WebSocket), and interfaces for programs. It follows a run by a
//! [`coordinator::live::Follower`], describes it by [`RunInfo`], and asks [`pictures::Pictures`] for
//! silhouettes and colours of a frame, only while a page is connected. `docs/feed.md` describes the format.

mod commands;
mod fields;
pub mod fuzz;
mod http;
mod json;
pub mod message;
mod message_cache;
mod orders;
mod page;
pub mod pictures;
mod pings;
mod programs;
mod run_info;
mod server;
mod shared;
pub mod text;
mod tier;

pub use fields::InputError;
pub use http::{Origin, OriginError, RandomError, Token, TokenError};
pub use programs::{Osc, OscError};
pub use run_info::{RunInfo, Volume};
pub use server::{Feed, FeedError, FeedSettings};
