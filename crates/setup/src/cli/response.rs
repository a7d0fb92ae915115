//! How bodies answer the hull, on the command line.

use clap::ValueEnum;
use sim::ResponseMode;

/// How bodies answer the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ResponseName {
    /// The paper's: translate, and mirror the velocity.
    Paper,
    /// Contacts with planes of the hull's surface, in the physics solver.
    Contacts,
}

impl ResponseName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        ResponseMode::from(self).name()
    }
}

impl From<ResponseName> for ResponseMode {
    fn from(name: ResponseName) -> ResponseMode {
        match name {
            ResponseName::Paper => ResponseMode::Paper,
            ResponseName::Contacts => ResponseMode::Contacts,
        }
    }
}
