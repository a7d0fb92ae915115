//! What pages see of a paused world, whose frame the nodes have dropped.

use std::sync::atomic::Ordering;

use crate::common::*;
use proto::PictureKind;
use serde_json::json;

/// The nodes drop all frames up to 49; the newest is 60.
fn let_film_go_by(run: &Run) {
    run.studio.oldest.store(50, Ordering::SeqCst);
    run.studio.newest.store(60, Ordering::SeqCst);
}

/// Waits until the pictures of a frame at which the world stands were asked for.
async fn is_frozen(run: &Run, frame: u64) {
    let asked = || run.studio.asked().iter().any(|request| request.frame == Some(frame));
    until("the frozen frame was asked for", asked).await;
}

#[tokio::test]
async fn a_page_that_joins_gets_the_frame_set_at_which_the_world_stands() {
    let run = Run::start();
    let mut first = run.viewer().await;
    first.say(json!({"op": "want", "colour": "off"})).await;
    run.publish(6);
    first.hear_frame(6).await;
    run.publish_world(Some(7), true);
    first.hear_frame(7).await;
    is_frozen(&run, 7).await;
    let_film_go_by(&run);
    drop(first);
    let mut late = run.viewer().await;
    let (mut world, mut set) = (None, None);
    while world.is_none() || set.is_none() {
        if let Heard::Binary(bytes) = late.hear().await {
            match bytes[4] {
                1 => set = Some(bytes),
                _ => world = Some(u32_at(&bytes, 20)),
            }
        }
    }
    let set = set.expect("a set");
    assert_eq!(world, Some(1), "paused");
    assert_eq!((frame_of(&set), usize::from(u16_at(&set, 6))), (7, CAMERAS), "the bodies' own frame, whole");
    assert_eq!(set[48 + 2], 3, "runs and colours, though no viewer looked at colours before");
    for (colour, kind) in [("off", 1), ("half", 3)] {
        late.say(json!({"op": "want", "colour": colour})).await;
        let set = late.hear_kind(1).await;
        assert_eq!((frame_of(&set), set[48 + 2]), (7, kind), "{colour}");
    }
    assert_eq!(late.hear_op("status").await["feed"]["dropped"], json!(0), "film that went by is not missed");
    let asked_newest = run.studio.asked().into_iter().any(|request| request.frame.is_none());
    assert!(!asked_newest, "the newest film shows another moment");
}

#[tokio::test]
async fn every_step_of_a_paused_world_has_its_own_frame_set() {
    let run = Run::start();
    let _watching = run.viewer().await;
    for frame in 10..13 {
        run.publish_world(Some(frame), true);
        is_frozen(&run, frame).await;
        run.studio.oldest.store(frame + 1, Ordering::SeqCst);
        let mut late = run.viewer().await;
        assert_eq!(frame_of(&late.hear_kind(1).await), frame);
    }
    run.publish(30);
    let mut late = run.viewer().await;
    assert_eq!(frame_of(&late.hear_kind(1).await), 30, "the world goes on");
}

#[tokio::test]
async fn a_frame_that_was_dropped_before_it_could_be_kept_is_not_replaced_by_another() {
    let run = Run::start();
    let_film_go_by(&run);
    let mut page = run.viewer().await;
    run.publish_world(Some(7), true);
    is_frozen(&run, 7).await;
    page.say(json!({"op": "want", "thumbnails_hz": 1})).await;
    loop {
        match page.hear().await {
            Heard::Binary(bytes) if bytes[4] == 1 => panic!("a set of frame {}", frame_of(&bytes)),
            Heard::Binary(bytes) if bytes[4] == 3 => break,
            _ => {}
        }
    }
}

#[tokio::test]
async fn the_image_of_a_camera_is_of_the_newest_film_and_comes_once_its_node_keeps_colours() {
    let run = Run::start();
    let mut page = run.viewer().await;
    run.publish_world(Some(7), true);
    page.hear_frame(7).await;
    let_film_go_by(&run);
    run.studio.colourless.store(2, Ordering::SeqCst);
    page.say(json!({"op": "want", "image_of": "cam_1"})).await;
    let mut sets = 0;
    let image = loop {
        match page.hear().await {
            Heard::Binary(bytes) if bytes[4] == 1 => sets += 1,
            Heard::Binary(bytes) if bytes[4] == 3 && bytes[48 + 2] == 2 => break bytes,
            _ => {}
        }
    };
    assert_eq!((frame_of(&image), u16_at(&image, 48)), (60, 1));
    assert_eq!(sets, 1, "what the page has is not sent again with the image");
    let asked = run.studio.asked();
    let newest = asked.iter().filter(|request| request.kind == PictureKind::Whole && request.frame.is_none());
    assert_eq!(newest.count(), 3);
}
