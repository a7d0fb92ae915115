//! A small HTTP port beside a service, on a thread of its own: `/metrics` as OpenMetrics text, `/live` and `/ready`
//! ([`TelemetryPort`]). What is told there is the service's own ([`Telemetry`]), written on a [`Sheet`].
//!
//! Any peer that reaches the port may ask, so nothing here is secret and nothing can be changed. Untrusted peers hold a few
//! connections, each for seconds, and the oldest is evicted.

mod heartbeat;
mod server;
mod sheet;
mod telemetry;

pub use heartbeat::Heartbeat;
pub use sheet::{Buckets, Labels, Sheet};
pub use telemetry::{PortError, Telemetry, TelemetryPort};
