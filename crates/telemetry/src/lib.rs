//! What a service tells of itself.
//!
//! A small HTTP port beside a service, on a thread of its own: `/metrics` as OpenMetrics text, `/live` and `/ready`
//! ([`TelemetryPort`]). What is told there is the service's own ([`Telemetry`]), written on a [`Sheet`].
//!
//! Any peer that reaches the port may ask, so nothing here is secret and nothing can be changed. Untrusted peers hold a few
//! connections, each for seconds; when there are too many, the oldest of the machine that has most is evicted.
//!
//! What one pass takes, and where, is a tree of spans over all processes ([`Span`]), by OpenTelemetry, for users with a
//! collector. Whether its work gets on is a [`Pulse`], which [`systemd`]'s watchdog and `/live` ask.

mod histogram;
mod port;
mod pulse;
mod server;
mod sheet;
pub mod systemd;
mod traces;

pub use histogram::Histogram;
pub use port::{PortError, Telemetry, TelemetryPort};
pub use pulse::{Beat, Pulse, Stuck};
pub use sheet::{Buckets, Labels, Sheet};
pub use traces::{Endpoint, EndpointError, Exporter, OtlpError, Process, Span};
