//! Standard output. `print!` panics when its reader has gone or the disk is full; this ends the command instead.

use std::fmt;
use std::io::{self, ErrorKind, Write as _};

use super::failure::{Failure, Outcome};

/// Prints a text to standard output, at once.
pub fn print(text: fmt::Arguments<'_>) -> Outcome {
    let mut stdout = io::stdout().lock();
    stdout.write_fmt(text).and_then(|()| stdout.flush()).map_err(|error| match error.kind() {
        ErrorKind::BrokenPipe => Failure::Closed,
        _ => Failure::run(format_args!("cannot write to standard output: {error}")),
    })
}

/// Prints to standard output, with the arguments of `format!`; an [`Outcome`].
#[macro_export]
macro_rules! out {
    ($($argument:tt)*) => { $crate::cli::print(::std::format_args!($($argument)*)) };
}

/// The same and the end of a line.
#[macro_export]
macro_rules! outln {
    () => { $crate::cli::print(::std::format_args!("\n")) };
    ($($argument:tt)*) => {
        $crate::cli::print(::std::format_args!("{}\n", ::std::format_args!($($argument)*)))
    };
}
