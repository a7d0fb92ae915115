//! What the program's commands and its benches share: how they fail, files written whole, progress on a
//! terminal, sizes on the command line.

mod failure;
mod progress;
mod size;

pub use crate::failure::{Failure, Outcome, check_writable, write_whole};
pub use crate::progress::{Progress, while_working};
pub use crate::size::parse_size;
