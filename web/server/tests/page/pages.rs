//! What pages see and may do, over real sockets.

use crate::common::*;
use coordinator::live::Command;
use futures::SinkExt as _;
use proto::PictureKind;
use serde_json::json;
use tokio_tungstenite::tungstenite;

#[tokio::test]
async fn a_page_is_told_what_the_run_is() {
    let run = Run::start();
    run.publish_scene();
    run.publish_status();
    let mut page = run.viewer().await;
    let hello = page.hear_op("hello").await;
    assert_eq!(
        (&hello["version"], &hello["controller"], &hello["fps"]),
        (&json!(1), &json!(false), &json!(30.0))
    );
    assert_eq!(hello["session"].as_str().map(str::len), Some(32));
    let camera = &hello["cameras"][0];
    assert_eq!(
        (&camera["name"], &camera["width"], &camera["height"]),
        (&json!("cam_0"), &json!(640), &json!(480))
    );
    assert_eq!(camera["matrix"], json!([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]]));
    let radius = camera["max_radius"].as_f64().expect("this lens has one");
    assert!((radius - (1.0f64 / 0.9).sqrt()).abs() < 1e-6, "1 + 3 k1 r2 is zero there: {radius}");
    assert!(hello["cameras"][1]["max_radius"].is_null(), "a straight lens has none");
    assert_eq!(hello["replay"], json!(false));
    assert_eq!(hello["rule"], json!({"min_views": 2, "out_of_view": "outside"}));
    assert!(hello["scenes"].as_array().expect("names").contains(&json!("topple")));
    let volume = &hello["volume"];
    assert!(volume["low"][0].as_f64() < volume["high"][0].as_f64());

    let scene = page.hear_op("scene").await;
    assert_eq!((&scene["scene"], &scene["version"]), (&json!("by hand"), &json!(3)));
    assert_eq!(scene["bodies"][0]["shape"], json!({"ball": {"radius": 0.125}}));
    assert_eq!(scene["parameters"]["answers_hull"], json!(true));

    let status = page.hear_op("status").await;
    assert_eq!((&status["blind"], &status["paused"]), (&json!("no node"), &json!(false)));
    assert_eq!(status["progress"]["film_s"], json!(2.5));
    assert_eq!(status["cameras"][0]["problem"], json!("it sleeps"));
    assert_eq!((&status["feed"]["tier"], &status["feed"]["pages"]), (&json!("full"), &json!(1)));
    run.publish_scene();
    page.hear_op("scene").await;
}

#[tokio::test]
async fn the_first_page_sees_the_scene_from_its_start() {
    let run = Run::start_with(None, true);
    run.publish_scene();
    for _ in 0..2 {
        let mut page = run.viewer().await;
        page.hear_op("scene").await;
    }
    let mut page = run.controller().await;
    // By its answer all that was asked before is done.
    page.say(json!({"op": "command", "id": 1, "command": "pause"})).await;
    page.hear_op("done").await;
    assert_eq!(*run.ordered.lock().expect("whole"), [Command::Reset, Command::Pause]);
}

#[tokio::test]
async fn a_run_that_was_steered_goes_on_when_a_page_comes() {
    let run = Run::start_with(None, true);
    run.publish_scene();
    let url = format!("ws://{}/state?token={TOKEN}", run.feed.address());
    let (mut program, _) = tokio_tungstenite::connect_async(url).await.expect("connects");
    let step = json!({"op": "command", "id": 1, "command": "step"}).to_string();
    program.send(tungstenite::Message::text(step)).await.expect("sent");
    until("a step", || !run.ordered.lock().expect("whole").is_empty()).await;
    let mut page = run.controller().await;
    page.say(json!({"op": "command", "id": 1, "command": "pause"})).await;
    page.hear_op("done").await;
    assert_eq!(*run.ordered.lock().expect("whole"), [Command::Step(1), Command::Pause]);
}

