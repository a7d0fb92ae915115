//! A room that is watched: what nodes and their coordinator tell on their ports of `--metrics`, and that everything on the
//! dashboard, in the alert rules and in docs/metrics.md is there.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use net::{Authority, Identity, Validity};

use crate::certified::{ROOM, issue};
use crate::http::get;
use crate::prometheus;
use crate::prometheus::Prometheus;
use crate::room::{Running, named_room, program};
use rustix::process::{Pid, Signal, kill_process};

const TIMEOUT: Duration = Duration::from_secs(60);

/// A process of the room that serves metrics; it ends with its test.
struct Service {
    running: Running,
    metrics: SocketAddr,
    /// Where a node listens.
    listens: Option<String>,
}

impl Service {
    fn start(folder: &Path, arguments: &[&str]) -> Service {
        let mut command = program();
        command.current_dir(folder).args(arguments).args(["--metrics", "127.0.0.1:0"]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut running = Running::start(&mut command);
        let child = running.child();
        let lines = lines(child.stderr.take().expect("piped"));
        let address = told(&lines, "metrics: http://", "/metrics");
        let metrics = address.parse().expect("an address");
        let listens = (arguments[0] == "node")
            .then(|| told(&self::lines(child.stdout.take().expect("piped")), "listening on ", ""));
        Service { running, metrics, listens }
    }

    fn signal(&self, signal: Signal) {
        let process = Pid::from_raw(self.running.id().cast_signed()).expect("a number");
        kill_process(process, signal).expect("sent");
    }

    /// What `/ready` says.
    fn ready(&self) -> (u16, String) {
        let answer = get(self.metrics, "/ready");
        (answer.status, answer.body)
    }

    /// Waits until `/ready` says so.
    #[track_caller]
    fn await_ready(&self, expected: u16) -> String {
        let by = Instant::now() + TIMEOUT;
        loop {
            let (status, line) = self.ready();
            if status == expected {
                return line;
            }
            assert!(Instant::now() < by, "expected {expected}, found {status}: {line}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Waits until `hulltouch ready` ends with that status; what it says. A busy machine may be ready now and then.
    #[track_caller]
    fn await_asked(&self, expected: i32) -> Output {
        let by = Instant::now() + TIMEOUT;
        loop {
            let asked = program().arg("ready").arg(self.metrics.to_string()).output().expect("ends");
            if asked.status.code() == Some(expected) {
                return asked;
            }
            assert!(Instant::now() < by, "expected status {expected}: {asked:?}");
        }
    }

    /// Waits until a metric has a value.
    #[track_caller]
    fn await_value(&self, name: &str, labels: &[(&str, &str)], expected: f64) {
        let by = Instant::now() + TIMEOUT;
        loop {
            let found = value(&get(self.metrics, "/metrics").body, name, labels);
            if found == expected {
                return;
            }
            assert!(Instant::now() < by, "{name} is {found}, expected {expected}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

/// What a process writes, line by line, to its end: so that it is never held up.
fn lines(pipe: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (tell, told) = channel();
    // Who no longer listens has what it wanted.
    std::thread::spawn(move || {
        BufReader::new(pipe).lines().map_while(Result::ok).for_each(|line| drop(tell.send(line)));
    });
    told
}

fn told(lines: &Receiver<String>, begin: &str, end: &str) -> String {
    let by = Instant::now() + TIMEOUT;
    let mut others = String::new();
    loop {
        let line = lines.recv_timeout(by.saturating_duration_since(Instant::now()));
        let line = line.unwrap_or_else(|_| panic!("no line {begin:?}, but {others:?}"));
        match line.strip_prefix(begin).and_then(|rest| rest.strip_suffix(end)) {
            Some(found) => return found.to_owned(),
            None => others += &line,
        }
    }
}

/// A room whose latency is measured, and with it how late each camera is.
fn room_file(folder: &Path, left: &str, right: &str) -> PathBuf {
    let file = named_room(folder, left, right);
    let text = fs::read_to_string(&file).expect("written");
    fs::write(&file, text.replace("latency_s = 0.4\n", "")).expect("written");
    file
}

/// Two nodes of two cameras each and their coordinator, with certificates.
struct Room {
    nodes: [Service; 2],
    coordinator: Service,
    folder: tempfile::TempDir,
}

impl Room {
    fn new() -> Room {
        let folder = tempfile::tempdir().expect("a folder");
        let authority = Authority::make(ROOM, Validity::days(30)).expect("an authority");
        for name in ["left", "right"] {
            issue(&folder.path().join(name), &authority, &Identity::node(ROOM, name), Validity::days(30));
        }
        let coordinator = folder.path().join("coordinator");
        issue(&coordinator, &authority, &Identity::coordinator(ROOM), Validity::days(30));
        let file = room_file(folder.path(), "", "");
        let file = file.to_str().expect("text");
        let node = |name: &'static str| {
            let more = ["--host", name, "--listen", "127.0.0.1:0", "--certs", name, "--stop-with-stdin"];
            Service::start(folder.path(), &[&["node", file][..], &more[..]].concat())
        };
        let nodes = ["left", "right"].map(node);
        let [left, right] = [&nodes[0], &nodes[1]]
            .map(|node| format!("address = {:?}", node.listens.as_ref().expect("a node")));
        room_file(folder.path(), &left, &right);
        let more = ["--certs", "coordinator", "--headless", "--seconds", "600"];
        let coordinator = Service::start(folder.path(), &[&["coordinator", file][..], &more[..]].concat());
        Room { nodes, coordinator, folder }
    }

    fn services(&self) -> [&Service; 3] {
        [&self.nodes[0], &self.nodes[1], &self.coordinator]
    }
}

/// The value of a series that is there, by its name and all its labels in any order.
#[track_caller]
fn value(text: &str, name: &str, labels: &[(&str, &str)]) -> f64 {
    let has = |line: &&str| {
        let (series, _) = line.rsplit_once(' ').unwrap_or_default();
        let (found, inner) = series.split_once('{').unwrap_or((series, ""));
        let mut found_labels: Vec<&str> = inner.trim_end_matches('}').split_terminator(',').collect();
        let mut expected: Vec<String> =
            labels.iter().map(|(label, value)| format!("{label}={value:?}")).collect();
        found_labels.sort_unstable();
        expected.sort_unstable();
        found == name && found_labels == expected
    };
    let line = text.lines().find(has).unwrap_or_else(|| panic!("no {name} with {labels:?} in\n{text}"));
    line.rsplit(' ').next().and_then(|value| value.parse().ok()).expect("a number")
}

/// The header of a table of metrics in docs/metrics.md.
const HEADER: &str = "| metric | type | labels | unit | meaning |";

/// A metric as one line: its name as Prometheus stores it, its type, and its labels beside those of its port.
fn metric<'a>(name: &str, kind: &str, labels: impl IntoIterator<Item = &'a str>) -> String {
    let labels: BTreeSet<&str> = labels.into_iter().collect();
    format!("{name} {kind} {labels:?}")
}

/// The metrics in the tables of a document.
fn documented_metrics(text: &str) -> BTreeSet<String> {
    let mut metrics = BTreeSet::new();
    let mut is_within = false;
    for line in text.lines() {
        is_within = line == HEADER || (is_within && line.starts_with('|'));
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if let (true, [_, name, kind, labels, ..]) = (is_within, &cells[..])
            && let Some(name) = name.strip_prefix('`').and_then(|name| name.strip_suffix('`'))
        {
            let is_new = metrics.insert(metric(name, kind, labels.split('`').skip(1).step_by(2)));
            assert!(is_new, "{name} has two rows");
        }
    }
    metrics
}

/// The metrics of a scrape. Every series of the port has these labels.
fn served_metrics(text: &str, of_port: &[&str]) -> BTreeSet<String> {
    // Each family begins with lines of help, type and perhaps unit; its samples follow.
    let families = text.split("# TYPE ").skip(1).map(|family| {
        let (head, rest) = family.split_once('\n').expect("samples");
        let (name, kind) = head.split_once(' ').expect("a name and a type");
        let name = if kind == "counter" { format!("{name}_total") } else { name.to_owned() };
        let samples: Vec<&str> = rest.lines().filter(|line| !line.starts_with('#')).collect();
        assert!(!samples.is_empty() && samples.iter().all(|line| line.starts_with(&name)), "{name}: {rest}");
        // Labels stand before the quoted values, as in name{room="a",le="0.1"} 1.
        let parts = samples.iter().flat_map(|line| line.split('"').step_by(2));
        let labels = parts.filter_map(|part| part.strip_suffix('=')?.rsplit(['{', ',']).next());
        metric(&name, kind, labels.filter(|label| *label != "le" && !of_port.contains(label)))
    });
    families.collect()
}

#[test]
fn the_metrics_in_the_documents_are_those_that_are_served() {
    let document = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/metrics.md");
    let documented = documented_metrics(&fs::read_to_string(document).expect("a document"));
    let room = Room::new();
    let by = Instant::now() + TIMEOUT;
    loop {
        let [left, right, coordinator] = room.services().map(|service| get(service.metrics, "/metrics").body);
        let mut served = served_metrics(&coordinator, &["room"]);
        served.extend(served_metrics(&left, &["room", "node"]));
        served.extend(served_metrics(&right, &["room", "node"]));
        let undocumented: Vec<&String> = served.difference(&documented).collect();
        assert!(undocumented.is_empty(), "docs/metrics.md lacks these, or differs: {undocumented:#?}");
        // A metric is served once it has a value.
        let unserved: Vec<&String> = documented.difference(&served).collect();
        if unserved.is_empty() {
            return;
        }
        assert!(Instant::now() < by, "docs/metrics.md has these, which are not served: {unserved:#?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn a_room_tells_how_it_does_and_who_does_not() {
    let room = Room::new();
    let [left, right, coordinator] = room.services();
    for service in room.services() {
        service.await_ready(200);
        let live = get(service.metrics, "/live");
        assert_eq!((live.status, &live.body[..]), (200, "live\n"));
        let asked = service.await_asked(0);
        assert_eq!(asked.stdout, b"ready\n", "{asked:?}");
    }

    left.await_value("hulltouch_ready", &[("room", ROOM), ("node", "left")], 1.0);
    let answer = get(left.metrics, "/metrics");
    assert_eq!(
        answer.header("content-type"),
        Some("application/openmetrics-text; version=1.0.0; charset=utf-8")
    );
    assert!(answer.body.ends_with("\n# EOF\n"), "{}", answer.body);
    let node = [("room", ROOM), ("node", "left")];
    let camera = [("room", ROOM), ("node", "left"), ("camera", "cam_1")];
    assert_eq!(value(&answer.body, "hulltouch_node_held", &node), 1.0);
    assert!(value(&answer.body, "hulltouch_node_frames_total", &camera) > 0.0);
    assert!(value(&answer.body, "hulltouch_node_frame_age_seconds", &camera) < 20.0);
    assert!(value(&answer.body, "hulltouch_node_foreground_ratio", &camera) > 0.0);
    assert!(value(&answer.body, "hulltouch_node_received_bytes_total", &node) > 100.0);

    let run = [("room", ROOM)];
    coordinator.await_value("hulltouch_coordinator_hull_in_use", &run, 1.0);
    coordinator.await_value("hulltouch_coordinator_node_up", &node, 1.0);
    coordinator.await_value("hulltouch_coordinator_camera_left_out", &camera, 0.0);
    let text = get(coordinator.metrics, "/metrics").body;
    let steps = value(&text, "hulltouch_coordinator_steps_total", &run);
    assert_eq!(value(&text, "hulltouch_coordinator_step_seconds_count", &run), steps);

    right.signal(Signal::STOP);
    let line = coordinator.await_ready(503);
    let asked = coordinator.await_asked(1);
    right.signal(Signal::CONT);
    assert!(line.starts_with("camera \"cam_") || line.contains("node right"), "{line}");
    let said = String::from_utf8_lossy(&asked.stderr).into_owned();
    assert!(said.starts_with("hulltouch: not ready: ") && said.lines().count() == 1, "{said}");
    coordinator.await_ready(200);
    let missed = get(coordinator.metrics, "/metrics").body;
    let blind: f64 = missed
        .lines()
        .filter(|line| line.starts_with("hulltouch_coordinator_misses_total"))
        .filter_map(|line| line.rsplit(' ').next()?.parse::<f64>().ok())
        .sum();
    assert!(blind > 0.0, "steps without a hull are counted by cause: {missed}");
}

#[test]
fn a_node_without_a_coordinator_is_live_and_not_ready() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = named_room(folder.path(), "", "");
    let file = file.to_str().expect("text");
    let more = ["--host", "left", "--listen", "127.0.0.1:0", "--stop-with-stdin"];
    let node = Service::start(folder.path(), &[&["node", file][..], &more[..]].concat());
    assert_eq!(get(node.metrics, "/live").status, 200);
    let (status, line) = node.ready();
    assert_eq!(
        (status, &line[..]),
        (503, "camera \"cam_0\" does not film: no coordinator leads this node\n")
    );
    assert_eq!(get(node.metrics, "/").status, 404);
    let refused = program().args(["ready", "127.0.0.1:1"]).output().expect("ends");
    assert_eq!(refused.status.code(), Some(1), "{refused:?}");
    assert!(refused.stderr.starts_with(b"hulltouch: 127.0.0.1:1: "), "{refused:?}");
}

#[test]
fn an_address_that_is_taken_is_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    let run = ["demo", "--cameras", "1", "--size", "64x48", "--seconds", "1", "--headless", "--metrics"];
    let output = program().args(run).arg(&address).output().expect("ends");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let expected = format!("hulltouch: --metrics: cannot listen on {address}: Address already in use");
    assert!(output.status.code() == Some(2) && said.contains(&expected), "{said}");
}

#[test]
fn everything_on_the_dashboard_and_in_the_rules_gives_a_series() {
    if !testkit::has_program("prometheus", "prometheus") {
        return;
    }
    let observe = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/observe");
    for (what, file) in [("rules", "rules.yml"), ("config", "prometheus.yml")] {
        let checked = testkit::command("promtool").args(["check", what]).arg(observe.join(file)).output();
        let checked = checked.expect("promtool comes with prometheus");
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    }
    let room = Room::new();
    room.services().into_iter().for_each(|service| drop(service.await_ready(200)));
    let targets = room.services().map(|service| service.metrics.to_string());
    let prometheus = Prometheus::start(room.folder.path(), &targets, &observe.join("rules.yml"));
    let dashboard = fs::read_to_string(observe.join("dashboard.json")).expect("a dashboard");
    let dashboard: serde_json::Value = serde_json::from_str(&dashboard).expect("JSON");
    let of_dashboard = prometheus::expressions(&dashboard);
    let of_rules = prometheus.rules();
    assert!(of_dashboard.len() > 50 && of_rules.len() > 10, "{} and {}", of_dashboard.len(), of_rules.len());
    prometheus.await_series(&[of_dashboard, of_rules].concat(), TIMEOUT);
}
