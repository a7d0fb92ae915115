//! A peer that only holds the port open keeps no other out, and seats are kept for holders of the token.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::common::*;
use testkit::{Watch, timely};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite;

async fn connect_to(run: &Run) -> TcpStream {
    TcpStream::connect(run.feed.address()).await.expect("connects")
}

/// What comes until the server ends the connection.
async fn rest(stream: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    // One that gave way while it sent is reset.
    let _ = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut bytes)).await.expect("in time");
    String::from_utf8_lossy(&bytes).into_owned()
}

async fn answer(run: &Run, request: &str) -> String {
    let mut stream = connect_to(run).await;
    stream.write_all(request.as_bytes()).await.expect("sent");
    rest(&mut stream).await
}

fn get(run: &Run, more: &str) -> String {
    format!("GET / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{more}\r\n", run.feed.address())
}

/// Both ends are in this process: a thousand, the usual limit, would not do.
fn allow_descriptors() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let wanted = limit.maximum.map_or(4096, |most| most.min(4096));
    if limit.current.is_some_and(|now| now < wanted) {
        setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), ..limit }).expect("set");
    }
}

#[tokio::test]
async fn nine_hundred_half_sent_headers_keep_no_peer_out() {
    let watch = Watch::start();
    allow_descriptors();
    let run = Run::start();
    let mut page = run.viewer().await;
    page.hear_op("hello").await;
    let mut half_sent = Vec::new();
    for _ in 0..900 {
        let mut stream = connect_to(&run).await;
        // It may have given way already.
        let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nX-More: ").await;
        half_sent.push(stream);
        if half_sent.len() % 100 == 0 {
            let frame = half_sent.len() as u64;
            run.publish(frame);
            page.hear_frame(frame).await;
            assert!(answer(&run, &get(&run, "")).await.starts_with("HTTP/1.1 200"), "after {frame}");
            run.viewer().await.hear_op("hello").await;
        }
    }
    // Those that gave way to none are dropped for their silence.
    let began = Instant::now();
    for mut stream in half_sent {
        assert_eq!(rest(&mut stream).await, "");
    }
    let took = began.elapsed();
    timely!(watch, took < Duration::from_secs(30), "dropped after {took:?}");
    run.publish(1000);
    page.hear_frame(1000).await;
}

