//! How bodies answer the hull, as benches name it.

use clap::ValueEnum;
use sim::ResponseMode;

/// How bodies answer the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Response {
    /// The paper's: translate, and mirror the velocity.
    Paper,
    /// Contacts with planes of the hull's surface, in the physics solver.
    Contacts,
}

impl Response {
    fn mode(self) -> ResponseMode {
        match self {
            Response::Paper => ResponseMode::Paper,
            Response::Contacts => ResponseMode::Contacts,
        }
    }

    /// As on the command line.
    pub fn name(self) -> &'static str {
        self.mode().name()
    }
}
