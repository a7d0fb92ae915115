//! What the program's commands and its benches share: how they fail, files written whole, standard output, progress
//! on a terminal, temporary folders, sizes and named values on the command line.

mod argument;
mod failure;
mod named;
mod output;
mod output_file;
mod progress;
mod temporary;

pub use crate::{out, outln};
pub use argument::{ArgumentError, parse_size};
pub use failure::{Failure, Outcome};
pub use named::{NamedValue, PRECISIONS, RESPONSES, named};
pub use output::print;
pub use output_file::{check_json_writable, check_writable, write_whole};
pub use progress::{Progress, while_working};
pub use temporary::temporary_folder;
