//! Pictures of a run from any viewpoint.
