//! Text of pages and programs comes back as one short line without control characters, and a flood of pings ends.

use std::net::SocketAddr;

use crate::common::*;
use futures::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use testkit::{Watch, timely};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;

/// Escape sequences, a forged line, a mark that reverses text, and 40 KB.
fn hostile() -> String {
    format!("\u{1b}[2J\u{1b}]0;title\u{7}\r\nERROR a forged line \u{202e}{}", "x".repeat(40_000))
}

#[track_caller]
fn is_clean(why: &Value) {
    let why = why.as_str().expect("a text");
    assert!(why.chars().count() <= 301, "{} characters", why.chars().count());
    let is_bad = |character: char| character.is_control() || character == '\u{202e}';
    assert!(!why.contains(is_bad), "{why:?}");
}

#[tokio::test]
async fn what_a_page_sends_comes_back_short_and_clean() {
    let run = Run::start();
    let mut page = run.controller().await;
    let command = |fields: Value| {
        let mut message = json!({"op": "command", "id": 1});
        let (Some(message_fields), Value::Object(fields)) = (message.as_object_mut(), fields) else {
            panic!()
        };
        message_fields.extend(fields);
        message
    };
    let ball = json!({"ball": {"radius": 0.1}});
    for fields in [
        json!({"command": hostile()}),
        json!({"command": "choose", "scene": hostile()}),
        json!({"command": "remove", "body": hostile()}),
        json!({"command": "pause", hostile(): 1}),
        json!({"command": "spawn", "position": [0, 1, 0], "shape": ball, "name": hostile()}),
        json!({"command": "spawn", "position": [0, 1, 0], "shape": {hostile(): {}}}),
        json!({"command": "spawn", "position": [0, 1, 0], "shape": ball, hostile(): 1}),
    ] {
        page.say(command(fields)).await;
        is_clean(&page.hear_op("refused").await["why"]);
    }
    page.say(json!({"op": "want", "image_of": hostile()})).await;
    is_clean(&page.hear_op("bye").await["why"]);
    assert!(run.ordered.lock().expect("whole").is_empty());
}

#[tokio::test]
async fn what_a_program_sends_comes_back_short_and_clean() {
    let run = Run::start();
    let url = format!("ws://{}/state", run.feed.address());
    let (mut program, _) = tokio_tungstenite::connect_async(url).await.expect("connects");
    for text in [hostile(), json!([hostile()]).to_string()] {
        program.send(Message::text(text)).await.expect("sent");
        let answer = tokio::time::timeout(TIMEOUT, program.next()).await.expect("in time");
        let answer = answer.expect("an answer").expect("a message").into_text().expect("a text");
        let answer: Value = serde_json::from_str(&answer).expect("JSON");
        assert_eq!(answer["op"], "refused");
        is_clean(&answer["why"]);
    }
}

/// Opens a WebSocket by hand, sends the head of a message of 8 MB and half a megabyte of it, and reads to the end.
async fn told_to_one_that_sends_too_much(address: SocketAddr, path: &str) -> std::io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(address).await?;
    let key = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: aGVsbG8gaHVsbHRvdWNoIQ==";
    let upgrade = format!("Host: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n{key}");
    stream.write_all(format!("GET {path} HTTP/1.1\r\n{upgrade}\r\n\r\n").as_bytes()).await?;
    let head = [0x81, 0x80 | 127, 0, 0, 0, 0, 0, 0x80, 0, 0, 1, 2, 3, 4];
    stream.write_all(&head).await?;
    stream.write_all(&vec![b'x'; 512 << 10]).await?;
    stream.shutdown().await?;
    let mut told = Vec::new();
    stream.read_to_end(&mut told).await?;
    Ok(told)
}

#[tokio::test]
async fn a_message_that_is_too_long_is_answered_though_more_of_it_is_on_its_way() {
    let run = Run::start();
    let address = run.feed.address();
    let watch = Watch::start();
    for (path, expected) in [("/feed", r#""op":"bye""#), ("/state", r#""op":"refused""#)] {
        let told = told_to_one_that_sends_too_much(address, path).await;
        timely!(watch, told.is_ok(), "{path}: {told:?}");
        let told = String::from_utf8_lossy(told.as_deref().unwrap_or_default()).into_owned();
        assert!(told.contains(expected) && told.contains("no message: "), "{path}: {told}");
    }
}

/// Pings, sent until the server has closed the connection; none of its answers is read.
async fn flooded(url: String) -> usize {
    let (socket, _) = tokio_tungstenite::connect_async(url).await.expect("connects");
    let (mut sink, _stream) = socket.split();
    let mut bytes = 0;
    while bytes < 64 << 20 {
        let ping = Message::Ping(vec![0; 125].into());
        let sent = tokio::time::timeout(TIMEOUT, sink.send(ping)).await;
        if !sent.is_ok_and(|sent| sent.is_ok()) {
            break;
        }
        bytes += 125;
    }
    bytes
}

#[tokio::test]
async fn a_peer_that_pings_without_end_is_dropped_before_its_answers_fill_memory() {
    let run = Run::start();
    for address in ["feed", "state"] {
        let url = format!("ws://{}/{address}", run.feed.address());
        let bytes = flooded(url).await;
        assert!(bytes < 16 << 20, "{address} took pings of {bytes} bytes");
    }
    run.viewer().await;
}
