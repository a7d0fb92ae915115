//! A process that ends with its test.

use std::io;
use std::process::{Child, Command, Output};

/// A process that is killed and reaped when this is dropped, also when its test panics. A process of
/// [`crate::command`] ends with the test's process as well, however that one ends.
pub struct Running(Option<Child>);

impl Running {
    /// Starts it.
    #[track_caller]
    pub fn start(command: &mut Command) -> Running {
        match command.spawn() {
            Ok(child) => Running(Some(child)),
            Err(error) => panic!("cannot start {command:?}: {error}"),
        }
    }

    /// The process.
    pub fn child(&mut self) -> &mut Child {
        self.0.as_mut().expect("it was not waited for")
    }

    /// Its number.
    pub fn id(&self) -> u32 {
        self.0.as_ref().expect("it was not waited for").id()
    }

    /// Waits until it has ended by itself.
    pub fn wait_with_output(mut self) -> io::Result<Output> {
        self.0.take().expect("it was not waited for").wait_with_output()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            // Neither call fails on a child that is not yet reaped.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
