//! What files and options say is read rightly, or refused in one line.

#[path = "../../crates/segment/tests/common/mod.rs"]
#[allow(dead_code, reason = "only the folder is wanted here")]
mod datasets;

mod bad_input;
mod film_files;
mod help;
mod query_input;
mod scenes;
mod sync_check;
