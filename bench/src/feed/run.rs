//! One demo, looked at by one page.

use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use coordinator::Percentiles;
use serde_json::Value;
use setup::cli::{Failure, Outcome};
use tokio::time::{Instant, timeout_at};

use super::link::relay;
use super::page::{Page, PageMessage};
use super::rows::Row;

/// The page looks for so long, and looks away for so long.
const TURN: Duration = Duration::from_secs(5);
/// The first seconds of a run are not counted: its processes start.
const WARM_UP: Duration = Duration::from_secs(3);
/// After a turn has begun, figures are of the turn before for so long.
const SETTLING: Duration = Duration::from_millis(500);

/// What is measured in one row.
pub struct Setting {
    /// What is filmed, for the table.
    pub source: String,
    /// The options of `demo` that film it.
    pub program: Vec<String>,
    /// How long the page looks, seconds; none: to the end.
    pub seconds: Option<f64>,
    /// What its link carries.
    pub link_mbit_per_s: Option<f64>,
}

/// A demo that serves a page; it is ended when this goes.
struct Demo {
    child: Child,
    viewers: SocketAddr,
    /// Kept open, so that the demo may write.
    _errors: BufReader<ChildStderr>,
}

impl Demo {
    fn start(program: &[String]) -> Outcome<Demo> {
        let itself = std::env::current_exe().map_err(Failure::run)?;
        let mut child = Command::new(itself)
            .args(["demo", "--headless", "--listen", "127.0.0.1:0"])
            .args(program)
            .env("RUST_LOG", "error")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(Failure::run)?;
        let mut errors = BufReader::new(child.stderr.take().ok_or_else(|| Failure::run("no pipe"))?);
        let mut said = String::new();
        loop {
            let begin = said.len();
            let length = errors.read_line(&mut said).map_err(Failure::run)?;
            if length == 0 {
                let _ = child.wait();
                return Err(Failure::run(format_args!("the demo has ended: {said}")));
            }
            let address = said[begin..].trim().strip_prefix("viewers: http://");
            if let Some(viewers) = address.and_then(|address| address.trim_end_matches('/').parse().ok()) {
                return Ok(Demo { child, viewers, _errors: errors });
            }
        }
    }
}

impl Drop for Demo {
    fn drop(&mut self) {
        // Told to end it takes its camera processes with it; one that has ended needs neither.
        if let Some(pid) = rustix::process::Pid::from_raw(self.child.id().cast_signed()) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let _ = self.child.wait();
    }
}

/// Sums over the time that the page looked.
#[derive(Default)]
struct PageFigures {
    looked_s: f64,
    sets: u64,
    set_bytes: u64,
    other_bytes: u64,
    delay_ms: Percentiles,
    step_ms: Percentiles,
    step_alone_ms: Percentiles,
    tier: String,
    dropped: u64,
}

/// Runs a demo and looks at it.
pub async fn measured(setting: &Setting) -> Outcome<Row> {
    let demo = Demo::start(&setting.program)?;
    let server = match setting.link_mbit_per_s {
        Some(mbit_per_s) => relay(demo.viewers, mbit_per_s).await?,
        None => demo.viewers,
    };
    let mut page = Page::connect(server).await?;
    let mut seen = PageFigures::default();
    if let Some(seconds) = setting.seconds {
        look(&mut page, WARM_UP, true, &mut PageFigures::default()).await?;
        let turns = (seconds / TURN.as_secs_f64()).ceil().max(1.0);
        let turn = Duration::from_secs_f64(seconds / turns);
        for _ in 0..turns as u64 {
            look(&mut page, turn, false, &mut seen).await?;
            look(&mut page, turn, true, &mut seen).await?;
        }
    } else {
        look(&mut page, Duration::from_secs(24 * 3600), true, &mut seen).await?;
    }
    if seen.sets == 0 {
        return Err(Failure::run(format_args!("{}: no frame set came", setting.source)));
    }
    Ok(seen.row(setting, &page))
}

/// Reads a page's messages for a while, or until the run ends.
async fn look(page: &mut Page, turn: Duration, looks: bool, seen: &mut PageFigures) -> Outcome {
    page.look(looks).await?;
    let began = Instant::now();
    loop {
        let Ok(message) = timeout_at(began + turn, page.receive()).await else { break };
        match message? {
            PageMessage::Closed => break,
            PageMessage::FrameSet { bytes, delay_s } if looks => {
                seen.sets += 1;
                seen.set_bytes += bytes as u64;
                delay_s.into_iter().for_each(|delay_s| seen.delay_ms.add(1e3 * delay_s));
            }
            // What was on its way when the page looked away.
            PageMessage::FrameSet { .. } => {}
            PageMessage::Other { bytes } => seen.other_bytes += bytes as u64,
            PageMessage::Text { bytes, text } => {
                seen.other_bytes += bytes as u64;
                seen.note(&text, looks, began.elapsed() > SETTLING);
            }
        }
    }
    if looks {
        seen.looked_s += began.elapsed().as_secs_f64();
    }
    Ok(())
}

impl PageFigures {
    fn note(&mut self, text: &Value, looks: bool, is_settled: bool) {
        if text["op"] != "status" {
            return;
        }
        self.tier = text["feed"]["tier"].as_str().unwrap_or_default().to_owned();
        self.dropped = text["feed"]["dropped"].as_u64().unwrap_or_default();
        let steps_ms = if looks { &mut self.step_ms } else { &mut self.step_alone_ms };
        text["progress"]["p50_ms"]
            .as_f64()
            .filter(|_| is_settled)
            .into_iter()
            .for_each(|ms| steps_ms.add(ms));
    }

    fn row(&self, setting: &Setting, page: &Page) -> Row {
        let bytes_per_s = |bytes: u64| bytes as f64 / self.looked_s;
        let bytes_per_set = self.set_bytes as f64 / self.sets as f64;
        Row {
            source: setting.source.clone(),
            cameras: page.cameras,
            fps: page.fps,
            link_mbit_per_s: setting.link_mbit_per_s,
            mbit_per_s: 8e-6 * bytes_per_s(self.set_bytes + self.other_bytes),
            sets_per_s: self.sets as f64 / self.looked_s,
            bytes_per_set,
            mbit_per_s_at_fps: 8e-6 * (bytes_per_set * page.fps + bytes_per_s(self.other_bytes)),
            delay_p50_ms: self.delay_ms.p50(),
            delay_p99_ms: self.delay_ms.p99(),
            delay_max_ms: self.delay_ms.max(),
            tier: self.tier.clone(),
            sets_dropped: self.dropped,
            step_p50_ms: self.step_ms.p50(),
            step_p50_alone_ms: self.step_alone_ms.p50(),
        }
    }
}
