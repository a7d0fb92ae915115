//! What untrusted peers do at the page's port of a coordinator.

use std::net::SocketAddr;
use std::time::Duration;

use futures::{SinkExt as _, StreamExt as _};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{Error, Message};

use super::counts::Count;
use super::{again, silent_sockets};

pub static PING_BYTES: Count = Count::new("bytes of pings");
pub static REQUESTS: Count = Count::new("requests for small files");
pub static GUESSES: Count = Count::new("tokens guessed");

/// Requests a second.
const REQUESTS_PER_S: f64 = 150.0;

/// All at once, until then.
pub fn attack(peers: &mut JoinSet<()>, address: SocketAddr, until: Instant) {
    for path in ["feed", "state"] {
        peers.spawn(again(until, move || pings(address, path)));
    }
    peers.spawn(again(until, move || small_requests(address)));
    (0..2).for_each(|_| drop(peers.spawn(again(until, move || guesses(address)))));
    peers.spawn(again(until, move || silent_sockets(address, 100)));
}

/// Pings as fast as they are taken, whose answers are not read.
async fn pings(address: SocketAddr, path: &'static str) -> Option<()> {
    let (socket, _) = tokio_tungstenite::connect_async(format!("ws://{address}/{path}")).await.ok()?;
    let (mut sink, _unread) = socket.split();
    loop {
        sink.send(Message::Ping(vec![0; 125].into())).await.ok()?;
        PING_BYTES.add(125);
    }
}

async fn small_requests(address: SocketAddr) -> Option<()> {
    loop {
        let mut socket = TcpStream::connect(address).await.ok()?;
        let request = format!("GET /robots.txt HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
        socket.write_all(request.as_bytes()).await.ok()?;
        // One that had to give way is reset.
        let _ = socket.read_to_end(&mut Vec::new()).await;
        REQUESTS.add(1);
        sleep(Duration::from_secs_f64(1.0 / REQUESTS_PER_S)).await;
    }
}

/// Opens pages with one wrong token after the other.
async fn guesses(address: SocketAddr) -> Option<()> {
    for number in 0_u64.. {
        let mut request = format!("ws://{address}/feed").into_client_request().ok()?;
        let protocols = format!("hulltouch.feed.v1, hulltouch.token.guess{number:010}").parse().ok()?;
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
        match tokio_tungstenite::connect_async(request).await {
            Ok(_) | Err(Error::Http(_)) => GUESSES.add(1),
            Err(_) => return None,
        }
    }
    Some(())
}
