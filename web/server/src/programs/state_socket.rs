//! The world as JSON over a WebSocket: a text message a tick, commands the other way.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use coordinator::live::{BodyId, Client, ClientKind, SceneState, WorldState};
use serde::Deserialize;
use serde_json::json;
use tokio::time::timeout;

use super::ticks::{DEFAULT_RATE_HZ, Ticks};
use crate::fields::InputError;
use crate::http::Connection;
use crate::orders::Orders;
use crate::pings::Pings;
use crate::shared::{Seats, Shared};
use crate::{commands, fields, text};

/// The longest message of a program, bytes: a convex hull of 256 points fits.
const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// A program whose socket takes nothing for so long is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);

/// The query of the address.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SocketQuery {
    rate: Option<f64>,
    token: Option<String>,
}

pub(crate) fn routes() -> Router<Arc<Shared>> {
    Router::new().route("/state", get(open))
}

async fn open(
    State(shared): State<Arc<Shared>>,
    Query(query): Query<SocketQuery>,
    Extension(connection): Extension<Connection>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let may_steer = shared.may_steer(&connection, query.token.as_deref()).await;
    let Some(seat) = shared.programs.take(may_steer) else {
        let why = format!("{} programs follow already, expected fewer\n", Seats::open_to(may_steer));
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    let ticks = match Ticks::new(&shared.follower, query.rate.unwrap_or(DEFAULT_RATE_HZ)) {
        Ok(ticks) => ticks,
        Err(why) => return (StatusCode::BAD_REQUEST, format!("{why}\n")).into_response(),
    };
    let staying = connection.stay();
    let refusal = (!may_steer).then_some("add ?token= to the address");
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    upgrade.on_upgrade(async move |socket| {
        let follower = shared.follower.for_client(Client::new(ClientKind::Program));
        let mut orders = Orders::new(follower, refusal);
        serve(socket, &shared, ticks, &mut orders).await;
        orders.end();
        drop((seat, staying));
    })
}

/// Sends states and answers until either side ends the connection.
async fn serve(mut socket: WebSocket, shared: &Shared, mut ticks: Ticks, orders: &mut Orders) {
    let mut ending = shared.ending.clone();
    let (mut pings, mut dropped) = (Pings::default(), None);
    loop {
        let text = tokio::select! {
            world = ticks.next() => {
                let Some(world) = world else { return };
                state(&world, shared.follower.scene.borrow().as_deref())
            }
            answer = orders.answered() => answer,
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => match order(&text, orders) {
                    Some(refusal) => refusal,
                    None => continue,
                },
                Some(Ok(Message::Binary(bytes))) => {
                    text::refused(None, &InputError::Binary { bytes: bytes.len() }.to_string())
                }
                // The socket answers it itself.
                Some(Ok(Message::Ping(_))) => match pings.note(Instant::now()) {
                    Some(why) => {
                        dropped = Some("too many pings");
                        text::refused(None, &why)
                    }
                    None => continue,
                },
                Some(Ok(Message::Pong(_))) => continue,
                Some(Ok(Message::Close(_))) | None => return,
                Some(Err(error)) => {
                    dropped = Some("no message that can be read");
                    text::refused(None, &unreadable(&error))
                }
            },
            // An end whose sender is gone is an end.
            _ = ending.wait_for(|ended| *ended) => return,
        };
        if !matches!(timeout(WRITE_TIMEOUT, socket.send(Message::Text(text.into()))).await, Ok(Ok(()))) {
            return;
        }
        if let Some(why) = dropped {
            let close = Message::Close(Some(CloseFrame { code: close_code::POLICY, reason: why.into() }));
            // The peer may be gone.
            let _ = timeout(WRITE_TIMEOUT, socket.send(close)).await;
            return;
        }
    }
}

/// Why a socket is closed: what came is no WebSocket message, no UTF-8 or too long.
fn unreadable(error: &axum::Error) -> String {
    format!("no message: {error}; expected UTF-8 text of at most {MAX_MESSAGE_BYTES} bytes")
}

/// Passes the command of a message on; returns the answer if it is refused at once.
fn order(text: &str, orders: &mut Orders) -> Option<String> {
    let request = fields::object(text).and_then(|message| match message.get("op") {
        Some(op) if op != "command" => Err(fields::wrong("op", op, "\"command\"")),
        _ => commands::parse(&message),
    });
    match request {
        Ok(request) => orders.order(request),
        Err(why) => Some(text::refused(None, &why.to_string())),
    }
}

/// The world as a message. A body that was spawned just now may have no name yet.
fn state(world: &WorldState, scene: Option<&SceneState>) -> String {
    let looks = scene.filter(|scene| scene.generation == world.generation).map(|scene| &scene.bodies[..]);
    let name = |id: BodyId| looks?.iter().find(|look| look.id == id).map(|look| &look.name[..]);
    let bodies = world.bodies.iter().map(|body| {
        json!({
            "id": body.id,
            "name": name(body.id),
            "position_m": body.pose.position_m(),
            "rotation_xyzw": body.pose.rotation_xyzw(),
            "velocity_m_s": body.velocity_m_s,
            "spin_rad_s": body.spin_rad_s,
            "inside_samples": body.inside_samples,
            "response_m": body.response_m,
            "grabbed": body.grabbed,
            "asleep": body.asleep,
        })
    });
    json!({
        "op": "state",
        "generation": world.generation,
        "step": world.step,
        "time_s": world.film_s,
        "frame": world.frame,
        "paused": world.paused,
        "blind": world.frame.is_none(),
        "bodies": bodies.collect::<Vec<_>>(),
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::ticks::tests::world;
    use serde_json::Value;

    #[test]
    fn a_state_is_an_object_with_every_body() {
        let state: Value = serde_json::from_str(&state(&world(12), None)).expect("JSON");
        assert_eq!(
            (&state["op"], &state["step"], &state["time_s"]),
            (&json!("state"), &json!(12), &json!(0.1))
        );
        assert_eq!((&state["frame"], &state["blind"]), (&json!(3), &json!(false)));
        let body = &state["bodies"][0];
        assert_eq!((&body["id"], &body["name"]), (&json!(7), &Value::Null));
        assert_eq!(body["position_m"], json!([1.0, 2.0, 3.0]));
        assert_eq!(body["response_m"], json!([0.25, 0.0, 0.0]));
    }
}
