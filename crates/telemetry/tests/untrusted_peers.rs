//! What untrusted peers can do to a port: nothing that keeps a scraper out.

use std::fmt;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use socket2::{Domain, Socket, Type};
use telemetry::{Buckets, Labels, Sheet, Telemetry, TelemetryPort};

/// A service that can be made to lack something, and to take its time to say so.
#[derive(Default)]
struct Service {
    lacks: AtomicBool,
    /// Whether it was asked what it lacks.
    is_asked: AtomicBool,
    /// Who holds it keeps the port's thread.
    gate: Mutex<()>,
}

impl Telemetry for Service {
    fn metrics(&self, sheet: &mut Sheet<'_>) -> fmt::Result {
        let camera = |name: &str| vec![("camera", name.to_owned())];
        sheet.gauge("frame_age_seconds", "Age.", [(camera("left"), 0.5), (camera("a \"b\"\n"), 1.0)])?;
        sheet.counter("frames", "Frames.", [(Labels::new(), 3.0)])?;
        sheet.counter("nothing", "Nothing.", [])?;
        let took = Buckets { sum: 1.5, buckets: vec![(0.1, 1), (f64::INFINITY, 2)] };
        sheet.histogram("took_seconds", "Time.", [(Labels::new(), took)])
    }

    fn stuck(&self) -> Option<String> {
        None
    }

    fn lacks(&self) -> Option<String> {
        self.is_asked.store(true, Ordering::Relaxed);
        let _open = self.gate.lock();
        self.lacks.load(Ordering::Relaxed).then(|| "a camera".to_owned())
    }
}

fn port() -> (TelemetryPort, Arc<Service>) {
    let service = Arc::new(Service::default());
    let telemetry: Arc<dyn Telemetry> = Arc::<Service>::clone(&service);
    let labels = [("room", "studio".to_owned())];
    let port = TelemetryPort::start(([127, 0, 0, 1], 0).into(), &labels, telemetry).expect("a port");
    (port, service)
}

fn connect(address: SocketAddr) -> TcpStream {
    let socket = TcpStream::connect(address).expect("connects");
    socket.set_read_timeout(Some(Duration::from_secs(60))).expect("set");
    socket
}

fn ask(address: SocketAddr, request: &str) -> TcpStream {
    let mut socket = connect(address);
    socket.write_all(request.as_bytes()).expect("sent");
    socket
}

/// Everything that comes after a request.
fn read(mut socket: TcpStream) -> String {
    let mut text = String::new();
    socket.read_to_string(&mut text).expect("an answer");
    text
}

fn answer(address: SocketAddr, request: &str) -> String {
    read(ask(address, request))
}

