//! Where a node listens: a TCP address, or a Unix socket for a coordinator on the same machine.

use std::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use net::UnixSocket;
use proto::{Address, AddressError};
use thiserror::Error;
use tokio::net::{TcpListener, TcpStream, UnixListener};

/// Connections that wait to be accepted: a node has one coordinator, and perhaps an operator looks.
const BACKLOG: i32 = 128;

/// Where to listen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Listen {
    /// An IP address with port; port 0 is any free one.
    Tcp(SocketAddr),
    /// A socket in the file system. Only this user may connect to it.
    Unix(PathBuf),
}

/// Why a text is no address to listen on.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ListenError {
    /// It is something else.
    #[error("found {0:?}, expected an IP address with port, or \"unix:/path\"")]
    Form(String),
    /// It is a path that no socket can have.
    #[error(transparent)]
    Path(AddressError),
}

impl From<SocketAddr> for Listen {
    fn from(address: SocketAddr) -> Listen {
        Listen::Tcp(address)
    }
}

impl FromStr for Listen {
    type Err = ListenError;

    fn from_str(text: &str) -> Result<Listen, ListenError> {
        if let Ok(address) = text.parse() {
            return Ok(Listen::Tcp(address));
        }
        match text.parse() {
            Ok(Address::Unix(path)) => Ok(Listen::Unix(path)),
            Ok(Address::Tcp(_)) | Err(AddressError::Form(_)) => Err(ListenError::Form(text.to_owned())),
            Err(error @ AddressError::Path { .. }) => Err(ListenError::Path(error)),
        }
    }
}

impl fmt::Display for Listen {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Listen::Tcp(address) => address.fmt(formatter),
            Listen::Unix(path) => Address::Unix(path.clone()).fmt(formatter),
        }
    }
}

/// A socket that listens.
pub(crate) enum Listener {
    Tcp(TcpListener),
    Unix(UnixListener, SocketFile),
}

impl Listener {
    /// Listens; must run within a tokio runtime. A socket file of this user that no process listens on any
    /// more is replaced.
    pub async fn bind(listen: &Listen) -> io::Result<Listener> {
        match listen {
            Listen::Tcp(address) => TcpListener::bind(address).await.map(Listener::Tcp),
            Listen::Unix(path) => {
                remove_stale(path)?;
                let socket = socket2::Socket::new(socket2::Domain::UNIX, socket2::Type::STREAM, None)?;
                socket.bind(&socket2::SockAddr::unix(path)?)?;
                let file = SocketFile::of(path)?;
                // Before it listens no process can connect, so other users never can.
                std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
                socket.listen(BACKLOG)?;
                socket.set_nonblocking(true)?;
                Ok(Listener::Unix(UnixListener::from_std(socket.into())?, file))
            }
        }
    }

    /// The next connection. A connection over TCP does not wait to fill packets.
    pub async fn accept(&self) -> io::Result<Accepted> {
        match self {
            Listener::Tcp(listener) => {
                let (socket, from) = listener.accept().await?;
                socket.set_nodelay(true)?;
                Ok(Accepted::Tcp(socket, from.ip().to_canonical()))
            }
            Listener::Unix(listener, _) => UnixSocket::new(listener.accept().await?.0).map(Accepted::Unix),
        }
    }

    /// Where it listens, with the port it found.
    pub fn address(&self) -> io::Result<Listen> {
        match self {
            Listener::Tcp(listener) => listener.local_addr().map(Listen::Tcp),
            Listener::Unix(_, file) => Ok(Listen::Unix(file.path.clone())),
        }
    }
}

/// A connection of which nothing is known.
pub(crate) enum Accepted {
    Tcp(TcpStream, IpAddr),
    Unix(UnixSocket),
}

impl Accepted {
    /// The machine that it comes from; none over a Unix socket.
    pub fn from(&self) -> Option<IpAddr> {
        match self {
            Accepted::Tcp(_, from) => Some(*from),
            Accepted::Unix(_) => None,
        }
    }
}

/// The file of a socket; removed when this is dropped, unless it was replaced.
pub(crate) struct SocketFile {
    path: PathBuf,
    identity: (u64, u64),
}

impl SocketFile {
    fn of(path: &Path) -> io::Result<SocketFile> {
        Ok(SocketFile { path: path.to_owned(), identity: identity(path)? })
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|identity| identity == self.identity) {
            // If it cannot be removed, the next node finds it stale.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    std::fs::symlink_metadata(path).map(|found| (found.dev(), found.ino()))
}

/// Removes a socket of this user that no process listens on. Anything else stays, and is an error.
fn remove_stale(path: &Path) -> io::Result<()> {
    let found = match std::fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        found => found?,
    };
    if !found.file_type().is_socket() {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "something that is no socket is there"));
    }
    if found.uid() != rustix::process::getuid().as_raw() {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "another user's socket is there"));
    }
    match UnixStream::connect(path) {
        Ok(_) => Err(io::Error::new(io::ErrorKind::AddrInUse, "another node listens there")),
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => std::fs::remove_file(path),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_socket_file_lives_as_long_as_its_listener() {
        let folder = tempfile::tempdir().expect("folder");
        let listen = Listen::Unix(folder.path().join("node.sock"));
        let Listen::Unix(path) = &listen else { unreachable!() };
        let listener = Listener::bind(&listen).await.expect("listens");
        assert_eq!(listener.address().expect("bound"), listen);
        assert_eq!(std::fs::metadata(path).expect("there").mode() & 0o777, 0o600);
        drop(listener);
        assert!(!path.exists());
    }

    #[tokio::test]
    async fn a_stale_socket_is_replaced_and_a_living_one_is_not() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("node.sock");
        // The standard library leaves the file behind, as a killed process does.
        drop(std::os::unix::net::UnixListener::bind(&path).expect("bound"));
        assert!(path.exists());
        let listen = Listen::Unix(path);
        let first = Listener::bind(&listen).await.expect("replaces it");
        let error = Listener::bind(&listen).await.err().expect("in use");
        assert_eq!(error.kind(), io::ErrorKind::AddrInUse);
        drop(first);
    }

    #[tokio::test]
    async fn a_file_that_is_no_socket_is_left_alone() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("notes.txt");
        std::fs::write(&path, "mine").expect("written");
        let error = Listener::bind(&Listen::Unix(path.clone())).await.err().expect("refused");
        assert_eq!(error.to_string(), "something that is no socket is there");
        assert_eq!(std::fs::read_to_string(path).expect("still there"), "mine");
    }
}
