//! TLS handshakes that are begun and never ended.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;

use net::{Authority, Credentials, Identity, Validity};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::Instant;

use super::again;
use super::certified::{ROOM, issue};
use super::counts::Count;

pub static REPLAYS: Count = Count::new("first messages of TLS replayed");

/// Bytes of a record's header: its type, the version, and its length.
const HEADER_BYTES: usize = 5;

/// The first message of a coordinator of another authority, as it is on the wire.
pub async fn client_hello(folder: &Path) -> Arc<Vec<u8>> {
    let authority = Authority::make(ROOM, Validity::days(1)).expect("an authority");
    let owner = Identity::coordinator(ROOM);
    let folder = folder.join("untrusted");
    issue(&folder, &authority, &owner, Validity::days(1));
    let credentials = Arc::new(Credentials::open(&folder, owner).expect("its own"));
    let (ours, mut wire) = tokio::io::duplex(1 << 16);
    let connecting =
        tokio::spawn(async move { credentials.connect(ours, &Identity::node(ROOM, "left")).await });
    let mut message = vec![0; HEADER_BYTES];
    wire.read_exact(&mut message).await.expect("a header");
    let length = u16::from_be_bytes([message[3], message[4]]);
    message.resize(HEADER_BYTES + usize::from(length), 0);
    wire.read_exact(&mut message[HEADER_BYTES..]).await.expect("a message");
    connecting.abort();
    Arc::new(message)
}

/// Replays it as fast as connections are made.
pub fn replay(peers: &mut JoinSet<()>, message: &Arc<Vec<u8>>, address: SocketAddr, until: Instant) {
    for _ in 0..4 {
        let message = Arc::clone(message);
        peers.spawn(again(until, move || replay_once(Arc::clone(&message), address)));
    }
}

async fn replay_once(message: Arc<Vec<u8>>, address: SocketAddr) -> Option<()> {
    loop {
        let mut socket = TcpStream::connect(address).await.ok()?;
        socket.write_all(&message).await.ok()?;
        REPLAYS.add(1);
        // The server's own first message, or the end: a refusal costs it nothing.
        let _ = socket.read(&mut [0; 64]).await;
    }
}
