//! The nodes are the coordinator's memory: one that was killed and is started again goes on where it was.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use futures::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use testkit::{Watch, timely};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

const TIMEOUT: Duration = Duration::from_secs(60);
const STEPS_PER_S: u64 = 120;
const FPS: f64 = 30.0;

/// Nothing falls, so that what moves does so evenly.
const SCENE: &str = "
gravity = [0.0, 0.0, 0.0]
floor.enabled = false
[[bodies]]
name = 'still'
shape.box.size = [0.2, 0.2, 0.2]
place.at = [2.0, 1.0, 2.0]";

/// Faster than what the solver puts to sleep.
const SPEED_M_S: f64 = 0.5;

const GONE_ON: &str = "going on from the world";

/// A process that ends with its test.
struct Process(Child);

impl Process {
    fn start(arguments: &[&str], cluster: &Path, more: &[&str]) -> Process {
        let child = testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
            .args(arguments)
            .arg(cluster)
            .args(more)
            .env("HULLTOUCH_TOKEN", "a-token-for-tests")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        Process(child.expect("starts"))
    }

    /// As when its computer loses power.
    fn kill(&mut self) {
        // It may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A cluster file of two nodes of a studio camera each, and the nodes.
struct Studio {
    folder: tempfile::TempDir,
    _nodes: Vec<Process>,
}

impl Studio {
    fn start() -> Studio {
        let folder = tempfile::tempdir().expect("folder");
        let rig = stage::studio_rig(2, (160, 120)).expect("a rig");
        let sockets = ["a.sock", "b.sock"].map(|name| folder.path().join(name));
        let mut text =
            format!("rig = \"rig.toml\"\nscene = \"kept.toml\"\nfps = {FPS:?}\nlatency_s = 0.15\n");
        for (camera, socket) in rig.cameras().iter().zip(&sockets) {
            let (name, socket) = (camera.name(), socket.display());
            text += &format!(
                "[[camera]]\nname = {name:?}\nnode = \"unix:{socket}\"\nsource = {{ kind = \"stage\" }}\n"
            );
        }
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
        write("rig.toml", &rig.to_toml());
        write("kept.toml", SCENE);
        write("studio.toml", &text);
        let cluster = folder.path().join("studio.toml");
        let node = |camera: &hull::Camera| {
            let mut node = Process::start(&["node"], &cluster, &["--camera", camera.name()]);
            let mut line = String::new();
            let stdout = node.0.stdout.take().expect("piped");
            BufReader::new(stdout).read_line(&mut line).expect("a line");
            assert!(line.starts_with("listening on "), "{line}");
            node
        };
        let _nodes = rig.cameras().iter().map(node).collect();
        Studio { folder, _nodes }
    }
}

/// A coordinator of a studio, and a program that follows and steers it.
struct Run {
    process: Process,
    began: Instant,
    /// What it says, line by line.
    lines: Receiver<String>,
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
}

impl Run {
    async fn start(studio: &Studio, more: &[&str]) -> Run {
        let began = Instant::now();
        let mut arguments = vec!["--headless", "--listen", "127.0.0.1:0", "--seconds", "600"];
        arguments.extend(more);
        let cluster = studio.folder.path().join("studio.toml");
        let mut process = Process::start(&["coordinator"], &cluster, &arguments);
        let stderr = process.0.stderr.take().expect("piped");
        let (tell, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                // The test may be over.
                let _ = tell.send(line);
            }
        });
        let page = lines.recv_timeout(TIMEOUT).expect("a line");
        let address = page.strip_prefix("page: http://").and_then(|rest| rest.split('/').next());
        let address = address.unwrap_or_else(|| panic!("found {page:?}"));
        let address = format!("ws://{address}/state?rate=120&token=a-token-for-tests");
        let (socket, _) = tokio_tungstenite::connect_async(address).await.expect("connects");
        Run { process, began, lines, socket }
    }

    /// The next message that is as asked.
    async fn heard(&mut self, is_it: impl Fn(&Value) -> bool) -> Value {
        let search = async {
            while let Some(message) = self.socket.next().await {
                let text = message.expect("it goes on").into_text().expect("text");
                let value: Value = serde_json::from_str(&text).expect("JSON");
                if is_it(&value) {
                    return value;
                }
            }
            panic!("it ended");
        };
        tokio::time::timeout(TIMEOUT, search).await.expect("in time")
    }

    async fn command(&mut self, id: u64, mut command: Value) -> Value {
        command["op"] = "command".into();
        command["id"] = id.into();
        self.socket.send(Message::text(command.to_string())).await.expect("sent");
        let answer = self.heard(|message| message["id"] == id).await;
        assert_eq!(answer["op"], "done", "{answer}");
        answer
    }

    /// Throws a ball into the room and lets it fly for longer than nodes may lack.
    async fn throw(&mut self, id: u64) -> u64 {
        let spawn = json!({
            "command": "spawn", "shape": {"ball": {"radius": 0.1}}, "name": "thrown",
            "position": [2.0, 2.0, 2.0], "velocity": [0, SPEED_M_S, 0],
        });
        let ball = self.command(id, spawn).await["body"].as_u64().expect("its number");
        let first = self.heard(|message| position(message, ball).is_some()).await;
        let later = step(&first) + 2 * STEPS_PER_S + STEPS_PER_S / 2;
        self.heard(|message| message["op"] == "state" && step(message) > later).await;
        ball
    }

    /// Kills it, and returns the last that was seen of it.
    async fn kill(mut self) -> Value {
        let mut last = self.heard(|message| message["op"] == "state").await;
        self.process.kill();
        while let Some(Ok(Message::Text(text))) = self.socket.next().await {
            last = serde_json::from_str(&text).expect("JSON");
        }
        last
    }

