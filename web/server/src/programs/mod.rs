//! Interfaces for programs: the world as JSON, over gRPC and as Open Sound Control.

pub(crate) mod osc;
mod state_socket;
mod ticks;
pub(crate) mod world_service;

pub use osc::{Osc, OscError};
pub(crate) use state_socket::routes as json_routes;
pub(crate) use world_service::routes as grpc_routes;
