//! What one pass takes, and where: a tree of spans over all processes, by OpenTelemetry, for users with a collector.
//! Without an [`Exporter`] a [`Span`] is nothing, and costs nothing.

mod endpoint;
mod exporter;
mod span;

pub use endpoint::{Endpoint, EndpointError};
pub use exporter::{Exporter, OtlpError, Process};
pub use span::Span;