    /// The line that says where it goes on from, if it has said so.
    fn gone_on(&self) -> Option<String> {
        self.lines.try_iter().find(|line| line.starts_with(GONE_ON))
    }

    /// The step that it goes on from, as it says.
    fn kept_step(&self) -> u64 {
        let mut lines = std::iter::from_fn(|| self.lines.recv_timeout(TIMEOUT).ok());
        let line = lines.find(|line| line.starts_with(GONE_ON)).expect("it says so");
        let kept = line.split_once("scene kept, 2 bodies, step ").expect("what it goes on from").1;
        kept.split(' ').next().and_then(|kept| kept.parse().ok()).expect("a number")
    }
}

fn step(state: &Value) -> u64 {
    state["step"].as_u64().unwrap_or_default()
}

fn position(state: &Value, body: u64) -> Option<[f64; 3]> {
    let bodies = state["bodies"].as_array()?;
    let found = bodies.iter().find(|found| found["id"] == body)?;
    serde_json::from_value(found["position_m"].clone()).ok()
}

#[tokio::test]
async fn a_killed_coordinator_goes_on_where_it_was_and_with_fresh_starts_over() {
    let watch = Watch::start();
    let studio = Studio::start();
    let mut first = Run::start(&studio, &[]).await;
    let ball = first.throw(1).await;
    assert_eq!(first.gone_on(), None, "no node remembers a world");
    let last = first.kill().await;

    let mut second = Run::start(&studio, &[]).await;
    let kept = second.kept_step();
    let begun = second.heard(|message| message["op"] == "state" && step(message) > kept).await;
    let took = second.began.elapsed();
    let lost_s = (step(&last) as f64 - kept as f64) / STEPS_PER_S as f64;
    timely!(watch, took < Duration::from_secs(2), "it steps {took:?} after it was started");
    timely!(watch, lost_s < 1.2, "{lost_s} s of film are lost");
    let flown_s = (step(&begun) as f64 - step(&last) as f64) / STEPS_PER_S as f64;
    let place = |state: &Value| position(state, ball).expect("the ball");
    let expected_m = place(&last)[1] + SPEED_M_S * flown_s;
    assert!((place(&begun)[1] - expected_m).abs() < 1e-3, "{begun} {last}");
    assert_eq!(position(&begun, 0), position(&last, 0), "what lay still");
    // Film has begun again, and its numbers with it.
    let film_s = begun["time_s"].as_f64().expect("film time");
    timely!(watch, (0.0..5.0).contains(&film_s), "film began {film_s} s ago");
    let on = second.heard(|message| message["frame"].as_u64().is_some_and(|frame| frame > 5)).await;
    let (frame, film_s) = (on["frame"].as_f64().expect("a number"), on["time_s"].as_f64().expect("a time"));
    assert!(frame <= film_s * FPS + 1e-6, "frame {frame} at {film_s} s");
    timely!(watch, frame > (film_s - 1.0) * FPS, "frame {frame} at {film_s} s");

    second.command(2, json!({"command": "reset"})).await;
    let again = second.heard(|message| message["op"] == "state" && message["generation"] == 2).await;
    assert!(position(&again, ball).is_none() && step(&again) < STEPS_PER_S, "the scene's start: {again}");
    second.throw(3).await;
    second.kill().await;

    let mut fresh = Run::start(&studio, &["--fresh"]).await;
    let begun = fresh.heard(|message| message["op"] == "state" && step(message) > 0).await;
    assert!(position(&begun, ball).is_none() && step(&begun) < STEPS_PER_S, "the scene's start: {begun}");
    assert_eq!(fresh.gone_on(), None);
}

#[tokio::test]
async fn one_that_observes_shows_the_run_of_another_and_steers_nothing() {
    let watch = Watch::start();
    let studio = Studio::start();
    let mut leads = Run::start(&studio, &[]).await;
    let mut observes = Run::start(&studio, &["--observe"]).await;
    let ball = leads.throw(1).await;
    let seen = observes.heard(|message| position(message, ball).is_some()).await;
    let led = leads.heard(|message| message["op"] == "state" && step(message) > step(&seen)).await;
    let behind_s = (step(&led) - step(&seen)) as f64 / STEPS_PER_S as f64;
    timely!(watch, behind_s < 3.0, "{behind_s} s behind");
    let moved_m = position(&led, ball).expect("the ball")[1] - position(&seen, ball).expect("the ball")[1];
    assert!((moved_m - SPEED_M_S * behind_s).abs() < 1e-3, "where it was: {seen} {led}");
    // Frames go on while the bodies of one second are shown.
    let frame = |message: &Value| message["frame"].as_u64().unwrap_or_default();
    observes.heard(|message| frame(message) > frame(&seen) + 5).await;

    let reset = json!({"op": "command", "id": 2, "command": "reset"});
    observes.socket.send(Message::text(reset.to_string())).await.expect("sent");
    let refused = observes.heard(|message| message["id"] == 2).await;
    assert!(refused.to_string().contains("observes the run of another"), "{refused}");
    let later = step(&led) + STEPS_PER_S;
    let on = leads.heard(|message| message["op"] == "state" && step(message) > later).await;
    assert_eq!(on["generation"], led["generation"], "nothing has happened to it");
    // The next who leads is observed as well.
    leads.kill().await;
    let next = Run::start(&studio, &["--fresh"]).await;
    observes
        .heard(|message| {
            message["op"] == "state" && step(message) < 5 * STEPS_PER_S && position(message, ball).is_none()
        })
        .await;
    drop(next);
}
