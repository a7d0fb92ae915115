//! Where a node listens and where a coordinator finds it.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use thiserror::Error;

/// What a path of a Unix socket begins with in text.
const UNIX: &str = "unix:";

/// The longest path of a Unix socket, bytes: what `sockaddr_un` holds beside its final zero.
pub const MAX_SOCKET_PATH_BYTES: usize = 107;

/// The address of a node.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Address {
    /// `host:port`, over TCP.
    Tcp(String),
    /// `unix:PATH`: a socket in the file system, for nodes on the coordinator's own machine.
    Unix(PathBuf),
}

/// Why a text is no address.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum AddressError {
    /// Neither form.
    #[error("found {0:?}, expected \"host:port\" or \"unix:/path\"")]
    Form(String),
    /// A path that no socket can have.
    #[error("found a socket path of {found} bytes, expected 1 to {MAX_SOCKET_PATH_BYTES}")]
    Path {
        /// Its length, bytes.
        found: usize,
    },
}

impl Address {
    /// The address of a Unix socket.
    pub fn unix(path: impl Into<PathBuf>) -> Result<Address, AddressError> {
        let path = path.into();
        match path.as_os_str().len() {
            1..=MAX_SOCKET_PATH_BYTES => Ok(Address::Unix(path)),
            found => Err(AddressError::Path { found }),
        }
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Address, AddressError> {
        if let Some(path) = text.strip_prefix(UNIX) {
            return Address::unix(path);
        }
        let is_host_and_port = text.rsplit_once(':').is_some_and(|(host, port)| {
            !host.is_empty()
                && !host.contains(char::is_whitespace)
                && port.parse::<u16>().is_ok_and(|port| port > 0)
        });
        if is_host_and_port { Ok(Address::Tcp(text.into())) } else { Err(AddressError::Form(text.into())) }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Address::Tcp(text) => formatter.write_str(text),
            Address::Unix(path) => write!(formatter, "{UNIX}{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_come_back_as_they_were_written() {
        for text in ["127.0.0.1:7001", "pc-left:7001", "[::1]:7001", "unix:/run/left.sock", "unix:left.sock"]
        {
            assert_eq!(text.parse::<Address>().expect("an address").to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_says_what_was_expected() {
        let refused = |text: &str| text.parse::<Address>().expect_err("no address").to_string();
        for text in ["", "host", "host:0", "host:70000", "my host:1", ":7001"] {
            assert_eq!(refused(text), format!("found {text:?}, expected \"host:port\" or \"unix:/path\""));
        }
        assert_eq!(refused("unix:"), "found a socket path of 0 bytes, expected 1 to 107");
        let long = format!("unix:/{}", "x".repeat(107));
        assert_eq!(refused(&long), "found a socket path of 108 bytes, expected 1 to 107");
    }
}
