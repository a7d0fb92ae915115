//! What tests of all crates share: processes that end with their test, a camera program, skipped tests that are
//! reported, and whether the machine was too busy to judge speed. A dev-dependency only: nothing of it is in the product.

// The build script compiles it as a program; here it is formatted, linted and tested.
#[allow(dead_code, reason = "its main function is the program's")]
mod camera;
mod help;
mod running;
mod skip;
mod starvation;
mod sweep;

pub use help::help_is_wrapped_once;
pub use running::Running;
pub use skip::{has_program, skip};
pub use starvation::{Watch, ran_out_of_time};
pub use sweep::{command, mark};

/// The camera program: writes the frames of a film again and again, each when it is due. `src/camera.rs` lists its
/// arguments.
pub const CAMERA: &str = concat!(env!("OUT_DIR"), "/camera");
