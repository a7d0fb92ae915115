//! The page of a whole run, as a browser would use it: hull, colours and bodies over real processes.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use camera_node::capture::{Film, Filming as _};
use camera_node::frames::FrameRing;
use camera_node::pictures::{ColourRing, PictureEncoder};
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use film_time::{Pace, RunStart};
use futures::{SinkExt as _, StreamExt as _};
use hull::ProbeSettings;
use proto::convert::{SilhouetteEncoding, silhouette_from_data};
use proto::{CameraPicture, Picture, PictureKind, PictureRequest};
use segment::SegmentSettings;
use serde_json::{Value, json};
use testkit::Running;
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

const TIMEOUT: Duration = Duration::from_secs(300);

const TOKEN: &str = "a-token-for-tests";

/// A demo, and its socket's address.
struct Demo {
    running: Running,
    socket: String,
    errors: BufReader<std::process::ChildStderr>,
}

impl Demo {
    fn start(more: &[&str]) -> Demo {
        Demo::run(&mut Demo::command(more))
    }

    fn command(more: &[&str]) -> Command {
        let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
        command
            .args(["demo", "--headless", "--listen", "127.0.0.1:0", "--cameras", "2", "--size", "160x120"])
            .args(more)
            .env("RUST_LOG", "error")
            .env("HULLTOUCH_TOKEN", TOKEN)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn run(command: &mut Command) -> Demo {
        let mut running = Running::start(command);
        let mut errors = BufReader::new(running.child().stderr.take().expect("piped"));
        let mut line = |prefix: &str| {
            let mut line = String::new();
            errors.read_line(&mut line).expect("a line");
            line.trim().strip_prefix(prefix).unwrap_or_else(|| panic!("found {line:?}")).to_owned()
        };
        let address = line("page: http://");
        assert_eq!(address, line("viewers: http://"));
        assert_eq!(line("token: "), "that of HULLTOUCH_TOKEN");
        Demo { running, socket: format!("ws://{address}feed"), errors }
    }

    async fn connect(&self, token: Option<&str>) -> Page {
        let mut request = self.socket.as_str().into_client_request().expect("an address");
        let offered = token.map(|token| format!(", hulltouch.token.{token}")).unwrap_or_default();
        let protocols = format!("hulltouch.feed.v1{offered}").parse().expect("a value");
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
        let (socket, _) = tokio_tungstenite::connect_async(request).await.expect("connects");
        Page { socket, deadline: tokio::time::Instant::now() + TIMEOUT }
    }
}

struct Page {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    /// By then it has heard all that its test waits for.
    deadline: tokio::time::Instant,
}

impl Page {
    async fn say(&mut self, text: Value) {
        self.socket.send(Message::text(text.to_string())).await.expect("sent");
    }

    async fn hear(&mut self) -> Message {
        let heard = tokio::time::timeout_at(self.deadline, self.socket.next()).await.expect("in time");
        heard.expect("not closed").expect("a message")
    }

    async fn op(&mut self, op: &str) -> Value {
        loop {
            if let Message::Text(text) = self.hear().await {
                let text: Value = serde_json::from_str(&text).expect("JSON");
                if text["op"] == op {
                    return text;
                }
            }
        }
    }

    /// Hears until a command is done and something else has been heard, in whichever order they come; returns
    /// the answer.
    async fn done_and(&mut self, mut is_it: impl FnMut(&Message) -> bool) -> Value {
        let (mut done, mut heard) = (None, false);
        loop {
            let message = self.hear().await;
            heard |= is_it(&message);
            if let Message::Text(text) = &message {
                let text: Value = serde_json::from_str(text).expect("JSON");
                done = done.or((text["op"] == "done").then_some(text));
            }
            match done {
                Some(done) if heard => return done,
                _ => {}
            }
        }
    }

