//! A folder of certificates, as it is now.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use parking_lot::Mutex;
use rustls::pki_types::{ServerName, UnixTime};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_rustls::{TlsAcceptor, TlsConnector};

use crate::error::{CertificateError, HandshakeError};
use crate::folder::Files;
use crate::loaded::{Loaded, peer_of};
use crate::name::{Identity, Peer};
use crate::socket::{ClientSocket, ServerSocket};

/// A folder that cannot be read within this stands on a drive that hangs.
const READ_TIMEOUT: Duration = Duration::from_secs(1);
/// The folder is read no more often: handshakes between two readings use the certificates of the last one.
const READ_EVERY: Duration = Duration::from_secs(1);
/// A peer that begins and then says nothing is dropped after this.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// Connections show certificates again this often, unless told otherwise.
const MAX_CONNECTION_AGE: Duration = Duration::from_secs(3600);

/// The certificates of one owner, which others may replace at any time: a handshake reads the folder if the last reading was
/// a second ago. What cannot be used leaves in use what was there before, and is logged.
pub struct Credentials {
    folder: PathBuf,
    own: Identity,
    max_connection_age: Duration,
    state: Mutex<State>,
    /// The folder is read by one at a time: what was read before is not put in use after. A reading on a drive that hangs
    /// keeps this locked.
    reading: Arc<tokio::sync::Mutex<()>>,
}

struct State {
    files: Files,
    loaded: Arc<Loaded>,
    /// When the last reading began.
    read: Instant,
    /// What was logged last.
    problem: Option<String>,
}

impl fmt::Debug for Credentials {
    /// Without the key.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Credentials({}, {})", self.own, self.folder.display())
    }
}

impl Credentials {
    /// Reads `ca.crt`, `tls.crt` and `tls.key`. An error if they do not fit each other, this owner, or the time.
    pub fn open(folder: &Path, own: Identity) -> Result<Credentials, CertificateError> {
        let files = Files::read(folder)?;
        let loaded = Arc::new(Loaded::new(folder, &files, &own, UnixTime::now())?);
        let state = Mutex::new(State { files, loaded, read: Instant::now(), problem: None });
        Ok(Credentials {
            folder: folder.to_owned(),
            own,
            max_connection_age: MAX_CONNECTION_AGE,
            state,
            reading: Arc::default(),
        })
    }

    /// The same where connections live for so long, and then show certificates again.
    pub fn with_max_connection_age(self, max_connection_age: Duration) -> Credentials {
        Credentials { max_connection_age, ..self }
    }

    /// How long connections live.
    pub fn max_connection_age(&self) -> Duration {
        self.max_connection_age
    }

    /// The identity that the certificate proves.
    pub fn own(&self) -> &Identity {
        &self.own
    }

    /// When the certificate ends that the folder holds now, or the one in use if the folder holds none or is being read.
    /// Blocks for a second at most.
    pub fn not_after(self: &Arc<Self>) -> SystemTime {
        if let Ok(turn) = Arc::clone(&self.reading).try_lock_owned() {
            let (credentials, (sender, read)) = (Arc::clone(self), std::sync::mpsc::channel());
            std::thread::spawn(move || {
                credentials.current();
                drop(turn);
                // No handshake may wait any more.
                let _ = sender.send(());
            });
            let _ = read.recv_timeout(READ_TIMEOUT);
        }
        self.not_after_in_use()
    }

    /// When the certificate ends that the last handshake used: the folder is not read again.
    pub fn not_after_in_use(&self) -> SystemTime {
        UNIX_EPOCH + self.state().loaded.not_after
    }

