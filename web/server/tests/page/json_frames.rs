//! What a program may send over its socket besides a command: every message that is none is answered by a reason.

use crate::common::*;
use futures::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::protocol::frame::Frame;
use tokio_tungstenite::tungstenite::protocol::frame::coding::{Data, OpCode};

async fn program(run: &Run) -> Socket {
    let url = format!("ws://{}/state", run.feed.address());
    tokio_tungstenite::connect_async(url).await.expect("connects").0
}

/// The next message that is no pong.
async fn next(program: &mut Socket) -> Message {
    loop {
        let message = tokio::time::timeout(TIMEOUT, program.next()).await.expect("in time");
        match message.expect("an answer").expect("a message") {
            Message::Pong(_) => {}
            message => return message,
        }
    }
}

async fn answer(program: &mut Socket) -> Value {
    let text = next(program).await.into_text().expect("a text");
    serde_json::from_str(&text).expect("JSON")
}

fn frame(bytes: &[u8], kind: Data, is_last: bool) -> Message {
    Message::Frame(Frame::message(bytes.to_vec(), OpCode::Data(kind), is_last))
}

#[tokio::test]
async fn every_message_that_is_no_command_is_answered_by_a_reason_and_the_socket_stays_open() {
    let run = Run::start();
    let mut program = program(&run).await;
    for (message, expected) in [
        (
            Message::binary(vec![0; 12]),
            "a binary message of 12 bytes, expected a text message with one JSON object",
        ),
        (
            Message::binary(br#"{"op":"command"}"#.to_vec()),
            "a binary message of 16 bytes, expected a text message",
        ),
        (Message::binary(vec![]), "a binary message of 0 bytes, expected a text message"),
        (Message::text(""), "no JSON: EOF while parsing a value"),
        (Message::text("[1, 2]"), "message is [1,2], expected an object"),
        (Message::text("{} {}"), "no JSON: trailing characters"),
        (Message::text("[".repeat(60_000)), "no JSON: recursion limit exceeded"),
        (
            Message::text(r#"{"id":1,"id":2,"command":"pause"}"#),
            "message: key \"id\" stands twice, expected once",
        ),
        (Message::text(r#"{"op":"want","id":1,"command":"pause"}"#), "op is \"want\", expected \"command\""),
        (Message::text(r#"{"id":12.5,"command":"pause"}"#), "command.id is 12.5, expected a whole number"),
    ] {
        program.send(message.clone()).await.expect("sent");
        let refused = answer(&mut program).await;
        let why = refused["why"].as_str().expect("a text");
        assert!(refused["op"] == "refused" && why.starts_with(expected), "{message:?}: {refused}");
    }
    let number = json!({"op": "command", "id": 12.0, "command": "pause"}).to_string();
    let (first, rest) = number.as_bytes().split_at(9);
    program.send(frame(first, Data::Text, false)).await.expect("sent");
    program.send(Message::Ping(vec![7].into())).await.expect("sent between the parts");
    program.send(frame(rest, Data::Continue, true)).await.expect("sent");
    let refused = answer(&mut program).await;
    assert_eq!(refused["id"].to_string(), "12", "a command in two parts, its number a float: {refused}");
}

#[tokio::test]
async fn a_program_hears_why_its_socket_is_closed() {
    let run = Run::start();
    for (message, expected) in
        [(frame(b"\"\xff\xfe\"", Data::Text, true), "UTF-8"), (Message::text("x".repeat(70_000)), "65536")]
    {
        let mut program = program(&run).await;
        program.send(message).await.expect("sent");
        let refused = answer(&mut program).await;
        let why = refused["why"].as_str().expect("a text");
        assert!(why.starts_with("no message: ") && why.contains(expected), "{refused}");
        assert!(matches!(next(&mut program).await, Message::Close(Some(_))));
    }
}
