//! The page's port as operators have it: its token, its certificate, and what untrusted peers do to it.

use std::fs::{self, File};
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use net::{AUTHORITIES, Authority, CERTIFICATE, Credentials, Identity, KEY, Validity};

use crate::namespace::Host;
use crate::room::{Node, Running, named_room, program};
use futures::StreamExt as _;
use rustix::process::{Pid, Resource, Rlimit, Signal, getrlimit, kill_process, prlimit};
use serde_json::Value;

const TIMEOUT: Duration = Duration::from_secs(100);
const TOKEN: &str = "a-token-for-tests";

/// A program that serves a page, and what it says.
struct Run {
    running: Running,
    said: PathBuf,
    address: SocketAddr,
}

impl Run {
    /// Starts it, and waits until it has said where its page and its token are.
    fn start(command: &mut Command, folder: &Path, scheme: &'static str) -> Run {
        let said = folder.join("said");
        let file = File::create(&said).expect("created");
        command.stdin(Stdio::null()).stdout(file.try_clone().expect("again")).stderr(file);
        let mut run = Run { running: Running::start(command), said, address: SocketAddr::from(([0; 4], 0)) };
        let line = run.line("token: ");
        assert!(!line.is_empty(), "{line}");
        let page = run.line("page: ");
        let address = page.strip_prefix(scheme).and_then(|rest| rest.strip_prefix("://")?.strip_suffix('/'));
        let address = address.and_then(|address| address.parse().ok());
        run.address = address.unwrap_or_else(|| panic!("found {page:?}"));
        run
    }

    fn demo(folder: &Path) -> Run {
        let mut command = program();
        command.args(["demo", "--cameras", "2", "--size", "96x72", "--seconds", "600", "--headless"]);
        command.args(["--listen", "127.0.0.1:0"]).env("HULLTOUCH_TOKEN", TOKEN);
        Run::start(&mut command, folder, "http")
    }

    fn said(&self) -> String {
        fs::read_to_string(&self.said).expect("text")
    }

