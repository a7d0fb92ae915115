//! Folders for what a command needs while it runs.

use camera_node::scratch::ScratchFolder;

use super::failure::{Failure, Outcome};

/// A folder of this user alone, which goes when it is dropped.
pub fn temporary_folder() -> Outcome<ScratchFolder> {
    ScratchFolder::new().map_err(|error| {
        let parent = std::env::temp_dir();
        Failure::run(format_args!("cannot make a folder in {} (TMPDIR): {error}", parent.display()))
    })
}
