//! The world as JSON over a WebSocket, for programs: a text message a tick, commands the other way.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use coordinator::live::{BodyId, Command, SceneState, WorldState};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::watch;

use super::ticks::{DEFAULT_RATE_HZ, MAX_PROGRAMS, Ticks};
use crate::shared::{Seat, Shared};
use crate::{commands, text};

/// The longest message a program may send, bytes: a convex hull of 256 points fits.
const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// A program whose socket takes nothing for so long is dropped.
const PATIENCE: Duration = Duration::from_secs(5);

/// What stands in the address.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    rate: Option<f64>,
    token: Option<String>,
}

pub(crate) fn routes() -> Router<Arc<Shared>> {
    Router::new().route("/state", get(open))
}

async fn open(
    State(shared): State<Arc<Shared>>,
    Query(asked): Query<Asked>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Some(seat) = Seat::take(&shared.programs, MAX_PROGRAMS) else {
        let why = format!("{MAX_PROGRAMS} programs follow already, expected fewer\n");
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    let ticks = match Ticks::new(&shared.follower, asked.rate.unwrap_or(DEFAULT_RATE_HZ)) {
        Ok(ticks) => ticks,
        Err(why) => return (StatusCode::BAD_REQUEST, why + "\n").into_response(),
    };
    let may_steer = shared.access.may_steer(asked.token.as_deref());
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    upgrade.on_upgrade(move |socket| async move {
        let program = Program { shared, may_steer, generation: 0, held: BTreeSet::new() };
        program.serve(socket, ticks).await;
        drop(seat);
    })
}

/// One program that is connected.
struct Program {
    shared: Arc<Shared>,
    may_steer: bool,
    /// The world's, when it was last seen.
    generation: u32,
    /// Bodies of that world that it holds: let go when it goes.
    held: BTreeSet<BodyId>,
}

impl Program {
    async fn serve(mut self, mut socket: WebSocket, mut ticks: Ticks) {
        let mut ending = self.shared.ending.clone();
        loop {
            let text = tokio::select! {
                world = ticks.next() => match world {
                    Some(world) => {
                        if world.generation != self.generation {
                            self.held.clear();
                            self.generation = world.generation;
                        }
                        state(&world, self.shared.follower.scene.borrow().as_deref())
                    }
                    None => break,
                },
                heard = socket.recv() => match heard {
                    Some(Ok(Message::Text(text))) => self.answer(&text).await,
                    Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                    Some(Ok(_)) => continue,
                },
                () = ended(&mut ending) => break,
            };
            let sent = tokio::time::timeout(PATIENCE, socket.send(Message::Text(text.into()))).await;
            if !matches!(sent, Ok(Ok(()))) {
                break;
            }
        }
        for body in std::mem::take(&mut self.held) {
            // It may be gone, or the run over: then nothing is held.
            let _ = self.shared.follower.order(Command::Release { body, velocity_m_s: None }).await;
        }
    }

    /// Does what a message asks, and says what came of it.
    async fn answer(&mut self, text: &str) -> String {
        let request = match serde_json::from_str(text) {
            Ok(Value::Object(message)) => commands::parse(&message),
            Ok(other) => Err(format!("message is {other}, expected an object")),
            Err(error) => Err(format!("message is no JSON: {error}")),
        };
        let commands::Request { id, command } = match request {
            Ok(request) => request,
            Err(why) => return json!({"op": "refused", "why": why}).to_string(),
        };
        let command = match command {
            Ok(command) if self.may_steer => command,
            Ok(_) => return text::refused(id, "a viewer cannot steer: add ?token= to the address"),
            Err(why) => return text::refused(id, &why),
        };
        let held = match command {
            Command::Grab { body, .. } => Some((body, true)),
            Command::Release { body, .. } | Command::Remove(body) => Some((body, false)),
            _ => None,
        };
        match self.shared.follower.order(command).await {
            Ok(done) => {
                match held {
                    Some((body, true)) => drop(self.held.insert(body)),
                    Some((body, false)) => drop(self.held.remove(&body)),
                    None => {}
                }
                text::done(id, done)
            }
            Err(why) => text::refused(id, &why.to_string()),
        }
    }
}

async fn ended(ending: &mut watch::Receiver<bool>) {
    // An end whose sender is gone is an end.
    let _ = ending.wait_for(|ended| *ended).await;
}

/// The world as a message. A body that came this very moment may have no name yet.
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