    /// Makes a server's side of a connection, and says who is on the other.
    pub async fn accept<S: AsyncRead + AsyncWrite + Unpin>(
        self: &Arc<Self>,
        socket: S,
    ) -> Result<(ServerSocket<S>, Peer), HandshakeError> {
        let loaded = self.read().await;
        let accepting = TlsAcceptor::from(Arc::clone(&loaded.server)).accept(socket);
        let socket = in_time(accepting).await?;
        let shown = socket.get_ref().1.peer_certificates().and_then(<[_]>::first);
        let peer = shown.and_then(|shown| peer_of(shown).ok()).unwrap_or_default();
        Ok((socket, peer))
    }

    /// Makes a server's side of a connection to a browser, which shows no certificate.
    pub async fn accept_without_certificate<S: AsyncRead + AsyncWrite + Unpin>(
        self: &Arc<Self>,
        socket: S,
    ) -> Result<ServerSocket<S>, HandshakeError> {
        let loaded = self.read().await;
        in_time(TlsAcceptor::from(Arc::clone(&loaded.page)).accept(socket)).await
    }

    /// Makes a client's side of a connection to exactly this peer.
    pub async fn connect<S: AsyncRead + AsyncWrite + Unpin>(
        self: &Arc<Self>,
        socket: S,
        to: &Identity,
    ) -> Result<ClientSocket<S>, HandshakeError> {
        let name = ServerName::try_from(to.to_string());
        let name =
            name.map_err(|_| HandshakeError::Refused(format!("{to} cannot be a certificate's name")))?;
        let loaded = self.read().await;
        let socket = in_time(TlsConnector::from(Arc::clone(&loaded.client)).connect(name, socket)).await;
        let socket = socket.map_err(HandshakeError::before_a_certificate)?;
        Ok(ClientSocket(socket))
    }

    /// What the folder holds, or what is in use if it was read within the last second, is being read, or its drive hangs.
    async fn read(self: &Arc<Self>) -> Arc<Loaded> {
        if self.state().read.elapsed() >= READ_EVERY
            && let Ok(turn) = Arc::clone(&self.reading).try_lock_owned()
        {
            self.state().read = Instant::now();
            let credentials = Arc::clone(self);
            let reading = tokio::task::spawn_blocking(move || {
                // Kept until the folder is read, also if the handshake no longer waits for that.
                let _turn = turn;
                credentials.current();
            });
            if tokio::time::timeout(READ_TIMEOUT, reading).await.is_err() {
                let (folder, after_s) = (self.folder.display(), READ_TIMEOUT.as_secs());
                tracing::error!(
                    "{folder} was not read within {after_s} s; the certificates that were there before stay in use"
                );
            }
        }
        Arc::clone(&self.state().loaded)
    }

    /// Reads the folder, and puts in use what it holds.
    fn current(&self) {
        let read = Files::read(&self.folder);
        let mut state = self.state();
        let loaded = match read {
            Ok(files) if files == state.files => None,
            Ok(files) => Some(
                Loaded::new(&self.folder, &files, &self.own, UnixTime::now()).map(|loaded| (files, loaded)),
            ),
            Err(error) => Some(Err(error)),
        };
        match loaded {
            None => state.problem = None,
            Some(Ok((files, loaded))) => {
                tracing::info!("certificates of {} were read again from {}", self.own, self.folder.display());
                (state.files, state.loaded, state.problem) = (files, Arc::new(loaded), None);
            }
            Some(Err(error)) => {
                let problem = error.to_string();
                if state.problem.as_ref() != Some(&problem) {
                    tracing::error!("{problem}; the certificates that were there before stay in use");
                }
                state.problem = Some(problem);
            }
        }
    }

    fn state(&self) -> parking_lot::MutexGuard<'_, State> {
        self.state.lock()
    }
}

async fn in_time<T>(handshake: impl Future<Output = std::io::Result<T>>) -> Result<T, HandshakeError> {
    match tokio::time::timeout(HANDSHAKE_TIMEOUT, handshake).await {
        Ok(made) => made.map_err(|error| HandshakeError::of(&error)),
        Err(_) => Err(HandshakeError::Timeout(HANDSHAKE_TIMEOUT)),
    }
}
