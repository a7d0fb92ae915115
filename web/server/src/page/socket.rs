//! One page: a WebSocket that gets the newest of everything, as fast as it takes it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Extension;
use axum::Router;
use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures::stream::{SplitSink, SplitStream};
use futures::{SinkExt as _, StreamExt as _};
use tokio::task::JoinHandle;

use super::outbox::{Item, Outbox};
use super::state::{Ending, Page};
use super::{STATUS_EVERY, WRITE_TIMEOUT};
use crate::http::{BytesSent, Connection};
use crate::pings::Pings;
use crate::shared::{Seats, Shared};
use crate::text;

/// The subprotocol, with the format's version.
const PROTOCOL: &str = "hulltouch.feed.v1";
/// A page offers its token as a subprotocol: browsers print the address of a socket that fails.
const TOKEN_PREFIX: &str = "hulltouch.token.";
/// The longest message of a page, bytes: a body of 256 points takes 20 KB.
const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// What WebSocket closes may give as a reason, bytes.
const MAX_REASON_BYTES: usize = 123;
/// How often a page is pinged.
const PING_EVERY: Duration = Duration::from_secs(1);

/// The page's socket.
pub(crate) fn routes() -> Router<Arc<Shared>> {
    Router::new().route("/feed", get(upgrade))
}

/// The token among the subprotocols that a page offers.
fn offered_token(headers: &HeaderMap) -> Option<&str> {
    let lists = headers.get_all(header::SEC_WEBSOCKET_PROTOCOL).iter().filter_map(|list| list.to_str().ok());
    lists.flat_map(|list| list.split(',')).find_map(|protocol| protocol.trim().strip_prefix(TOKEN_PREFIX))
}

async fn upgrade(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
    Extension(connection): Extension<Connection>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let is_controller = shared.may_steer(&connection, offered_token(&headers)).await;
    let Some(seat) = shared.pages.take(is_controller) else {
        let why = format!("{} pages look already, expected fewer\n", Seats::open_to(is_controller));
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    let staying = connection.stay();
    upgrade
        .protocols([PROTOCOL])
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(move |socket| async move {
            serve(socket, shared, is_controller, connection.bytes_sent()).await;
            drop((seat, staying));
        })
}

async fn serve(socket: WebSocket, shared: Arc<Shared>, is_controller: bool, bytes_sent: BytesSent) {
    let (sink, stream) = socket.split();
    let outbox = Arc::new(Outbox::default());
    let mut writing = Writing(tokio::spawn(write(sink, Arc::clone(&outbox))));
    shared.page_came();
    let mut page = Page::new(shared, Arc::clone(&outbox), is_controller, bytes_sent);
    let ending = tokio::select! {
        ending = talk(&mut page, stream) => ending,
        _ = &mut writing.0 => Ending::Disconnected,
    };
    let newest = page.newest_world();
    page.end();
    match ending {
        Ending::Disconnected => {}
        Ending::Stalled => tracing::info!("a page that stopped reading was dropped"),
        Ending::Bye(why) => {
            outbox.bye(why, newest);
            let _ = tokio::time::timeout(WRITE_TIMEOUT, &mut writing.0).await;
        }
    }
}

/// The task that writes to a page, which ends with the page.
struct Writing(JoinHandle<()>);

impl Drop for Writing {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Hands what comes to the page's state, which decides what is sent, until there is a reason to end.
async fn talk(page: &mut Page, mut stream: SplitStream<WebSocket>) -> Ending {
    let mut status = tokio::time::interval(STATUS_EVERY);
    let (mut pings, mut its_pings) = (tokio::time::interval(PING_EVERY), Pings::default());
    page.begin();
    loop {
        let (state_due, frame_due) = (page.state_due(), page.frame_due());
        let ending = tokio::select! {
            message = stream.next() => match message {
                Some(Ok(Message::Text(text))) => page.read(&text),
                Some(Ok(Message::Pong(number))) => page.pong(&number),
                // It is answered already.
                Some(Ok(Message::Ping(_))) => its_pings.note(Instant::now()).map(Ending::Bye),
                Some(Ok(Message::Binary(_))) => Some(Ending::Bye("a binary message, expected texts".into())),
                Some(Ok(Message::Close(_))) | None => Some(Ending::Disconnected),
                Some(Err(error)) => Some(Ending::Bye(format!("no message: {error}"))),
            },
            ending = page.changed() => ending,
            () = sleep_until(state_due) => page.send_state(),
            // Asked for below.
            () = sleep_until(frame_due) => None,
            _ = status.tick() => page.look_at_link(),
            _ = pings.tick() => page.ping(),
        };
        if let Some(ending) = ending {
            return ending;
        }
        page.pull_frame();
    }
}

async fn sleep_until(due: Option<Instant>) {
    match due {
        Some(due) => tokio::time::sleep_until(due.into()).await,
        None => std::future::pending().await,
    }
}

/// Sends what the outbox holds, until the peer is gone or the last message is sent.
async fn write(mut sink: SplitSink<WebSocket, Message>, outbox: Arc<Outbox>) {
    loop {
        let sent = match outbox.next().await {
            Item::Text(text) => sink.send(Message::text(text)).await,
            Item::Binary(bytes) => send_world(&mut sink, &outbox, bytes).await,
            Item::Frame(messages) => send_frame(&mut sink, &outbox, messages).await,
            Item::Ping => send_ping(&mut sink, outbox.begin_ping(false), &outbox).await,
            Item::Bye(why) => {
                // The peer may have gone already.
                let _ = sink.send(Message::text(text::bye(&why))).await;
                let _ = sink.send(Message::Close(Some(close_frame(&why)))).await;
                return;
            }
        };
        if sent.is_err() {
            return;
        }
    }
}

type Sink = SplitSink<WebSocket, Message>;

async fn send_frame(
    sink: &mut Sink,
    outbox: &Outbox,
    messages: Vec<bytes::Bytes>,
) -> Result<(), axum::Error> {
    let ping = outbox.begin_ping(true);
    for message in messages {
        sink.send(Message::Binary(message)).await?;
    }
    send_ping(sink, ping, outbox).await
}

async fn send_world(sink: &mut Sink, outbox: &Outbox, world: bytes::Bytes) -> Result<(), axum::Error> {
    let ping = outbox.begin_ping_alone();
    sink.send(Message::Binary(world)).await?;
    match ping {
        Some(ping) => send_ping(sink, ping, outbox).await,
        None => Ok(()),
    }
}

async fn send_ping(sink: &mut Sink, number: u32, outbox: &Outbox) -> Result<(), axum::Error> {
    sink.send(Message::Ping(number.to_le_bytes().to_vec().into())).await?;
    outbox.ping_handed(number);
    Ok(())
}

fn close_frame(why: &str) -> CloseFrame {
    let most = (0..=MAX_REASON_BYTES).rev().find(|&most| why.is_char_boundary(most.min(why.len())));
    let reason = why.get(..most.unwrap_or_default().min(why.len())).unwrap_or_default();
    CloseFrame { code: close_code::POLICY, reason: reason.into() }
}
