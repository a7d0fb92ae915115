//! What the program's commands and its benches share: how they fail, files written whole, standard output, progress
//! on a terminal, temporary folders, sizes and precisions on the command line.

mod argument;
mod failure;
mod output;
mod output_file;
mod precision;
mod progress;
mod temporary;

pub use crate::argument::{ArgumentError, parse_size};
pub use crate::failure::{Failure, Outcome};
pub use crate::output::print;
pub use crate::output_file::{check_writable, write_whole};
pub use crate::precision::PrecisionName;
pub use crate::progress::{Progress, while_working};
pub use crate::temporary::temporary_folder;