    async fn binary(&mut self, kind: u8) -> Vec<u8> {
        loop {
            if let Message::Binary(bytes) = self.hear().await {
                if bytes[4] == 1 {
                    let seq = u32_at(&bytes, 8);
                    self.say(json!({"op": "shown", "seq": seq})).await;
                }
                if bytes[4] == kind {
                    return bytes.to_vec();
                }
            }
        }
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("long enough"))
}

/// Of both cameras: a silhouette, and a JPEG of the size that the header gives.
fn shows_the_person(set: &[u8]) -> bool {
    assert_eq!(u16::from_le_bytes([set[6], set[7]]), 2, "both cameras");
    (0..2).all(|camera| {
        let entry = 48 + 32 * camera;
        let part = |at: usize| {
            let (offset, length) = (u32_at(set, entry + at) as usize, u32_at(set, entry + at + 4) as usize);
            &set[offset..offset + length]
        };
        silhouette_from_data(part(12), (160, 120), SilhouetteEncoding::Runs).expect("a silhouette");
        if set[entry + 2] & 2 == 0 {
            return false;
        }
        let sides = [8, 10].map(|at| u16::from_le_bytes([set[entry + at], set[entry + at + 1]]));
        let image = image::load_from_memory(part(20)).expect("a JPEG");
        assert_eq!([image.width(), image.height()], sides.map(u32::from));
        true
    })
}

async fn a_run_is_seen_and_steered(more: &[&str]) {
    let mut demo = Demo::start(more);
    let mut viewer = demo.connect(None).await;
    let hello = viewer.op("hello").await;
    assert_eq!((&hello["controller"], hello["cameras"].as_array().map(Vec::len)), (&json!(false), Some(2)));
    let mut page = demo.connect(Some(TOKEN)).await;
    assert_eq!(page.op("hello").await["controller"], json!(true));
    assert_eq!(page.op("scene").await["scene"], json!("topple"));
    // The first frames come before colours were requested.
    while !shows_the_person(&page.binary(1).await) {}
    let world = page.binary(2).await;
    assert_eq!(u16::from_le_bytes([world[6], world[7]]), 12, "bodies of the scene");
    while page.op("status").await["progress"]["film_s"].as_f64().is_none() {}

    viewer.say(json!({"op": "command", "id": 1, "command": "pause"})).await;
    viewer.op("refused").await;
    page.say(json!({"op": "command", "id": 2, "command": "pause"})).await;
    let is_paused = |message: &Message| match message {
        Message::Binary(bytes) => bytes[4] == 2 && u32_at(bytes, 20) & 1 == 1,
        _ => false,
    };
    page.done_and(is_paused).await;
    let ball = json!({"op": "command", "id": 3, "command": "spawn", "position": [0, 3, 1],
        "shape": {"ball": {"radius": 0.1}}});
    page.say(ball).await;
    let has_thirteen = |message: &Message| match message {
        Message::Text(text) => {
            let text: Value = serde_json::from_str(text).expect("JSON");
            text["op"] == "scene" && text["bodies"].as_array().map(Vec::len) == Some(13)
        }
        _ => false,
    };
    assert!(page.done_and(has_thirteen).await["body"].is_u64());
    page.say(json!({"op": "command", "id": 4, "command": "resume"})).await;
    page.op("done").await;
    drop(viewer);
    let pid = rustix::process::Pid::from_child(demo.running.child());
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).expect("told to end");
    assert_eq!(page.op("bye").await["why"], json!("the run has ended"));
    let status = demo.running.child().wait().expect("reaped");
    let mut errors = String::new();
    demo.errors.read_to_string(&mut errors).expect("text");
    assert!(status.success(), "{status}: {errors}");
}

#[tokio::test]
async fn a_run_over_node_processes_is_seen_and_steered() {
    a_run_is_seen_and_steered(&[]).await;
}

#[tokio::test]
async fn a_run_in_one_process_is_seen_and_steered() {
    a_run_is_seen_and_steered(&["--transport", "inprocess"]).await;
}

/// Has film keep the colours of all frames until what it returns is dropped. Each request lasts for some seconds, and a busy
/// machine takes longer for a picture, while film goes on.
fn keep_colours(colours: Arc<ColourRing>, cameras: usize) -> Sender<()> {
    let request = move || (0..cameras).for_each(|camera| colours.request(camera, false));
    request();
    let (kept, ended) = channel();
    std::thread::spawn(move || {
        while ended.recv_timeout(Duration::from_millis(100)) == Err(RecvTimeoutError::Timeout) {
            request();
        }
    });
    kept
}

