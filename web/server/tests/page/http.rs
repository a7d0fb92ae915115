//! The page's files, and who is let in.

use crate::common::*;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

/// The head and body of an answer.
async fn ask(run: &Run, request: &str) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(run.feed.address()).await.expect("connects");
    stream.write_all(request.replace('\n', "\r\n").as_bytes()).await.expect("sent");
    let mut answer = Vec::new();
    tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut answer)).await.expect("in time").expect("read");
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("a head") + 4;
    (String::from_utf8_lossy(&answer[..end]).to_lowercase(), answer[end..].to_vec())
}

async fn get(run: &Run, path: &str, headers: &str) -> (String, Vec<u8>) {
    let host = run.feed.address();
    ask(run, &format!("GET {path} HTTP/1.1\nHost: {host}\nConnection: close\n{headers}\n")).await
}

#[tokio::test]
async fn the_page_is_served_fresh_and_its_assets_for_ever() {
    let run = Run::start();
    let (head, page) = get(&run, "/", "").await;
    assert!(head.starts_with("http/1.1 200") && head.contains("content-type: text/html"), "{head}");
    assert!(head.contains("cache-control: no-cache"), "{head}");
    let page = String::from_utf8(page).expect("text");
    let tag = head.lines().find_map(|line| line.strip_prefix("etag: ")).expect("a tag");
    let (again, body) = get(&run, "/?token=whatever", &format!("If-None-Match: {tag}\n")).await;
    assert!(again.starts_with("http/1.1 304") && body.is_empty(), "{again}");

    let asset = page.split('"').find(|part| part.starts_with("./assets/")).expect("a script");
    let (head, script) = get(&run, asset.trim_start_matches('.'), "").await;
    assert!(head.starts_with("http/1.1 200") && head.contains("immutable"), "{head}");
    assert!(head.contains("text/javascript") || head.contains("text/css"), "{head}");
    assert!(script.len() > 1000);
    for missing in ["/assets/nothing.js", "/../Cargo.toml", "/%2e%2e/Cargo.toml"] {
        assert!(get(&run, missing, "").await.0.starts_with("http/1.1 404"), "{missing}");
    }
}

#[tokio::test]
async fn files_come_compressed_as_the_browser_takes_them() {
    let run = Run::start();
    let (head, plain) = get(&run, "/", "").await;
    assert!(!head.contains("content-encoding") && head.contains("vary: accept-encoding"), "{head}");
    let tag = |head: &str| head.lines().find(|line| line.starts_with("etag: ")).map(str::to_owned);
    let mut tags = vec![tag(&head)];
    for (takes, encoding) in [
        ("br", "br"),
        ("gzip, deflate, br", "br"),
        ("GZIP;q=0.5", "gzip"),
        ("br;q=0, gzip", "gzip"),
        ("deflate\nAccept-Encoding: gzip", "gzip"),
    ] {
        let (head, body) = get(&run, "/", &format!("Accept-Encoding: {takes}\n")).await;
        assert!(head.contains(&format!("content-encoding: {encoding}\r\n")), "{takes}: {head}");
        assert!(head.contains("content-type: text/html") && 2 * body.len() < plain.len(), "{takes}: {head}");
        tags.push(tag(&head));
    }
    tags.sort();
    tags.dedup();
    assert_eq!(tags.len(), 3, "each form has its own tag: {tags:?}");
    for takes in ["identity", "br;q=0", "brr", "", "*;q=0"] {
        let (head, body) = get(&run, "/", &format!("Accept-Encoding: {takes}\n")).await;
        assert!(!head.contains("content-encoding") && body == plain, "{takes}: {head}");
    }
}

#[tokio::test]
async fn what_a_browser_asks_for_another_site_is_refused() {
    let run = Run::start();
    let port = run.feed.address().port();
    let rebound = format!("GET / HTTP/1.1\nHost: evil.example:{port}\nConnection: close\n\n");
    assert!(ask(&run, &rebound).await.0.starts_with("http/1.1 403"));
    let socket = "Upgrade: websocket\nConnection: Upgrade\nSec-WebSocket-Version: 13\n\
        Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\n";
    let foreign = format!(
        "GET /feed HTTP/1.1\nHost: 127.0.0.1:{port}\nOrigin: https://evil.example\nConnection: close\n{socket}\n"
    );
    assert!(ask(&run, &foreign).await.0.starts_with("http/1.1 403"));
    assert_eq!(run.feed.pages(), 0);
}
