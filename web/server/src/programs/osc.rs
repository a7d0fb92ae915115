//! The world as Open Sound Control over UDP, for the tools of installations: a bundle a tick to one address.
//!
//! Arguments have the types of OSC 1.0 alone (`i f s b`): receivers discard messages with others.
//!
//! Each bundle begins with `/hulltouch/world` and `/hulltouch/world/exact`, and holds whole bodies; a world of many bodies takes several
//! bundles a tick, so that none is larger than networks carry in a piece or two. Bundles that cannot be sent are
//! counted and logged.

use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use coordinator::live::{BodyState, Follower, SceneState, WorldState};
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType};
use thiserror::Error;

/// Ticks a second.
const RATE_HZ: f64 = 60.0;
/// No bundle is larger, bytes: many receivers read into 8 KiB.
pub(crate) const MAX_BUNDLE_BYTES: usize = 8000;
/// Bundles that could not be sent are logged this often.
const LOG_EVERY: Duration = Duration::from_secs(10);
/// "At once": bundles are for now, and clocks of machines differ.
const IMMEDIATELY: OscTime = OscTime { seconds: 0, fractional: 1 };

/// Why nothing can be sent.
#[derive(Debug, Error)]
#[error("cannot send to {to}: {error}")]
pub struct OscError {
    to: SocketAddr,
    error: std::io::Error,
}

/// Sends until it is dropped, or the run ends, on a thread of its own.
#[derive(Debug)]
pub struct Osc {
    end: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Osc {
    /// Begins to send a run's world to an address.
    pub fn start(to: SocketAddr, follower: Follower) -> Result<Osc, OscError> {
        let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let failed = |error| OscError { to, error };
        let socket = UdpSocket::bind(any).map_err(failed)?;
        socket.connect(to).map_err(failed)?;
        let (end, ended) = sync_channel(0);
        let thread = std::thread::Builder::new().name("osc".into()).spawn(move || {
            let mut unsent = Unsent { to, count: 0, logged: None };
            let _watching = follower.watch();
            let mut due = Instant::now();
            loop {
                due = (due + Duration::from_secs_f64(1.0 / RATE_HZ)).max(Instant::now());
                let waited = ended.recv_timeout(due.saturating_duration_since(Instant::now()));
                let is_over =
                    waited != Err(RecvTimeoutError::Timeout) || follower.world.has_changed().is_err();
                if is_over {
                    return unsent.log();
                }
                let (world, scene) = (follower.world.borrow().clone(), follower.scene.borrow().clone());
                let Some(world) = world else { continue };
                for bundle in bundles(&world, scene.as_deref()) {
                    if let Err(why) = socket.send(&bundle) {
                        unsent.add(&why);
                    }
                }
            }
        });
        Ok(Osc { end: Some(end), thread: Some(thread.map_err(failed)?) })
    }
}

impl Drop for Osc {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            // A panic of the thread is on standard error already.
            let _ = thread.join();
        }
    }
}

/// Bundles that could not be sent.
struct Unsent {
    to: SocketAddr,
    count: u64,
    logged: Option<Instant>,
}

impl Unsent {
    fn add(&mut self, why: &std::io::Error) {
        self.count += 1;
        if self.logged.is_none_or(|logged| logged.elapsed() > LOG_EVERY) {
            self.logged = Some(Instant::now());
            tracing::warn!("OSC to {}: {} bundles not sent so far: {why}", self.to, self.count);
        }
    }

    fn log(&self) {
        if self.count > 0 {
            tracing::warn!("OSC to {}: {} bundles were not sent", self.to, self.count);
        }
    }
}

/// A tick's bundles, encoded.
pub(crate) fn bundles(world: &WorldState, scene: Option<&SceneState>) -> Vec<Vec<u8>> {
    let looks = scene.filter(|scene| scene.generation == world.generation).map(|scene| &scene.bodies[..]);
    let mut bundles = vec![];
    let mut messages = world_messages(world);
    let mut bytes = size(&messages);
    for body in &world.bodies {
        let look = looks.and_then(|looks| looks.iter().find(|look| look.id == body.id));
        let name = look.map_or_else(|| body.id.to_string(), |look| address_part(&look.name));
        let of_body = body_messages(body, &name);
        let more = size(&of_body);
        if bytes + more > MAX_BUNDLE_BYTES {
            bundles.push(std::mem::replace(&mut messages, world_messages(world)));
            bytes = size(&messages);
        }
        messages.extend(of_body);
        bytes += more;
    }
    bundles.push(messages);
    bundles.into_iter().filter_map(|content| rosc::encoder::encode(&bundle(content)).ok()).collect()
}

fn bundle(content: Vec<OscPacket>) -> OscPacket {
    OscPacket::Bundle(OscBundle { timetag: IMMEDIATELY, content })
}

/// Bytes that messages take in a bundle, with its head.
fn size(messages: &[OscPacket]) -> usize {
    const HEAD: usize = 16;
    let size = |packet: &OscPacket| rosc::encoder::encode(packet).map_or(0, |bytes| bytes.len() + 4);
    HEAD + messages.iter().map(size).sum::<usize>()
}

fn message(address: String, args: Vec<OscType>) -> OscPacket {
    OscPacket::Message(OscMessage { addr: address, args })
}

/// An integer as OSC 1.0 has it; one that is too large is the largest.
fn int(number: u64) -> OscType {
    OscType::Int(i32::try_from(number).unwrap_or(i32::MAX))
}