#[tokio::test]
async fn a_page_gets_frames_and_bodies_as_it_wants_them() {
    let run = Run::start();
    let mut page = run.viewer().await;
    run.publish(10);
    let set = page.hear_frame(10).await;
    assert_eq!(usize::from(u16_at(&set, 6)), CAMERAS);
    assert_eq!(set[48 + 2], 3, "runs and colours");
    assert_eq!(u32_at(&set, 48 + 24) as usize, JPEG_BYTES[0]);
    let world = page.hear_kind(2).await;
    assert_eq!((u16_at(&world, 6), frame_of(&world[24..])), (1, 10));
    assert_eq!(u32_at(&world, 48 + 48), 2, "touches");

    page.say(
        json!({"op": "want", "colour": "half", "touches": false, "image_of": "cam_2", "thumbnails_hz": 5}),
    )
    .await;
    run.publish(11);
    // On a busy machine pings are answered late, and the page gets smaller colours than half.
    let mut set = page.hear_frame(10).await;
    while set[48 + 3] == 0 {
        set = page.hear_kind(1).await;
    }
    assert_eq!(u32_at(&set, 48 + 24) as usize, JPEG_BYTES[usize::from(set[48 + 3])]);
    let image = page.hear_kind(3).await;
    assert_eq!((u16_at(&image, 6), u16_at(&image, 48), u32_at(&image, 40)), (1, 2, 0), "camera 2 alone");
    let thumbnails = page.hear_kind(3).await;
    assert_eq!((usize::from(u16_at(&thumbnails, 6)), u32_at(&thumbnails, 40)), (CAMERAS, 1));
    assert_eq!(thumbnails[48 + 3], 2, "640 pixels become 160");
    run.publish(12);
    let mut world = page.hear_kind(2).await;
    while frame_of(&world[24..]) != 12 {
        world = page.hear_kind(2).await;
    }
    assert_eq!(world.len(), 48 + 48 + 4, "without touches");
    page.say(json!({"op": "want", "patches": true})).await;
    let world = page.hear_kind(2).await;
    assert_eq!(world.len(), 48 + 48 + 4 + 4 + 52, "sent again, with patches");
    assert_eq!(u32_at(&world, 48 + 48 + 4), 1, "patches");

    page.say(json!({"op": "want", "colour": "off", "image_of": null, "thumbnails_hz": 0})).await;
    run.publish(13);
    // Silhouettes alone.
    while page.hear_frame(13).await[48 + 2] != 1 {}
    page.say(json!({"op": "want", "silhouettes": false})).await;
    run.publish(14);
    // Frame sets still come, without cameras.
    while u16_at(&page.hear_frame(14).await, 6) != 0 {}
}

#[tokio::test]
async fn no_pictures_are_requested_without_a_viewer() {
    let run = Run::start();
    for frame in 0..20 {
        run.publish(frame);
        tokio::task::yield_now().await;
    }
    assert_eq!(run.studio.asked(), []);
    let mut page = run.viewer().await;
    page.hear_frame(19).await;
    let asked = run.studio.asked();
    assert_eq!((asked.len(), asked[0].kind, asked[0].frame), (1, PictureKind::Crops, Some(19)));
    drop(page);
    until("the page's place is free", || run.feed.pages() == 0).await;
    for frame in 20..40 {
        run.publish(frame);
        tokio::task::yield_now().await;
    }
    assert_eq!(run.studio.asked().len(), 1);
}

#[tokio::test]
async fn a_page_that_shows_nothing_gets_two_frame_sets_and_then_the_newest() {
    let run = Run::start();
    let mut page = run.viewer().await;
    page.shows = false;
    let mut seqs = Vec::new();
    for frame in 1..=2 {
        run.publish(frame);
        seqs.push(seq_of(&page.hear_frame(frame).await));
    }
    for frame in 3..=9 {
        run.publish(frame);
        // A world after the frame's: the page has had the time to get a third.
        page.hear_kind(2).await;
    }
    assert_eq!(run.studio.asked().len(), 2, "nothing is made for a page that cannot take it");
    page.say(json!({"op": "shown", "seq": seqs[0]})).await;
    assert_eq!(frame_of(&page.hear_kind(1).await), 9, "what lay between is passed over");
    let status = loop {
        let status = page.hear_op("status").await;
        if status["feed"]["sent"] == 3 {
            break status;
        }
    };
    assert_eq!(status["feed"]["dropped"], json!(6));
}