fn get(address: SocketAddr, path: &str) -> String {
    answer(address, &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n"))
}

#[test]
fn metrics_are_open_metrics_text() {
    let (port, _) = port();
    let text = get(port.address(), "/metrics");
    assert!(text.starts_with("HTTP/1.1 200 OK\r\n"), "{text}");
    assert!(
        text.contains("content-type: application/openmetrics-text; version=1.0.0; charset=utf-8\r\n"),
        "{text}"
    );
    for expected in [
        "# TYPE hulltouch_frame_age_seconds gauge\n# UNIT hulltouch_frame_age_seconds seconds\n",
        "hulltouch_frame_age_seconds{room=\"studio\",camera=\"left\"} 0.5\n",
        "hulltouch_frame_age_seconds{room=\"studio\",camera=\"a \\\"b\\\"\\n\"} 1.0\n",
        "hulltouch_frames_total{room=\"studio\"} 3.0\n",
        "hulltouch_took_seconds_count{room=\"studio\"} 3\n",
        "hulltouch_took_seconds_bucket{room=\"studio\",le=\"+Inf\"} 3\n",
        "hulltouch_ready{room=\"studio\"} 1.0\n",
    ] {
        assert!(text.contains(expected), "no {expected:?} in\n{text}");
    }
    assert!(!text.contains("nothing") && text.ends_with("\n# EOF\n"), "{text}");
}

#[test]
fn what_a_service_lacks_is_a_line_and_503() {
    let (port, service) = port();
    assert!(get(port.address(), "/ready").ends_with("\r\n\r\nready\n"));
    service.lacks.store(true, Ordering::Relaxed);
    let text = get(port.address(), "/ready");
    assert!(text.starts_with("HTTP/1.1 503 ") && text.ends_with("\r\n\r\na camera\n"), "{text}");
    assert!(get(port.address(), "/live").starts_with("HTTP/1.1 200 "));
    assert!(get(port.address(), "/metrics").contains("hulltouch_ready{room=\"studio\"} 0.0\n"));
}

#[test]
fn nothing_else_is_answered() {
    let (port, _) = port();
    assert!(get(port.address(), "/").starts_with("HTTP/1.1 404 "));
    let post = answer(port.address(), "POST /ready HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\n\r\n");
    assert!(post.starts_with("HTTP/1.1 405 "), "{post}");
    let head = "x".repeat(100_000);
    let mut socket = connect(port.address());
    // The port may close the socket before it has all.
    let _ = write!(socket, "GET /{head} HTTP/1.1\r\nHost: a\r\n\r\n");
    let mut text = Vec::new();
    let _ = socket.read_to_end(&mut text);
    let text = String::from_utf8_lossy(&text);
    assert!(text.is_empty() || text.starts_with("HTTP/1.1 4"), "{text}");
}

#[test]
fn hundreds_of_silent_connections_keep_no_peer_out() {
    let (port, _) = port();
    let silent: Vec<TcpStream> = (0..300).map(|_| connect(port.address())).collect();
    // Were the silent ones waited for, this would take ten times their timeout of 5 s, and more than a read's 20 s.
    assert!(get(port.address(), "/ready").starts_with("HTTP/1.1 200 "));
    let mut oldest = &silent[0];
    assert_eq!(oldest.read(&mut [0]).unwrap_or(0), 0, "the oldest gives way");
}

#[test]
fn a_flood_of_one_machine_evicts_no_connection_of_another() {
    let (port, _) = port();
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).expect("a socket");
    socket.bind(&SocketAddr::from(([127, 0, 0, 2], 0)).into()).expect("an address of loopback");
    socket.connect(&port.address().into()).expect("connects");
    let mut scraper = TcpStream::from(socket);
    let flood: Vec<TcpStream> = (0..300).map(|_| connect(port.address())).collect();
    scraper.write_all(b"GET /ready HTTP/1.1\r\nHost: a\r\n\r\n").expect("sent");
    let text = read(scraper);
    assert!(text.starts_with("HTTP/1.1 200 "), "{text:?}");
    drop(flood);
}

#[test]
fn a_question_before_a_burst_of_connections_is_answered() {
    const READY: &str = "GET /ready HTTP/1.1\r\nHost: a\r\n\r\n";
    let (port, service) = port();
    let gate = service.gate.lock().expect("whole");
    // While the port's thread is busy with this one, all others wait to be accepted.
    let first = ask(port.address(), READY);
    while !service.is_asked.load(Ordering::Relaxed) {
        std::thread::yield_now();
    }
    let asker = ask(port.address(), READY);
    let silent: Vec<TcpStream> = (0..100).map(|_| connect(port.address())).collect();
    drop(gate);
    for socket in [first, asker] {
        let text = read(socket);
        assert!(text.starts_with("HTTP/1.1 200 "), "{text:?}");
    }
    drop(silent);
}

#[test]
fn a_head_that_never_ends_is_given_up() {
    let (port, _) = port();
    let began = Instant::now();
    let mut socket = connect(port.address());
    socket.set_read_timeout(Some(Duration::from_secs(60))).expect("set");
    socket.write_all(b"GET /ready HTTP/1.1\r\nHost:").expect("sent");
    // It may be closed with or without a word.
    let closed = socket.read_to_end(&mut Vec::new());
    let error = closed.err().map(|error| error.kind());
    assert!(!matches!(error, Some(ErrorKind::WouldBlock | ErrorKind::TimedOut)), "it stays open");
    assert!(began.elapsed() > Duration::from_secs(3), "{:?}", began.elapsed());
}