/// The world in numbers that may be rounded, and as decimal texts those that may not.
fn world_messages(world: &WorldState) -> Vec<OscPacket> {
    let rounded = vec![
        int(world.generation.into()),
        int(world.step),
        OscType::Float(world.film_s as f32),
        OscType::Int(world.paused.into()),
        int(world.bodies.len() as u64),
    ];
    let exact = vec![OscType::String(world.step.to_string()), OscType::String(world.film_s.to_string())];
    vec![message("/hulltouch/world".into(), rounded), message("/hulltouch/world/exact".into(), exact)]
}

fn body_messages(body: &BodyState, name: &str) -> Vec<OscPacket> {
    let floats = |numbers: &[f64]| numbers.iter().map(|&number| OscType::Float(number as f32)).collect();
    let pose = [&body.pose.position_m()[..], &body.pose.rotation_xyzw()].concat();
    let mut messages = vec![
        message(format!("/hulltouch/body/{name}/pose"), floats(&pose)),
        message(format!("/hulltouch/body/{name}/velocity"), floats(&body.velocity_m_s)),
    ];
    if body.inside_samples > 0 {
        let mut args: Vec<OscType> = floats(&body.response_m.unwrap_or_default());
        args.insert(0, int(body.inside_samples.into()));
        messages.push(message(format!("/hulltouch/body/{name}/touch"), args));
    }
    messages
}

/// A name as a part of an address: what addresses keep for themselves becomes `_`.
fn address_part(name: &str) -> String {
    let kept = |character: char| character.is_ascii_graphic() && !"#*,/?[]{}".contains(character);
    name.chars().map(|character| if kept(character) { character } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::ticks::tests::world;
    use coordinator::live::live;

    fn messages(bytes: &[u8]) -> Vec<OscMessage> {
        let (rest, packet) = rosc::decoder::decode_udp(bytes).expect("OSC");
        assert!(rest.is_empty());
        let OscPacket::Bundle(bundle) = packet else { panic!("a bundle") };
        assert_eq!(bundle.timetag, IMMEDIATELY);
        let message = |packet| match packet {
            OscPacket::Message(message) => message,
            OscPacket::Bundle(_) => panic!("no bundle in a bundle"),
        };
        bundle.content.into_iter().map(message).collect()
    }

    #[test]
    fn many_bodies_take_several_bundles_and_none_is_lost_or_cut() {
        let mut many = (*world(5)).clone();
        many.bodies = (0..1000).map(|id| BodyState { id, ..many.bodies[0] }).collect();
        let bundles = bundles(&many, None);
        assert!(bundles.len() > 10 && bundles.iter().all(|bundle| bundle.len() <= MAX_BUNDLE_BYTES));
        let all: Vec<Vec<OscMessage>> = bundles.iter().map(|bundle| messages(bundle)).collect();
        assert!(all.iter().all(|messages| messages[0].addr == "/hulltouch/world"));
        let bodies: Vec<&OscMessage> = all.iter().flat_map(|messages| &messages[2..]).collect();
        assert_eq!(bodies.len(), 3000, "pose, velocity and touch of each");
        assert_eq!(bodies[2999].addr, "/hulltouch/body/999/touch");
    }

    #[test]
    fn receivers_of_osc_1_0_can_read_every_argument_and_nothing_is_lost() {
        let mut old = (*world(5)).clone();
        old.step = (1 << 31) + 1;
        old.film_s = 17_895_697.075_000_003;
        old.bodies.push(BodyState { inside_samples: u32::MAX, id: 8, ..old.bodies[0] });
        for bundle in bundles(&old, None) {
            let messages = messages(&bundle);
            let all = messages.iter().flat_map(|message| &message.args);
            let is_known = |argument: &OscType| {
                matches!(
                    argument,
                    OscType::Int(_) | OscType::Float(_) | OscType::String(_) | OscType::Blob(_)
                )
            };
            assert!(all.clone().all(is_known), "{messages:?}");
            assert_eq!(messages[0].args[1], OscType::Int(i32::MAX), "the largest, and not a negative number");
            let exact = ["2147483649", "17895697.075000003"].map(|text| OscType::String(text.into()));
            assert_eq!(messages[1].args, exact);
            assert!(all.clone().all(|argument| !matches!(argument, OscType::Int(..0))), "{messages:?}");
        }
    }

    #[test]
    fn names_are_parts_of_addresses() {
        assert_eq!(address_part("box_1"), "box_1");
        assert_eq!(address_part("my box/№*2"), "my_box___2");
    }

    #[test]
    fn bundles_come_over_udp_and_say_what_the_world_is() {
        let receiver = UdpSocket::bind("127.0.0.1:0").expect("a port");
        receiver.set_read_timeout(Some(Duration::from_secs(100))).expect("set");
        let (live, follower) = live();
        live.world.send_replace(Some(world(240)));
        let osc = Osc::start(receiver.local_addr().expect("bound"), follower).expect("sends");
        let mut buffer = [0; 9000];
        let length = receiver.recv(&mut buffer).expect("a bundle");
        let found = messages(&buffer[..length]);
        use OscType::{Float, Int, String};
        assert_eq!(found[0].addr, "/hulltouch/world");
        assert_eq!(found[0].args, [Int(2), Int(240), Float(2.0), Int(0), Int(1)]);
        assert_eq!(found[1].addr, "/hulltouch/world/exact");
        assert_eq!(found[1].args, ["240", "2"].map(|text| String(text.into())));
        assert_eq!(found[2].addr, "/hulltouch/body/7/pose");
        assert_eq!(found[2].args, [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0].map(Float));
        assert_eq!(found[3].args, [0.0, -1.0, 0.0].map(Float));
        assert_eq!(found[4].args, [Int(3), Float(0.25), Float(0.0), Float(0.0)]);
        drop(osc);
    }
}