#[tokio::test]
async fn touches_wanted_while_paused_come_with_the_world_that_stands() {
    let run = Run::start();
    let mut page = run.viewer().await;
    page.say(json!({"op": "want", "touches": false})).await;
    run.publish_world(Some(10), true);
    let touches = |world: &[u8]| u32_at(world, 48 + 48);
    // A world that was made before a wish was read may come after it was said.
    while touches(&page.hear_kind(2).await) != 0 {}
    page.say(json!({"op": "want", "touches": true})).await;
    while touches(&page.hear_kind(2).await) != 2 {}
    page.say(json!({"op": "want", "touches": false})).await;
    while touches(&page.hear_kind(2).await) != 0 {}
}

#[tokio::test]
async fn a_page_with_the_token_steers_and_no_other() {
    let run = Run::start();
    let mut viewer = run.viewer().await;
    viewer.say(json!({"op": "command", "id": 1, "command": "pause"})).await;
    let refused = viewer.hear_op("refused").await;
    let why = "a viewer cannot steer: open the page with its token";
    assert_eq!((&refused["id"], &refused["why"]), (&json!(1), &json!(why)));
    let mut wrong = run.page_with_token("let-me-steeR").await;
    assert_eq!(wrong.hear_op("hello").await["controller"], json!(false));
    let mut in_address = Page::open(&format!("ws://{}/feed?token={TOKEN}", run.feed.address())).await;
    let is_controller = in_address.hear_op("hello").await["controller"].clone();
    assert_eq!(is_controller, json!(false), "browsers print addresses");
    assert!(run.ordered.lock().expect("whole").is_empty());

    let mut controller = run.controller().await;
    assert_eq!(controller.hear_op("hello").await["controller"], json!(true));
    controller.say(json!({"op": "command", "id": 2, "command": "pause"})).await;
    assert_eq!(controller.hear_op("done").await, json!({"op": "done", "id": 2}));
    let ball = json!({"op": "command", "id": 3, "command": "spawn", "position": [0, 2, 0],
        "shape": {"ball": {"radius": 0.1}}});
    controller.say(ball).await;
    assert_eq!(controller.hear_op("done").await, json!({"op": "done", "id": 3, "body": 12}));
    controller.say(json!({"op": "command", "id": 4, "command": "remove", "body": 99})).await;
    let refused = controller.hear_op("refused").await;
    assert_eq!(refused, json!({"op": "refused", "id": 4, "why": "there is no body 99"}));
    controller.say(json!({"op": "command", "id": 5, "command": "remove", "body": "x"})).await;
    let why = controller.hear_op("refused").await["why"].clone();
    assert_eq!(why, json!("remove.body is \"x\", expected a whole number from 0 to 4294967295"));
    let ordered = run.ordered.lock().expect("whole");
    assert!(matches!(ordered[..], [Command::Pause, Command::Spawn(_), Command::Remove(99)]));
}

#[tokio::test]
async fn each_page_is_a_client_which_is_gone_when_it_goes() {
    let run = Run::start();
    let (mut page, mut other) = (run.controller().await, run.controller().await);
    for (id, of) in [(1, &mut page), (2, &mut other)] {
        for _ in 0..2 {
            let grab = json!({"op": "command", "id": id, "command": "grab", "body": id,
                "grip": [0, 0, 0], "target": [0, 1, 0]});
            of.say(grab).await;
            of.hear_op("done").await;
        }
    }
    let clients = run.clients.lock().expect("whole").clone();
    assert_eq!(clients.len(), 4);
    assert!(clients[0] == clients[1] && clients[2] == clients[3] && clients[0] != clients[2]);
    drop(page);
    until("its client is gone, and what it holds is released", || clients[0].upgrade().is_none()).await;
    assert!(clients[2].upgrade().is_some(), "the other page is still there");
}

