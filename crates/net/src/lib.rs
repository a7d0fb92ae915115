//! Identities of a room, and how many connections a port keeps ([`admission`]).
//!
//! A certificate of the room's authority names its owner (an [`Identity`]); a folder of such certificates
//! ([`Credentials`]) makes TLS 1.3 sockets between those who have one, and [`Authority`] makes the folder where no
//! other authority does.

pub mod admission;
mod authority;
mod credentials;
mod error;
mod folder;
mod handshake_limit;
mod loaded;
mod name;
mod names;
mod page_name;
mod socket;
#[cfg(test)]
mod tests;
mod unix_socket;

pub use authority::{Authority, AuthorityError, Issued, Validity};
pub use credentials::Credentials;
pub use error::{CertificateError, HandshakeError};
pub use folder::{AUTHORITIES, CERTIFICATE, KEY};
pub use handshake_limit::HandshakeLimit;
pub use name::{Identity, Peer, Role};
pub use names::CertificateNames;
pub use page_name::{PageName, PageNameError};
pub use socket::{ClientSocket, ServerSocket};
pub use unix_socket::UnixSocket;
