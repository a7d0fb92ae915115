//! A replay that is sought, looped and played again, over the real program.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::demo::{Demo, TOKEN};
use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::{Coordinator, GoingOn, Progress, RunSettings, Snapshot, Transport, Watcher};
use futures::{SinkExt as _, StreamExt as _};
use recording::Recording;
use serde_json::{Value, json};
use sim::World;
use testkit::Running;
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

const TIMEOUT: Duration = Duration::from_secs(300);
/// Longer than a replay waits at its end for a page that has gone.
const LONGER_THAN_GRACE: Duration = Duration::from_secs(4);
const STEPS: u64 = 600;

/// Five seconds of a small studio, made as fast as they can be: a test on a busy machine finds the replay before its end.
fn recorded(folder: &Path) -> PathBuf {
    let file = folder.join("run.mcap");
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
        .args(["demo", "--cameras", "3", "--size", "160x120", "--seconds", "5", "--unpaced", "--headless"])
        .args(["--transport", "inprocess", "--record"])
        .arg(&file)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    file
}

/// A run without viewers.
struct Quiet;

impl Watcher for Quiet {
    fn progress(&mut self, _progress: &Progress) {}
    fn wants_snapshot(&mut self, _film_s: f64) -> bool {
        false
    }
    fn snapshot(&mut self, _snapshot: Snapshot<'_>) {}
}

/// What a program is told of each step, as far as it may not change when the step is made again.
type Told = Vec<String>;

struct Keeper(Arc<Mutex<Vec<Told>>>);

impl Recorder for Keeper {
    fn frame(&mut self, _record: FrameRecord<'_>) {}

    fn step(&mut self, record: &StepRecord<'_>) {
        let field = |name: &str, value: Value| format!("\"{name}\":{value}");
        let mut told = vec![
            field("step", json!(record.step)),
            field("time_s", json!(record.film_s)),
            field("frame", json!(record.frame)),
        ];
        for body in record.world.bodies() {
            told.push(field("position_m", json!(body.pose.position_m())));
            told.push(field("rotation_xyzw", json!(body.pose.rotation_xyzw())));
            told.push(field("velocity_m_s", json!(body.velocity_m_s)));
            told.push(field("spin_rad_s", json!(body.spin_rad_s)));
        }
        self.0.lock().expect("whole").push(told);
    }

    fn end(&mut self, _record: &EndRecord<'_>) {}
}

/// The recorded run once, from its beginning to its end.
async fn first_pass(recording: &Recording) -> Vec<Told> {
    let header = recording.header();
    let settings = RunSettings {
        probes: header.probes,
        fps: header.fps,
        latency_s: None,
        hold_s: header.hold_s,
        going_on: GoingOn { min_cameras: 1, ..GoingOn::default() },
        seconds: None,
        lock_step: true,
        ask_every: header.asks,
        reuse_within_m: header.scene.hull().reuse_within_m,
        connect_timeout: Duration::ZERO,
    };
    let world = World::new(&header.scene, header.world).expect("a world");
    let transport = Transport::in_process(Box::new(recording.frames().expect("readable")));
    let told = Arc::default();
    let coordinator = Coordinator::new(transport, world, header.observers(), settings)
        .with_recorder(Box::new(Keeper(Arc::clone(&told))))
        .with_schedule(Box::new(recording.steps().expect("readable")));
    coordinator.run(&mut Quiet, std::future::pending()).await.expect("it runs");
    let told = told.lock().expect("whole");
    told.clone()
}

/// A replay in real time that serves a page.
struct Replay {
    running: Running,
    address: String,
}

impl Replay {
    fn start(file: &Path, more: &[&str]) -> Replay {
        let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
        command
            .arg("replay")
            .arg(file)
            .args(["--headless", "--listen", "127.0.0.1:0"])
            .args(more)
            .env("HULLTOUCH_TOKEN", TOKEN)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut running = Running::start(&mut command);
        let stderr = running.child().stderr.take().expect("piped");
        let (tell, told) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if let Some(address) = line.strip_prefix("page: http://") {
                    // The test may have given up.
                    let _ = tell.send(address.split('/').next().unwrap_or_default().to_owned());
                }
            }
        });
        let address = told.recv_timeout(Duration::from_secs(120)).expect("it says where its page is");
        Replay { running, address }
    }

    /// A page that looks for as long as the task lives.
    async fn page(&self) -> JoinHandle<()> {
        let mut request = format!("ws://{}/feed", self.address).into_client_request().expect("an address");
        let protocol = "hulltouch.feed.v1".parse().expect("a value");
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocol);
        let (mut socket, _) = tokio_tungstenite::connect_async(request).await.expect("connects");
        // Reading answers pings.
        tokio::spawn(async move { while let Some(Ok(_)) = socket.next().await {} })
    }

    fn has_exited(&mut self) -> bool {
        self.running.child().try_wait().expect("it can be asked").is_some()
    }

    /// Waits until it has ended by itself.
    fn succeeds(self) -> bool {
        self.running.wait_with_output().expect("it ends").status.success()
    }
}

/// A program that steers and follows a run over JSON.
struct Program {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    asked: u64,
}

impl Program {
    async fn connect(address: &str) -> Program {
        let socket = tokio_tungstenite::connect_async(format!("ws://{address}/state?rate=60&token={TOKEN}"));
        Program { socket: socket.await.expect("connects").0, asked: 0 }
    }