#[tokio::test]
async fn a_byte_a_second_is_dropped_after_five_seconds() {
    let run = Run::start();
    let (mut reading, mut writing) = connect_to(&run).await.into_split();
    let began = Instant::now();
    let dribble = async {
        for byte in get(&run, "").bytes().cycle() {
            if writing.write_all(&[byte]).await.is_err() {
                return;
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    };
    let dropped = async {
        let mut bytes = Vec::new();
        let _ = reading.read_to_end(&mut bytes).await;
        bytes
    };
    let bytes = tokio::select! {
        bytes = dropped => bytes,
        () = dribble => Vec::new(),
        () = tokio::time::sleep(TIMEOUT) => panic!("not dropped"),
    };
    assert!(bytes.is_empty(), "{}", String::from_utf8_lossy(&bytes));
    assert!(began.elapsed() > Duration::from_secs(4), "dropped after {:?}", began.elapsed());
}

#[tokio::test]
async fn a_head_of_more_than_eight_kilobytes_is_refused() {
    let run = Run::start();
    let long = |bytes: usize| get(&run, &format!("X-Long: {}\r\n", "x".repeat(bytes)));
    assert!(answer(&run, &long(7000)).await.starts_with("HTTP/1.1 200"));
    assert!(answer(&run, &long(9000)).await.starts_with("HTTP/1.1 431"));
}

#[tokio::test]
async fn other_protocols_are_told_or_dropped_at_once() {
    let watch = Watch::start();
    let run = Run::start();
    let began = Instant::now();
    assert!(answer(&run, "SSH-2.0-OpenSSH_9.2p1 Debian\r\n\r\n").await.starts_with("HTTP/1.1 400"));
    assert_eq!(answer(&run, "\u{16}\u{3}\u{1}\u{2}\u{0}\u{1}").await, "", "TLS on a plain port");
    let took = began.elapsed();
    timely!(watch, took < Duration::from_secs(4), "answered after {took:?}");
}

/// The status and text of a refusal.
fn refusal<T>(asked: Result<T, tungstenite::Error>) -> (u16, String) {
    match asked {
        Err(tungstenite::Error::Http(response)) => {
            let text = response.body().as_deref().unwrap_or_default();
            (response.status().as_u16(), String::from_utf8_lossy(text).into_owned())
        }
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("got in"),
    }
}

#[tokio::test]
async fn seats_of_pages_are_kept_for_holders_of_the_token() {
    let run = Run::start();
    let url = format!("ws://{}/feed", run.feed.address());
    // Pages that do not answer are dropped after a while.
    let look = async |mut page: Page| {
        let hello = page.hear_op("hello").await;
        let looks = tokio::spawn(async move { while !matches!(page.hear().await, Heard::Close(_)) {} });
        (hello["controller"] == true, looks)
    };
    let mut looking = Vec::new();
    for _ in 0..56 {
        looking.push(look(run.viewer().await).await);
    }
    for token in [None, Some("not-the-token")] {
        let full = (503, "56 pages look already, expected fewer\n".to_owned());
        assert_eq!(refusal(connect(&url, token).await), full);
    }
    for _ in 0..8 {
        looking.push(look(run.controller().await).await);
        assert!(looking.last().is_some_and(|(may_steer, _)| *may_steer));
    }
    let full = (503, "64 pages look already, expected fewer\n".to_owned());
    assert_eq!(refusal(connect(&url, Some(TOKEN)).await), full);
    looking.pop().expect("a page").1.abort();
    until("a seat is free", || run.feed.pages() < 64).await;
    assert_eq!(refusal(connect(&url, None).await).0, 503, "it is a holder's");
    run.controller().await.hear_op("hello").await;
}

#[tokio::test]
async fn seats_of_programs_are_kept_for_holders_of_the_token() {
    let run = Run::start();
    run.publish(1);
    let url = |more: &str| format!("ws://{}/state?rate=1{more}", run.feed.address());
    let mut sockets = Vec::new();
    for _ in 0..56 {
        sockets.push(tokio_tungstenite::connect_async(url("")).await.expect("a seat"));
    }
    let full = (503, "56 programs follow already, expected fewer\n".to_owned());
    assert_eq!(refusal(tokio_tungstenite::connect_async(url("")).await), full);
    let holder = url(&format!("&token={TOKEN}"));
    sockets.push(tokio_tungstenite::connect_async(holder).await.expect("a seat that is kept"));
}

/// A peer with a slow link: its receive buffer is small, and it reads a little at a time.
async fn slow_load(run: &Run, path: &str, pause: Duration) -> usize {
    let socket = tokio::net::TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(16 << 10).expect("set");
    let mut stream = socket.connect(run.feed.address()).await.expect("connects");
    let request = get(run, "").replacen("GET /", &format!("GET {path}"), 1);
    stream.write_all(request.as_bytes()).await.expect("sent");
    let (mut bytes, mut part) = (0, vec![0; 16 << 10]);
    loop {
        match tokio::time::timeout(TIMEOUT, stream.read(&mut part)).await.expect("in time") {
            Ok(0) | Err(_) => return bytes,
            Ok(read) => bytes += read,
        }
        tokio::time::sleep(pause).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn small_requests_cut_no_load_that_is_under_way() {
    let run = Arc::new(Run::start());
    let page = answer(&run, &get(&run, "")).await;
    let asset = page.split('"').find(|part| part.starts_with("./assets/") && part.ends_with(".js"));
    let path = asset.expect("a script").trim_start_matches("./").to_owned();
    let path = format!("/{path}");
    let whole = slow_load(&run, &path, Duration::ZERO).await;
    // A hundred and fifty a second, each over its own connection, which stays open.
    let flood = tokio::spawn({
        let run = Arc::clone(&run);
        async move {
            let mut open = std::collections::VecDeque::new();
            let request = format!("GET /nothing HTTP/1.1\r\nHost: {}\r\n\r\n", run.feed.address());
            for count in 0u64.. {
                let mut stream = connect_to(&run).await;
                let _ = stream.write_all(request.as_bytes()).await;
                open.push_back(stream);
                if open.len() > 200 {
                    open.pop_front();
                }
                if count % 3 == 0 {
                    tokio::time::sleep(Duration::from_millis(20)).await;
                }
            }
        }
    });
    let loads = (0..6).map(|_| slow_load(&run, &path, Duration::from_millis(16)));
    let loaded = futures::future::join_all(loads).await;
    flood.abort();
    assert_eq!(loaded, [whole; 6], "of {whole} bytes");
}
