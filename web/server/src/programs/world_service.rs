//! The gRPC service `World`.

use std::pin::Pin;
use std::sync::Arc;

use coordinator::live::{BodyLook, BodyState, Command, Outcome, Parameters, SceneState, WorldState};
use prost::Message;
use proto::text::{MAX_MESSAGE_CHARS, clean};
use proto::v1;
use proto::v1::world_server::{World, WorldServer};
use sim::Scene;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::service::Routes;
use tonic::{Code, Request, Response, Status};
use world_encodings::{service, shape};

use super::ticks::{DEFAULT_RATE_HZ, Ticks};
use crate::fields::InputError;
use crate::http::{Connection, bearer_token};
use crate::message::MAX_TOUCHES;
use crate::shared::{Seats, Shared};

/// States that wait for a slow caller; beyond, ticks are left out.
const MAX_WAITING: usize = 2;
/// The longest message, bytes: a convex hull of 256 points fits.
const MAX_MESSAGE_BYTES: usize = 64 << 10;

/// The service with health and reflection, to be merged into the server's routes.
pub(crate) async fn routes(shared: &Arc<Shared>) -> axum::Router {
    let (reporter, health) = tonic_health::server::health_reporter();
    reporter.set_serving::<WorldServer<Service>>().await;
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(v1::DESCRIPTORS)
            .with_service_name("hulltouch.v1.World")
    };
    let describe_error = "the protocol's own description is valid";
    let world = WorldServer::new(Service(Arc::clone(shared))).max_decoding_message_size(MAX_MESSAGE_BYTES);
    Routes::new(world)
        .add_service(health)
        .add_service(reflection().build_v1().expect(describe_error))
        .add_service(reflection().build_v1alpha().expect(describe_error))
        .prepare()
        .into_axum_router()
        // Other paths are the page's.
        .reset_fallback()
}

/// The state behind every call.
pub(crate) struct Service(Arc<Shared>);

impl Service {
    fn may_steer<T>(&self, request: &Request<T>) -> impl Future<Output = bool> + Send + use<T> {
        let authorization = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
        let token = authorization.map(|value| bearer_token(value).unwrap_or_default().to_owned());
        // Every request of the page's port comes with its connection.
        let connection = request.extensions().get::<Connection>().cloned();
        let shared = Arc::clone(&self.0);
        async move {
            match connection {
                Some(connection) => shared.may_steer(&connection, token.as_deref()).await,
                None => false,
            }
        }
    }

    /// Passes a command on to the run, if the caller has the token.
    async fn order<T>(
        &self,
        request: Request<T>,
        command: impl FnOnce(T) -> Result<Command, InputError>,
    ) -> Result<Outcome, Status> {
        if !self.may_steer(&request).await {
            return Err(Status::permission_denied(
                "a viewer cannot steer: send metadata \"authorization: Bearer TOKEN\"",
            ));
        }
        // Every request of the page's port comes with its connection.
        let client = request.extensions().get::<Connection>().map(|connection| connection.client().clone());
        let command = command(request.into_inner()).map_err(invalid)?;
        let shared = &self.0.follower;
        let follower = client.map_or_else(|| shared.clone(), |client| shared.for_client(client));
        follower.order(command).await.map_err(|why| {
            let is_over = follower.world.has_changed().is_err();
            status(if is_over { Code::Unavailable } else { Code::FailedPrecondition }, why)
        })
    }

    async fn apply<T>(
        &self,
        request: Request<T>,
        command: impl FnOnce(T) -> Result<Command, InputError>,
    ) -> Result<Response<v1::Done>, Status> {
        self.order(request, command).await.map(|_| Response::new(v1::Done {}))
    }
}

type WorldStates = Pin<Box<dyn Stream<Item = Result<v1::WorldState, Status>> + Send>>;

#[tonic::async_trait]
impl World for Service {
    async fn describe(
        &self,
        request: Request<v1::DescribeWorldRequest>,
    ) -> Result<Response<v1::WorldDescription>, Status> {
        let scene = self.0.follower.scene.borrow().clone();
        let scene = scene.ok_or_else(|| Status::unavailable("the run has not begun"))?;
        let info = &self.0.info;
        Ok(Response::new(v1::WorldDescription {
            scenes: Scene::names().map(Into::into).collect(),
            frames_per_s: info.fps,
            step_s: info.step_s,
            may_steer: self.may_steer(&request).await,
            ..description(&scene)
        }))
    }

    type FollowStream = WorldStates;

