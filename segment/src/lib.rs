//! Background subtraction: camera frames to silhouettes.
