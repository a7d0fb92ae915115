//! The feed: all that others see of a run and ask of it, over one HTTP port.
//!
//! A [`Feed`] runs on a thread of its own, with its own runtime: the loop never waits for a page. It serves
//! the page itself, its binary feed (a WebSocket), and what programs use. It knows a run by its
//! [`coordinator::live::Follower`], what it is by [`RunFacts`], and asks [`pictures::Pictures`] for
//! silhouettes and colours of a frame, only while somebody looks. `docs/feed.md` is the format in words.

pub mod commands;
mod connection;
mod facts;
mod gate;
pub mod hello;
mod hub;
mod incoming;
pub mod message;
mod orders;
pub mod osc;
mod outbox;
mod page;
mod page_frames;
mod page_state;
pub mod pictures;
mod server;
mod socket;
mod state_socket;
mod ticks;
mod tier;
mod world_service;

pub use facts::{RunFacts, Volume};
pub use gate::{Origin, Token};
pub use server::{Feed, FeedError, FeedSettings};