    async fn follow(&self, request: Request<v1::FollowRequest>) -> Result<Response<WorldStates>, Status> {
        let has_token = self.may_steer(&request).await;
        let staying = request.extensions().get::<Connection>().map(Connection::stay);
        let v1::FollowRequest { rate_hz, touches } = request.into_inner();
        let rate_hz = if rate_hz == 0.0 { DEFAULT_RATE_HZ } else { rate_hz };
        let mut ticks = Ticks::new(&self.0.follower, rate_hz).map_err(invalid)?;
        let seat = self.0.programs.take(has_token).ok_or_else(|| {
            let most = Seats::open_to(has_token);
            Status::resource_exhausted(format!("{most} programs follow already, expected fewer"))
        })?;
        let (sender, receiver) = mpsc::channel(MAX_WAITING);
        let mut ending = self.0.ending.clone();
        tokio::spawn(async move {
            let follow = async {
                while let Some(world) = ticks.next().await {
                    // A caller that reads slowly misses this one.
                    if let Err(mpsc::error::TrySendError::Closed(_)) =
                        sender.try_send(Ok(state(&world, touches)))
                    {
                        return;
                    }
                }
            };
            tokio::select! {
                () = follow => {}
                () = sender.closed() => {}
                // An end whose sender is gone is an end.
                _ = ending.wait_for(|ended| *ended) => {}
            }
            drop((seat, staying));
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn spawn(&self, request: Request<v1::SpawnRequest>) -> Result<Response<v1::SpawnReply>, Status> {
        match self.order(request, spawn).await? {
            Outcome::Spawned(body) => Ok(Response::new(v1::SpawnReply { body })),
            Outcome::Applied | Outcome::Revocable(_) => Err(Status::internal("the run spawned nothing")),
        }
    }

    async fn remove(&self, request: Request<v1::RemoveRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |v1::RemoveRequest { body }| Ok(Command::Remove(body))).await
    }

    async fn push(&self, request: Request<v1::PushRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, push).await
    }

    async fn grab(&self, request: Request<v1::GrabRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, grab).await
    }

    async fn release(&self, request: Request<v1::ReleaseRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, release).await
    }

    async fn set_parameters(&self, request: Request<v1::Parameters>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, set).await
    }

    async fn pause(&self, request: Request<v1::PauseRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |_| Ok(Command::Pause)).await
    }

    async fn resume(&self, request: Request<v1::ResumeRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |_| Ok(Command::Resume)).await
    }

    async fn step(&self, request: Request<v1::StepRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |v1::StepRequest { steps }| Ok(Command::Step(steps.max(1)))).await
    }

    async fn reset(&self, request: Request<v1::ResetRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |_| Ok(Command::Reset)).await
    }

    async fn choose(&self, request: Request<v1::ChooseRequest>) -> Result<Response<v1::Done>, Status> {
        self.apply(request, |v1::ChooseRequest { scene }| Ok(Command::Choose(Scene::named(&scene)?))).await
    }

    async fn take_background(
        &self,
        request: Request<v1::TakeWorldBackgroundRequest>,
    ) -> Result<Response<v1::Done>, Status> {
        let command = |v1::TakeWorldBackgroundRequest { seconds, allow_foreground }| {
            Ok(Command::TakeBackground { seconds, allow_foreground })
        };
        self.apply(request, command).await
    }
}

fn status(code: Code, why: impl std::fmt::Display) -> Status {
    Status::new(code, clean(&why.to_string(), MAX_MESSAGE_CHARS))
}

fn invalid(why: impl std::fmt::Display) -> Status {
    status(Code::InvalidArgument, why)
}

/// The command of a call that takes numbers, by its place among these; `None` if the message is none of that call.
pub(crate) fn command_of_call(call: u8, message: &[u8]) -> Option<Result<Command, InputError>> {
    fn read<M: Message + Default>(
        message: &[u8],
        command: impl FnOnce(M) -> Result<Command, InputError>,
    ) -> Option<Result<Command, InputError>> {
        M::decode(message).ok().map(command)
    }
    match call % 5 {
        0 => read(message, spawn),
        1 => read(message, push),
        2 => read(message, grab),
        3 => read(message, release),
        _ => read(message, set),
    }
}

fn push(v1::PushRequest { body, impulse, at }: v1::PushRequest) -> Result<Command, InputError> {
    let impulse_n_s = service::needed("impulse", impulse)?;
    Ok(Command::Push { body, impulse_n_s, at_m: at.map(service::numbers) })
}

fn grab(v1::GrabRequest { body, grip, target }: v1::GrabRequest) -> Result<Command, InputError> {
    let grip_body_m = grip.map(service::numbers).unwrap_or_default();
    Ok(Command::Grab { body, grip_body_m, target_m: service::needed("target", target)? })
}

fn release(v1::ReleaseRequest { body, velocity }: v1::ReleaseRequest) -> Result<Command, InputError> {
    Ok(Command::Release { body, velocity_m_s: velocity.map(service::numbers) })
}