#[tokio::test]
async fn what_a_page_has_taken_away_it_can_bring_back_once() {
    let run = Run::start();
    let (mut page, mut other) = (run.controller().await, run.controller().await);
    let undo = |id: u64, of: u64| json!({"op": "command", "id": id, "command": "undo", "of": of});
    page.say(json!({"op": "command", "id": 1, "command": "remove", "body": 4})).await;
    assert_eq!(page.hear_op("done").await, json!({"op": "done", "id": 1, "undo": true}));
    other.say(undo(2, 1)).await;
    let why = other.hear_op("refused").await["why"].clone();
    assert_eq!(why, json!("command 1 cannot be undone, or not any more"), "it was another page's");
    page.say(undo(3, 1)).await;
    assert_eq!(page.hear_op("done").await["id"], json!(3));
    page.say(undo(4, 1)).await;
    page.hear_op("refused").await;
    let ordered = run.ordered.lock().expect("whole");
    assert_eq!(ordered[..], [Command::Remove(4), Command::Step(7)]);
}

#[tokio::test]
async fn an_undo_that_is_refused_may_be_asked_for_again_until_another_world_begins() {
    let run = Run::start();
    run.publish_scene_of(1);
    let mut page = run.controller().await;
    page.say(json!({"op": "command", "id": 1, "command": "remove", "body": 98})).await;
    page.hear_op("done").await;
    let mut refused = async |id: u64| {
        page.say(json!({"op": "command", "id": id, "command": "undo", "of": 1})).await;
        page.hear_op("refused").await["why"].as_str().expect("a reason").to_owned()
    };
    for id in [2, 3] {
        let why = refused(id).await;
        assert!(why.contains("99"), "the run refused it: {why}");
    }
    run.publish_scene_of(2);
    assert_eq!(refused(4).await, "command 1 cannot be undone, or not any more");
}

#[tokio::test]
async fn a_message_that_is_none_closes_the_page_with_one_line_and_nothing_else() {
    let run = Run::start();
    let mut good = run.viewer().await;
    for (bad, why) in [
        (tungstenite::Message::text("{"), "no JSON: "),
        (tungstenite::Message::text(r#"{"op":"dance"}"#), "op is \"dance\", expected "),
        (
            tungstenite::Message::text(r#"{"op":"want","fps":"all"}"#),
            "want.fps is \"all\", expected 0, or 0.1 to 240",
        ),
        (tungstenite::Message::text(r#"{"op":"want","image_of":"cam_9"}"#), "want.image_of is \"cam_9\""),
        (tungstenite::Message::text(r#"{"op":"command","command":"pause"}"#), "command.id is missing"),
        (tungstenite::Message::binary(vec![1, 2, 3]), "a binary message, expected texts"),
        (tungstenite::Message::text("x".repeat(100_000)), "no message: "),
    ] {
        let mut page = run.controller().await;
        page.send(bad).await;
        let bye = page.hear_op("bye").await["why"].as_str().expect("a reason").to_owned();
        assert!(bye.starts_with(why) && !bye.contains('\n'), "{bye}");
        assert!(matches!(page.hear().await, Heard::Close(_)));
    }
    run.publish(5);
    good.hear_frame(5).await;
    until("their places are free", || run.feed.pages() == 1).await;
}

#[tokio::test]
async fn pages_are_told_when_the_run_ends() {
    let run = Run::start();
    let mut page = run.viewer().await;
    page.hear_op("hello").await;
    let ended = tokio::task::spawn_blocking(move || drop(run));
    assert_eq!(page.hear_op("bye").await["why"], json!("the run has ended"));
    ended.await.expect("no panic");
}
