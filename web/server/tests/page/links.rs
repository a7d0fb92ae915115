//! Pages that read slowly or not at all, and the others beside them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::common::*;
use futures::{SinkExt as _, StreamExt as _};
use serde_json::json;
use testkit::{Watch, timely};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio_tungstenite::tungstenite::Message;

/// Publishes thirty frames a second until dropped.
struct Film(Arc<AtomicBool>);

impl Film {
    fn roll(run: Arc<Run>) -> Film {
        let rolls = Arc::new(AtomicBool::new(true));
        let goes_on = Arc::clone(&rolls);
        tokio::spawn(async move {
            let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / FPS));
            for frame in 1.. {
                ticks.tick().await;
                if !goes_on.load(Ordering::SeqCst) {
                    break;
                }
                run.publish(frame);
            }
        });
        Film(rolls)
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        self.0.store(false, Ordering::SeqCst);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_page_that_stops_reading_is_dropped_and_the_others_get_every_frame() {
    let run = Arc::new(Run::start());
    let stopped = connect(&format!("ws://{}/feed", run.feed.address()), None).await.expect("connects");
    let shown: Arc<Vec<AtomicU64>> = Arc::new((0..9).map(|_| AtomicU64::new(0)).collect());
    let mut readers = Vec::new();
    for reader in 0..9 {
        let (mut page, shown) = (run.viewer().await, Arc::clone(&shown));
        readers.push(tokio::spawn(async move {
            loop {
                let frame = frame_of(&page.hear_kind(1).await);
                let before = shown[reader].swap(frame, Ordering::SeqCst);
                assert!(before == 0 || frame == before + 1, "frame {frame} after {before}");
            }
        }));
    }
    until("all pages are there", || run.feed.pages() == 10).await;
    let mut frame = 0;
    let deadline = tokio::time::Instant::now() + TIMEOUT;
    while run.feed.pages() == 10 {
        assert!(tokio::time::Instant::now() < deadline, "a page that reads nothing is dropped");
        frame += 1;
        run.publish(frame);
        let all_have_it = || shown.iter().all(|shown| shown.load(Ordering::SeqCst) == frame);
        until("every page that reads gets every frame", all_have_it).await;
    }
    assert_eq!(run.feed.pages(), 9);
    assert!(readers.iter().all(|reader| !reader.is_finished()));
    assert_eq!(run.studio.asked().len() as u64, frame, "each frame was made once for all of them");
    drop(stopped);
}

/// A browser that draws in software reads late, and goes on speaking meanwhile.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_page_that_reads_late_and_still_speaks_is_told_that_the_run_has_ended() {
    let watch = Watch::start();
    let run = Run::start();
    let socket = TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(4 << 10).expect("set");
    let stream = socket.connect(run.feed.address()).await.expect("connects");
    let feed = request(&format!("ws://{}/feed", run.feed.address()), None);
    let (mut page, _) = tokio_tungstenite::client_async(feed, stream).await.expect("a page");
    // More than its system takes for it.
    run.publish(1);
    until("a frame set is made", || run.studio.asked().len() == 1).await;
    let ended = tokio::task::spawn_blocking(move || drop(run));
    tokio::time::sleep(Duration::from_millis(200)).await;
    let mut heard = Vec::new();
    loop {
        // It may have been refused already: what was sent before counts.
        let _ = page.send(Message::text(json!({"op": "want", "fps": 10}).to_string())).await;
        match page.next().await {
            Some(Ok(Message::Text(text))) => heard.push(text.to_string()),
            Some(Ok(Message::Close(_))) | None => break,
            Some(Ok(_)) => {}
            Some(Err(error)) => {
                heard.push(format!("not its end: {error}"));
                break;
            }
        }
    }
    let last = heard.last().cloned().unwrap_or_default();
    drop(page);
    timely!(watch, last.contains("the run has ended"), "the page heard last: {last}");
    ended.await.expect("no panic");
}

/// A proxy that lets so many bytes a second through from the server.
async fn narrow(to: std::net::SocketAddr, bytes_per_s: usize) -> std::net::SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("listens");
    let address = listener.local_addr().expect("bound");
    tokio::spawn(async move {
        let (page, _) = listener.accept().await.expect("a page");
        let server = TcpStream::connect(to).await.expect("the server");
        // What queues on the way is what a home router queues.
        socket2::SockRef::from(&server).set_recv_buffer_size(32 << 10).expect("set");
        let (mut from_page, mut to_page) = page.into_split();
        let (mut from_server, mut to_server) = server.into_split();
        tokio::spawn(async move { tokio::io::copy(&mut from_page, &mut to_server).await });
        let mut buffer = vec![0; bytes_per_s / 50];
        let mut ticks = tokio::time::interval(Duration::from_millis(20));
        loop {
            ticks.tick().await;
            match from_server.read(&mut buffer).await {
                Ok(0) | Err(_) => return,
                Ok(read) => {
                    if to_page.write_all(&buffer[..read]).await.is_err() {
                        return;
                    }
                }
            }
        }
    });
    address
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_page_on_a_narrow_link_gets_fewer_and_smaller_frames_and_none_is_old() {
    let run = Arc::new(Run::start());
    // A megabit a second. Full frame sets make 82 KB, two thirds of a second each.
    let address = narrow(run.feed.address(), 125_000).await;
    let mut page = Page::open(&format!("ws://{address}/feed")).await;
    let mut beside = run.viewer().await;
    let film = Film::roll(Arc::clone(&run));
    let beside = tokio::spawn(async move {
        let (mut frames, mut tier) = (0, String::new());
        while frames < 90 {
            match beside.hear().await {
                Heard::Binary(bytes) if bytes[4] == 1 => frames += 1,
                Heard::Text(text) if text["op"] == "status" => tier = text["feed"]["tier"].to_string(),
                Heard::Close(why) => panic!("dropped: {why:?}"),
                _ => {}
            }
        }
        tier
    });
    let mut behind = 0;
    loop {
        match page.hear().await {
            Heard::Binary(bytes) if bytes[4] == 1 => {
                behind = behind.max(run.studio.newest.load(Ordering::SeqCst) - frame_of(&bytes));
            }
            Heard::Text(text) if text["op"] == "status" && text["feed"]["tier"] == json!("half") => {
                assert!(text["feed"]["dropped"].as_u64() > Some(0), "{text}");
                break;
            }
            Heard::Close(why) => panic!("a slow page was dropped: {why:?}"),
            _ => {}
        }
    }
    // One frame set on the way and some worlds, 32 KB at the router: not a second, and a busy machine.
    assert!(behind < 45, "a frame came {behind} frames after it was new");
    while page.hear_kind(1).await[48 + 3] != 1 {}
    assert_eq!(beside.await.expect("no panic"), "\"full\"", "the page beside it has a link of its own");
    drop(film);
}