    /// The next message, and its text; `None` once the run has ended.
    async fn hear(&mut self) -> Option<(Value, String)> {
        loop {
            let heard = tokio::time::timeout(TIMEOUT, self.socket.next()).await.expect("in time");
            match heard {
                Some(Ok(Message::Text(text))) => {
                    let text = text.to_string();
                    return Some((serde_json::from_str(&text).expect("JSON"), text));
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return None,
                Some(Ok(_)) => {}
            }
        }
    }

    /// Asks for something; returns the answer.
    async fn ask(&mut self, mut command: Value) -> Value {
        self.asked += 1;
        (command["op"], command["id"]) = ("command".into(), self.asked.into());
        self.socket.send(Message::text(command.to_string())).await.expect("sent");
        loop {
            let (message, _) = self.hear().await.expect("the run goes on");
            if message["id"] == self.asked && message["op"] != "state" {
                return message;
            }
        }
    }

    async fn must(&mut self, command: Value) {
        let said = command.to_string();
        let answer = self.ask(command).await;
        assert_eq!(answer["op"], "done", "{said}: {answer}");
    }

    /// The text of the first state that is as wanted.
    async fn state(&mut self, is_it: impl Fn(&Value) -> bool) -> String {
        loop {
            let (message, text) = self.hear().await.expect("the run goes on");
            if message["op"] == "state" && is_it(&message) {
                return text;
            }
        }
    }

    /// Seeks a film time; the paused world there must be that of a step of the first pass, bit for bit.
    async fn finds(&mut self, film_s: f64, step: u64, run: &[Told]) {
        self.must(json!({"command": "seek", "film_s": film_s})).await;
        let text = self.state(|state| state["step"] == step && state["paused"] == true).await;
        for told in &run[step as usize - 1] {
            assert!(text.contains(told), "{film_s} s: expected {told} in {text}");
        }
    }
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime")
}

#[test]
fn wherever_a_replay_is_sought_the_world_is_that_of_the_run_and_it_stays_while_a_page_is_open() {
    let folder = tempfile::tempdir().expect("folder");
    let file = recorded(folder.path());
    let recording = Recording::open(&file).expect("a recording");
    let run = runtime().block_on(first_pass(&recording));
    assert_eq!(run.len() as u64, STEPS);
    let mut replay = Replay::start(&file, &[]);
    runtime().block_on(async {
        let mut program = Program::connect(&replay.address).await;
        program.must(json!({"command": "pause"})).await;
        let page = replay.page().await;
        for (film_s, step) in [(1.0, 120), (0.3, 36), (0.0, 1), (4.9, 588)] {
            program.finds(film_s, step, &run).await;
        }
        for (command, why) in [
            (
                json!({"command": "seek", "film_s": 5.5}),
                "a seek to 5.5 s, expected 0 to 5.000 s: the recording",
            ),
            (json!({"command": "speed", "factor": 0}), "speed.factor is 0, expected a number from 0.1 to 10"),
            (json!({"command": "reset"}), "this run follows a recording"),
        ] {
            let answer = program.ask(command).await;
            assert!(answer["why"].as_str().is_some_and(|found| found.starts_with(why)), "{answer}");
        }
        // To its end, where it stands.
        program.must(json!({"command": "resume"})).await;
        program.state(|state| state["step"] == STEPS && state["paused"] == true).await;
        let until = Instant::now() + LONGER_THAN_GRACE;
        program.state(|_| Instant::now() > until).await;
        assert!(!replay.has_exited(), "a page is open");
        program.finds(0.3, 36, &run).await;
        program.finds(5.0, STEPS, &run).await;
        // It is played again, and again.
        program.must(json!({"command": "loop", "on": true})).await;
        program.must(json!({"command": "speed", "factor": 10})).await;
        program.must(json!({"command": "resume"})).await;
        for _ in 0..2 {
            program.state(|state| state["step"].as_u64().is_some_and(|step| step > 500)).await;
            program.state(|state| state["step"].as_u64().is_some_and(|step| step < 300)).await;
        }
        page.abort();
        while program.hear().await.is_some() {}
    });
    assert!(replay.succeeds(), "each step was as recorded");
}

#[test]
fn a_replay_that_is_made_once_ends_with_the_recording_while_a_page_is_open() {
    let folder = tempfile::tempdir().expect("folder");
    let file = recorded(folder.path());
    let replay = Replay::start(&file, &["--once"]);
    runtime().block_on(async {
        let page = replay.page().await;
        let mut program = Program::connect(&replay.address).await;
        program.must(json!({"command": "loop", "on": true})).await;
        while program.hear().await.is_some() {}
        page.abort();
    });
    assert!(replay.succeeds(), "each step was as recorded");
}

#[test]
fn a_live_run_is_not_sought() {
    let demo = Demo::start(&[]);
    runtime().block_on(async {
        let mut program = Program::connect(&demo.address).await;
        for command in [
            json!({"command": "seek", "film_s": 1}),
            json!({"command": "speed", "factor": 2}),
            json!({"command": "loop", "on": true}),
        ] {
            let answer = program.ask(command).await;
            let why = answer["why"].as_str().unwrap_or_default();
            assert!(why.starts_with("this run is no replay"), "{answer}");
        }
    });
}