fn set(parameters: v1::Parameters) -> Result<Command, InputError> {
    let set = service::parameters_from_message(parameters);
    if set == Parameters::default() {
        return Err(InputError::NothingToSet);
    }
    Ok(Command::Set(set))
}

/// A body to spawn, with the checks of a scene's bodies.
fn spawn(request: v1::SpawnRequest) -> Result<Command, InputError> {
    let body = service::body_request(request)?;
    let spec = body.check().map_err(|error| InputError::Body { of: "", error })?;
    Ok(Command::Spawn(Box::new(spec)))
}

fn description(scene: &SceneState) -> v1::WorldDescription {
    let body = |look: &BodyLook| v1::BodyDescription {
        id: look.id,
        name: look.name.clone(),
        shape: Some(shape::to_service(&look.solid)),
        color: Some(service::color(look.color)),
        fixed: look.fixed,
    };
    v1::WorldDescription {
        generation: scene.generation,
        version: scene.version,
        scene: scene.scene.clone(),
        bodies: scene.bodies.iter().map(body).collect(),
        parameters: Some(service::parameters(&scene.parameters)),
        up: Some(service::vector(scene.up)),
        floor_m: scene.floor_m,
        ..v1::WorldDescription::default()
    }
}

fn state(world: &WorldState, with_touches: bool) -> v1::WorldState {
    let touches = if with_touches { &world.touches[..] } else { &[] };
    let touch = |touch: &coordinator::live::TouchPoint| {
        Some(v1::Touch {
            body: world.bodies.get(touch.body as usize)?.id,
            point: Some(service::vector(touch.point_m.map(f64::from))),
            response: Some(service::vector(touch.response_m.map(f64::from))),
        })
    };
    v1::WorldState {
        generation: world.generation,
        step: world.step,
        film_s: world.film_s,
        frame: world.frame,
        paused: world.paused,
        bodies: world.bodies.iter().map(body_state).collect(),
        touches: touches.iter().take(MAX_TOUCHES).filter_map(touch).collect(),
    }
}

fn body_state(body: &BodyState) -> v1::BodyState {
    v1::BodyState {
        id: body.id,
        position: Some(service::vector(body.pose.position_m())),
        rotation: Some(service::quaternion(body.pose.rotation_xyzw())),
        velocity: Some(service::vector(body.velocity_m_s)),
        spin: Some(service::vector(body.spin_rad_s)),
        inside_samples: body.inside_samples,
        response: body.response_m.map(service::vector),
        grabbed: body.grabbed,
        asleep: body.asleep,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use sim::Solid;

    use super::*;

    /// One of each call that [`command_of_call`] reads.
    pub fn calls() -> Vec<Vec<u8>> {
        let at = Some(service::vector([0.0, 1.5, 0.25]));
        let spawn = |solid: &Solid| v1::SpawnRequest {
            name: "can".into(),
            shape: Some(shape::to_service(solid)),
            position: at,
            mass: Some(2.0),
            color: Some(v1::Color { red: 1.0, green: 0.5, blue: 0.0 }),
            ..v1::SpawnRequest::default()
        };
        let gravity = Some(service::vector([0.0; 3]));
        let messages = [
            (0, spawn(&Solid::Box { size_m: [0.1, 0.2, 0.3] }).encode_to_vec()),
            (0, spawn(&Solid::Cone { radius_m: 0.1, height_m: 0.2 }).encode_to_vec()),
            (1, v1::PushRequest { body: 0, impulse: at, at }.encode_to_vec()),
            (2, v1::GrabRequest { body: 0, grip: None, target: at }.encode_to_vec()),
            (3, v1::ReleaseRequest { body: 0, velocity: at }.encode_to_vec()),
            (
                4,
                v1::Parameters { gravity, hull_friction: Some(0.5), ..v1::Parameters::default() }
                    .encode_to_vec(),
            ),
        ];
        messages.into_iter().map(|(call, message)| [&[call][..], &message].concat()).collect()
    }

    #[test]
    fn a_spawn_without_shape_or_position_is_refused_by_field() {
        let error = |request| spawn(request).expect_err("refused").to_string();
        assert!(error(v1::SpawnRequest::default()).starts_with("shape is missing"));
        let ball = v1::body_shape::Kind::Ball(v1::body_shape::Ball { radius: 0.1 });
        let shape = Some(v1::BodyShape { kind: Some(ball) });
        let request = v1::SpawnRequest { shape, ..v1::SpawnRequest::default() };
        assert_eq!(error(request.clone()), "position is missing, expected a vector");
        let request =
            v1::SpawnRequest { position: Some(service::vector([0.0; 3])), mass: Some(-1.0), ..request };
        assert_eq!(error(request), "mass: -1, expected a number from 0.001 to 10000");
    }
}
