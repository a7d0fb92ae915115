//! A link that carries so much and no more.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::time::Instant;

use setup::cli::{Failure, Outcome};

/// What the relay takes at once, and about what its socket holds: the payload of a packet and some packets.
const PACKET: usize = 1448;
const HELD: u32 = 16 << 10;

/// Where to connect to instead of `server`, for as long as this runtime runs.
pub async fn relay(server: SocketAddr, mbit_per_s: f64) -> Outcome<SocketAddr> {
    let listener = TcpListener::bind("127.0.0.1:0").await.map_err(Failure::run)?;
    let address = listener.local_addr().map_err(Failure::run)?;
    tokio::spawn(async move {
        while let Ok((client, _)) = listener.accept().await {
            tokio::spawn(async move {
                if let Err(error) = pass(client, server, mbit_per_s * 1e6 / 8.0).await {
                    tracing::debug!("the link has ended: {error}");
                }
            });
        }
    });
    Ok(address)
}

async fn pass(client: TcpStream, server: SocketAddr, bytes_per_s: f64) -> std::io::Result<()> {
    let socket = TcpSocket::new_v4()?;
    socket.set_recv_buffer_size(HELD)?;
    let (mut from_server, mut to_server) = socket.connect(server).await?.into_split();
    let (mut from_client, mut to_client) = client.into_split();
    let down = async {
        let mut packet = [0; PACKET];
        let mut free_at = Instant::now();
        loop {
            let length = from_server.read(&mut packet).await?;
            if length == 0 {
                return to_client.shutdown().await;
            }
            free_at = free_at.max(Instant::now()) + Duration::from_secs_f64(length as f64 / bytes_per_s);
            tokio::time::sleep_until(free_at).await;
            to_client.write_all(&packet[..length]).await?;
        }
    };
    let up = tokio::io::copy(&mut from_client, &mut to_server);
    tokio::try_join!(down, up).map(|_| ())
}
