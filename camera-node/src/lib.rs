//! A camera node: sources, segmentation, the ring of silhouettes, and the service that answers probes.

pub mod source;
