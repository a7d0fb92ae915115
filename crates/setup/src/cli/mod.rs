//! What the program's commands and its benches share: how they fail, files written whole, standard output, progress
//! on a terminal, temporary folders, sizes, precisions and responses on the command line.

mod argument;
mod failure;
mod output;
mod output_file;
mod precision;
mod progress;
mod response;
mod temporary;

pub use crate::{out, outln};
pub use argument::{ArgumentError, parse_size};
pub use failure::{Failure, Outcome};
pub use output::print;
pub use output_file::{check_json_writable, check_writable, write_whole};
pub use precision::PrecisionName;
pub use progress::{Progress, while_working};
pub use response::ResponseName;
pub use temporary::temporary_folder;