/// What eight cameras of the studio send a page by default, a second, in bits: the mean of frames all over
/// a walk past them.
#[test]
fn eight_cameras_at_full_rate_fit_into_fifteen_megabits() {
    let rig = stage::studio_rig(8, (640, 480)).expect("a rig");
    let camera = |(index, camera): (usize, &hull::Camera)| NodeCamera {
        camera: camera.clone(),
        rig_index: index as u16,
        source: SourceConfig::Stage(StageConfig::default()),
        background: None,
        segmentation: SegmentSettings::default(),
        ignored: None,
    };
    let config = NodeConfig {
        cameras: rig.cameras().iter().enumerate().map(camera).collect(),
        settings: ProbeSettings::default(),
        fps: 30.0,
    };
    let ring = Arc::new(FrameRing::new(8));
    let film = Film::prepare(&config, Arc::clone(&ring)).expect("backgrounds");
    let _kept = keep_colours(film.colours(), 8);
    let encoder = PictureEncoder::new(Arc::clone(&ring), film.colours(), config.rig_indices());
    let encoder = encoder.expect("a thread");
    film.start(RunStart::of_this_process(Pace::lock_step(1))).expect("films");
    let (mut runs, mut jpegs, mut sets) = (0, 0, 0);
    for frame in 0..45 {
        film.credit(frame);
        let deadline = Instant::now() + TIMEOUT;
        let found = loop {
            assert!(Instant::now() < deadline, "frame {frame} is filmed sooner or later");
            match ring.get(frame) {
                Ok(found) => break found,
                Err(_) => std::thread::sleep(Duration::from_millis(2)),
            }
        };
        if frame % 3 != 0 {
            continue;
        }
        let (sender, pictures) = channel();
        let crops = PictureRequest {
            frame: Some(found.number),
            kind: PictureKind::Crops,
            scale_log2: 0,
            jpeg_quality: web_server::pictures::JPEG_QUALITY,
            cameras: vec![],
        };
        encoder.request(crops, move |picture: Picture| drop(sender.send(picture.camera))).expect("accepted");
        let pictures: Vec<CameraPicture> = pictures.into_iter().collect();
        assert!(pictures.len() == 8 && pictures.iter().all(|picture| !picture.jpeg.is_empty()));
        runs += pictures.iter().map(|picture| picture.runs.len()).sum::<usize>();
        jpegs += pictures.iter().map(|picture| picture.jpeg.len()).sum::<usize>();
        sets += 1;
    }
    // Table and header of a frame set; sixty worlds of twelve bodies and twenty touches.
    let frames = 30 * ((runs + jpegs) / sets + 48 + 8 * (32 + 6));
    let worlds = 60 * (48 + 12 * 48 + 4 + 20 * 28);
    let bits = 8 * (frames + worlds);
    eprintln!("runs {} B, JPEGs {} B a frame; {:.2} Mbit/s", runs / sets, jpegs / sets, bits as f64 / 1e6);
    assert!(bits <= 15_000_000, "{bits} bits a second");
}

#[test]
fn the_page_is_opened_in_a_browser_on_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let (browser, opened) = (folder.path().join("xdg-open"), folder.path().join("opened"));
    fs::write(&browser, "#!/bin/sh\ncd \"${0%/*}\" && printf %s \"$1\" >part && mv part opened\n")
        .expect("written");
    fs::set_permissions(&browser, PermissionsExt::from_mode(0o755)).expect("its own file");
    let mut command = Demo::command(&["--open"]);
    let path = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{}:{path}", folder.path().display()));
    let demo = Demo::run(&mut command);
    let address = demo
        .socket
        .strip_prefix("ws://")
        .and_then(|address| address.strip_suffix("feed"))
        .expect("an address");
    let by = Instant::now() + TIMEOUT;
    while !opened.exists() {
        assert!(Instant::now() < by, "no browser was started");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(fs::read_to_string(opened).expect("text"), format!("http://{address}?token={TOKEN}"));
}

#[test]
fn a_run_without_a_page_opens_none() {
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    let output = command.args(["demo", "--headless", "--open", "--seconds", "1"]).output().expect("it ends");
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("--open: this run serves no page: expected no --headless, or --listen"), "{said}");
}
