//! The wire between coordinator and nodes, and its conversions to and from the hull's own types.
