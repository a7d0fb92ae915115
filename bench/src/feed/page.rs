//! A page that reads all it is sent and draws nothing.

use std::net::SocketAddr;

use film_time::unix_now_s;
use futures::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

use setup::cli::{Failure, Outcome};

/// At these places of a binary message stand its kind, its number and when the frame was captured.
const KIND: usize = 4;
const SEQ: usize = 8;
const CAPTURED: usize = 24;
const FRAME_SET: u8 = 1;

/// One connection to a feed.
pub struct Page {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    /// Frames a second of the film.
    pub fps: f64,
    /// How many cameras film.
    pub cameras: usize,
}

/// A message of the feed.
pub enum PageMessage {
    /// Bytes of one frame set, and how long ago the film was captured, seconds, if that is known.
    FrameSet { bytes: usize, delay_s: Option<f64> },
    /// Any other binary message, by its bytes.
    Other { bytes: usize },
    /// A JSON text, by its bytes too.
    Text { bytes: usize, text: Value },
    /// The server has closed.
    Closed,
}

impl Page {
    /// Connects to a feed and reads what is filmed.
    pub async fn connect(server: SocketAddr) -> Outcome<Page> {
        let address = format!("ws://{server}/feed");
        let (socket, _) = tokio_tungstenite::connect_async(address).await.map_err(Failure::run)?;
        let mut page = Page { socket, fps: 0.0, cameras: 0 };
        loop {
            match page.receive().await? {
                PageMessage::Text { text, .. } if text["op"] == "hello" => {
                    page.fps = text["fps"].as_f64().unwrap_or_default();
                    page.cameras = text["cameras"].as_array().map_or(0, Vec::len);
                    return Ok(page);
                }
                PageMessage::Closed => return Err(Failure::run("the feed has closed before it said hello")),
                _ => {}
            }
        }
    }

    /// Looks at all frame sets and worlds, or at the run's figures alone.
    pub async fn look(&mut self, looks: bool) -> Outcome {
        let (fps, state_hz) = if looks { (self.fps, 60) } else { (0.0, 0) };
        self.send(&json!({ "op": "want", "fps": fps, "state_hz": state_hz })).await
    }

    /// The next message; frame sets are acknowledged as shown.
    pub async fn receive(&mut self) -> Outcome<PageMessage> {
        loop {
            match self.socket.next().await {
                Some(Ok(Message::Binary(bytes))) if bytes.get(KIND) == Some(&FRAME_SET) => {
                    let set =
                        FrameSet::read(&bytes).ok_or_else(|| Failure::run("a frame set is too short"))?;
                    self.send(&json!({ "op": "shown", "seq": set.seq })).await?;
                    return Ok(PageMessage::FrameSet { bytes: bytes.len(), delay_s: set.delay_s });
                }
                Some(Ok(Message::Binary(bytes))) => return Ok(PageMessage::Other { bytes: bytes.len() }),
                Some(Ok(Message::Text(text))) => {
                    let bytes = text.len();
                    let text = serde_json::from_str(&text).map_err(Failure::run)?;
                    return Ok(PageMessage::Text { bytes, text });
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return Ok(PageMessage::Closed),
                // Pings are answered as the socket is read.
                Some(Ok(_)) => {}
            }
        }
    }

    async fn send(&mut self, text: &Value) -> Outcome {
        // A server that has closed is message of at the next reading.
        self.socket.send(Message::text(text.to_string())).await.or(Ok(()))
    }
}

struct FrameSet {
    seq: u32,
    delay_s: Option<f64>,
}

impl FrameSet {
    fn read(bytes: &[u8]) -> Option<FrameSet> {
        let seq = u32::from_le_bytes(*bytes.get(SEQ..)?.first_chunk()?);
        let captured_unix_s = f64::from_le_bytes(*bytes.get(CAPTURED..)?.first_chunk()?);
        let delay_s = (captured_unix_s > 0.0).then(|| unix_now_s() - captured_unix_s);
        Some(FrameSet { seq, delay_s })
    }
}