    /// The rest of the first line that begins so.
    fn line(&self, prefix: &str) -> String {
        let began = Instant::now();
        loop {
            let said = self.said();
            let whole = said.rsplit_once('\n').map_or("", |(whole, _)| whole);
            if let Some(rest) = whole.lines().find_map(|line| line.strip_prefix(prefix)) {
                return rest.to_owned();
            }
            assert!(began.elapsed() < TIMEOUT, "no {prefix:?} in {said:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until it has said something.
    fn says(&self, what: &str) {
        let began = Instant::now();
        while !self.said().contains(what) {
            assert!(began.elapsed() < TIMEOUT, "no {what:?} in {:?}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).expect("connects");
        stream.set_read_timeout(Some(TIMEOUT)).expect("set");
        stream
    }

    fn answer(&self, request: &str) -> String {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answer = Vec::new();
        // A connection that is refused may be reset.
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn index(&self) -> String {
        self.answer(&format!("GET / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.address))
    }

    /// What a page is greeted with.
    async fn hello(&self, token: &str) -> Value {
        use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
        let url = format!("ws://{}/feed", self.address);
        let mut request = url.into_client_request().expect("an address");
        let protocols = format!("hulltouch.feed.v1, hulltouch.token.{token}").parse().expect("a value");
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
        let (mut socket, _) = tokio_tungstenite::connect_async(request).await.expect("connects");
        let message = tokio::time::timeout(TIMEOUT, socket.next()).await.expect("in time");
        let text = message.expect("open").expect("a message").into_text().expect("text");
        serde_json::from_str(&text).expect("JSON")
    }

    /// Ends it as an operator does, and returns all that it said.
    fn end(mut self) -> String {
        kill_process(Pid::from_child(self.running.child()), Signal::TERM).expect("sent");
        let status = self.running.child().wait().expect("ends");
        assert!(status.success(), "{status}: {}", self.said());
        self.said()
    }
}

fn private_file(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("token");
    fs::write(&path, text).expect("written");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("set");
    path
}

#[tokio::test]
async fn a_token_of_a_file_steers_and_is_never_written_where_it_is_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = private_file(folder.path(), "the-token-of-a-file\n");
    let mut command = program();
    command.args(["demo", "--cameras", "2", "--size", "96x72", "--seconds", "600", "--headless"]);
    command.args(["--listen", "127.0.0.1:0", "--token-file"]).arg(&path).env("RUST_LOG", "debug");
    let run = Run::start(command.env("HULLTOUCH_TOKEN", TOKEN), folder.path(), "http");
    assert_eq!(run.line("token: "), format!("that of {}", path.display()));
    assert_eq!(run.hello("the-token-of-a-file").await["controller"], true);
    assert_eq!(run.hello(TOKEN).await["controller"], false, "the file goes before the environment");
    assert_eq!(run.hello("").await["insecure"], Value::Null);
    let said = run.end();
    assert!(!said.contains("the-token-of-a-file") && !said.contains(TOKEN), "{said}");
}

#[test]
fn a_token_that_cannot_be_used_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |file: Option<&Path>, variable: &str| {
        let mut command = program();
        command.args(["demo", "--listen", "127.0.0.1:0"]).env("HULLTOUCH_TOKEN", variable);
        let output = command.args(file.iter().flat_map(|file| [Path::new("--token-file"), *file])).output();
        let output = output.expect("starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{said}");
        said
    };
    let expected = "expected 12 to 128 letters, digits or any of -_.~";
    let said = refused(None, "a b c d e f");
    assert!(said.contains(&format!("HULLTOUCH_TOKEN is a token of 11 bytes, {expected}")), "{said}");
    assert!(!said.contains("a b c"), "{said}");
    let path = private_file(folder.path(), "");
    let said = refused(Some(&path), TOKEN);
    assert!(said.contains(&format!("{} is a token of 0 bytes, {expected}", path.display())), "{said}");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("set");
    let said = refused(Some(&path), TOKEN);
    assert!(said.contains("it has mode 0644: others may read it, expected 0600 or 0640"), "{said}");
}

#[test]
fn a_page_for_other_machines_is_refused_without_encryption_or_consent() {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "address = \"unix:l.sock\"", "address = \"unix:r.sock\"");
    for (command, expected) in [
        (&["demo"][..], "expected --origin (a proxy"),
        (&["coordinator", cluster.to_str().expect("a path")], "expected --certs, --origin (a proxy"),
    ] {
        let output = program().args(command).args(["--listen", "192.0.2.1:0"]).output().expect("starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!((output.status.code(), said.lines().count()), (Some(2), 1), "{said}");
        assert!(said.contains("reachable from other machines") && said.contains(expected), "{said}");
    }
}

#[test]
fn untrusted_peers_are_logged_once_a_second_and_what_is_refused_is_told_apart() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = Run::demo(folder.path());
    assert_eq!(run.line("token: "), "that of HULLTOUCH_TOKEN");
    let began = Instant::now();
    // Several within one second, and one after it.
    while !run.said().contains("more since the line before)") {
        assert!(began.elapsed() < TIMEOUT, "{}", run.said());
        assert_eq!(run.answer("\u{16}\u{3}\u{1}\u{2}\u{0}\u{1}"), "");
    }
    let line = "the page: a connection from 127.0.0.1 was refused: it speaks TLS, and this port speaks plain HTTP: \
                expected http://";
    run.says(line);
    assert!(run.index().starts_with("HTTP/1.1 200"));
    let said = run.end();
    let lines = said.lines().filter(|said| said.contains(line)).count() as u64;
    assert!((2..began.elapsed().as_secs() + 3).contains(&lines), "{lines} lines: {said}");
}

#[tokio::test]
async fn a_port_without_descriptors_pauses_and_the_run_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = Run::demo(folder.path());
    let process = Pid::from_raw(run.running.id().cast_signed()).expect("a number");
    let open = fs::read_dir(format!("/proc/{}/fd", run.running.id())).expect("listed").count() as u64;
    let limit = Rlimit { current: Some(open + 16), ..getrlimit(Resource::Nofile) };
    let before = prlimit(Some(process), Resource::Nofile, limit).expect("set");
    let silent: Vec<TcpStream> = (0..60).map(|_| run.connect()).collect();
    run.says("cannot accept it: Too many open files");
    // The silent ones are dropped, and who asks is answered.
    assert!(run.index().starts_with("HTTP/1.1 200"));
    drop(silent);
    prlimit(Some(process), Resource::Nofile, before).expect("set");
    assert_eq!(run.hello(TOKEN).await["controller"], true);
    let said = run.end();
    assert!(!said.contains("hulltouch: "), "{said}");
}

/// Writes the certificates of an owner into a folder.
fn issue(folder: &Path, authority: &Authority, owner: &Identity) {
    let issued = authority.issue(owner, &[], Validity::days(30), None).expect("issued");
    fs::create_dir_all(folder).expect("a folder");
    fs::write(folder.join(AUTHORITIES), authority.certificate()).expect("written");
    fs::write(folder.join(CERTIFICATE), &issued.certificate).expect("written");
    fs::write(folder.join(KEY), &issued.key).expect("written");
    fs::set_permissions(folder.join(KEY), fs::Permissions::from_mode(0o600)).expect("set");
}

/// A coordinator on a host of its own, whose page others may reach.
struct Open {
    folder: tempfile::TempDir,
    cluster: PathBuf,
    _nodes: [Node; 2],
    host: Host,
}

impl Open {
    /// `None`, and says why, on a machine that makes no hosts.
    fn new() -> Option<Open> {
        let host = Host::new(100);
        let host =
            host.inspect_err(|why| testkit::skip(format_args!("no network namespaces: {why}"))).ok()?;
        let folder = tempfile::tempdir().expect("a folder");
        let cluster = named_room(folder.path(), "address = \"unix:l.sock\"", "address = \"unix:r.sock\"");
        let nodes = ["left", "right"].map(|name| Node::start_named(program(), &cluster, name));
        Some(Open { folder, cluster, _nodes: nodes, host })
    }

    fn coordinator(&self, scheme: &'static str, more: &[&str]) -> Run {
        let mut command = self.host.command(&program());
        command.arg("coordinator").arg(&self.cluster).args(["--headless", "--seconds", "600", "--listen"]);
        command.arg(format!("{}:0", self.host.address)).args(more).current_dir(self.folder.path());
        Run::start(command.env("HULLTOUCH_TOKEN", TOKEN), self.folder.path(), scheme)
    }
}

#[tokio::test]
async fn a_coordinator_with_certificates_shows_its_page_by_https() {
    let Some(room) = Open::new() else { return };
    let authority = Authority::make("room", Validity::days(30)).expect("an authority");
    let (coordinator, viewer) = (Identity::coordinator("room"), Identity::viewer("room"));
    issue(&room.folder.path().join("certs"), &authority, &coordinator);
    issue(&room.folder.path().join("viewer"), &authority, &viewer);
    let run = room.coordinator("https", &["--certs", "certs"]);
    assert!(run.index().ends_with("this port speaks HTTPS, expected https://\n"));
    let mine = Credentials::open(&room.folder.path().join("viewer"), viewer).expect("valid");
    let socket = tokio::net::TcpStream::connect(run.address).await.expect("connects");
    let shown = Arc::new(mine).connect(socket, &coordinator).await;
    assert!(shown.is_ok(), "{:?}", shown.err());
    run.says("it does not speak TLS, and this port speaks HTTPS: expected https://");
    let said = run.end();
    assert!(!said.contains("--insecure"), "{said}");
}

#[tokio::test]
async fn a_page_that_is_not_encrypted_says_so_in_the_log_and_to_those_who_look() {
    let Some(room) = Open::new() else { return };
    let run = room.coordinator("http", &["--insecure"]);
    let expected =
        "--insecure: this page is not encrypted, and anyone on the network path may read its token";
    assert_eq!(run.hello(TOKEN).await["insecure"], expected);
    assert!(run.end().contains(expected));
}
