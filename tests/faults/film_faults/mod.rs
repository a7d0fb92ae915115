//! Film that begins late, loses a camera, jumps or drops frames: bodies under contacts stay calm.

mod film;
mod node;
mod run;

use std::time::Duration;

use coordinator::{Placement, RunSettings, Transport};
use film::{FPS, Film, all, rig};
use hull::{Camera, ProbeSettings, Rig};
use nalgebra::{Matrix3, Vector3};
use node::{Served, node_config, silent_node_config};
use node_client::Agreement;
use run::{Keeper, Step, between, farthest_m, fastest_m_s, play, play_over, settings, since, world};
use setup::expected_node;
use sim::Scene;
use testkit::{Watch, timely};
use tokio::sync::oneshot;

const GRAVITY_M_S2: f64 = 9.81;

#[tokio::test]
async fn a_live_world_stands_still_until_its_first_frame_comes() {
    let watch = Watch::start();
    let scene = Scene::named("rest").expect("shipped");
    let mut film = Film::of(&scene, &rig(), all(1000));
    film.late_s = 0.5;
    let live = RunSettings { lock_step: false, ..settings(1.5) };
    let (steps, figures) = play(film, &scene, live, std::future::pending()).await;
    timely!(watch, figures.counts.steps > 0, "no step was made");
    timely!(
        watch,
        figures.counts.misses.blind_steps() == 0,
        "{} steps are blind",
        figures.counts.misses.blind_steps()
    );
    assert!(steps.iter().all(|step| step.frame.is_some()), "no step is blind");
    assert!(steps[0].film_s > 0.45, "film went by meanwhile: {}", steps[0].film_s);
    assert!(steps[0].frame > Some(10), "the first step sees the film of then: {:?}", steps[0].frame);
    let made_s = figures.counts.steps as f64 / 120.0;
    let slipped_s = figures.counts.slipped_s;
    timely!(watch, (made_s + slipped_s - 1.5).abs() < 0.02, "{made_s} s made, {slipped_s} s slipped");
}

#[tokio::test]
async fn a_live_world_does_not_wait_for_its_first_frame_for_ever() {
    let watch = Watch::start();
    let scene = Scene::named("rest").expect("shipped");
    let film = || {
        let mut film = Film::of(&scene, &rig(), all(8));
        film.late_s = 1000.0;
        film
    };
    let live = |seconds| RunSettings { lock_step: false, ..settings(seconds) };
    let patient = RunSettings { connect_timeout: Duration::from_millis(200), ..live(0.8) };
    let (steps, figures) = play(film(), &scene, patient, std::future::pending()).await;
    timely!(watch, figures.counts.steps > 0, "it does not go on without a hull");
    assert!(steps.iter().all(|step| step.frame.is_none() && step.film_s > 0.2));
    assert_eq!(figures.counts.misses.blind_steps(), figures.counts.steps);
    let (_, figures) = play(film(), &scene, live(0.2), std::future::pending()).await;
    assert_eq!(figures.counts.steps, 0, "its time is over");
    assert_eq!(figures.film_failure.as_deref(), Some("the first frame has not come yet"));
    let stop = tokio::time::sleep(Duration::from_millis(500));
    let (_, figures) = play(film(), &scene, live(1000.0), stop).await;
    assert_eq!((figures.counts.steps, figures.film_failure), (0, None), "it was stopped");
}

/// Bodies have settled by then, seconds, and film goes wrong.
const SETTLED_S: f64 = 2.0;
const SETTLED_FRAMES: u64 = 60;
/// What rests on a hull of four small images still trembles so fast, m/s.
const CALM_M_S: f64 = 0.05;
/// Bodies that could rise so much higher than they lay were thrown, metres.
const THROWN_M: f64 = 0.05;

/// Bodies lie on the hull at the end of what was right.
fn check_settled(what: &str, steps: &[Step], settled_s: f64) {
    let settled = between(steps, settled_s - 0.3, settled_s);
    assert!(settled.iter().all(|step| step.contacts > 10), "{what}: they lie on the hull");
    let before_m_s = fastest_m_s(settled);
    assert!(before_m_s < CALM_M_S, "{what}: {before_m_s} m/s at rest");
}

/// No body has more energy than it had when it lay still: what fell into the table may be pushed out and fall off it.
fn check_not_thrown(what: &str, still: &Step, steps: &[Step]) {
    for step in steps {
        for (body, before_m) in still.positions_m.iter().enumerate() {
            let fall_m = step.velocities_m_s[body].norm_squared() / (2.0 * GRAVITY_M_S2);
            let energy_m = step.positions_m[body].y + fall_m;
            let most_m = before_m.y + THROWN_M;
            assert!(energy_m < most_m, "{what}: body {body} could rise to {energy_m} m at {} s", step.film_s);
        }
    }
}

/// Without a hull bodies fall, and nothing else happens to them.
fn check_falls(what: &str, steps: &[Step], began_s: f64) {
    for step in steps {
        assert_eq!((step.contacts, step.frame), (0, None), "{what}");
        let most_m_s = GRAVITY_M_S2 * (step.film_s - began_s) + CALM_M_S;
        let found_m_s = fastest_m_s(std::slice::from_ref(step));
        assert!(found_m_s < most_m_s, "{what}: {found_m_s} m/s at {} s, expected {most_m_s}", step.film_s);
    }
}

#[tokio::test]
async fn bodies_only_fall_while_a_camera_is_silent_and_are_not_thrown_when_it_answers_again() {
    let scene = Scene::named("rest").expect("shipped");
    // As long as they fall by 5 cm, and until they lie on the floor within what is filmed of the table.
    for frames in [3, 30] {
        let what = format!("silent for {frames} frames");
        let silent = SETTLED_FRAMES..SETTLED_FRAMES + frames;
        let mut film = Film::of(&scene, &rig(), all(210));
        film.silent = silent.clone();
        let (steps, figures) = play(film, &scene, settings(6.0), std::future::pending()).await;
        check_settled(&what, &steps, SETTLED_S);
        let back_s = silent.end as f64 / FPS;
        let blind = between(&steps, SETTLED_S, back_s);
        assert_eq!(
            (blind.len() as u64, figures.counts.faults),
            (figures.counts.misses.blind_steps(), 0),
            "{what}"
        );
        check_falls(&what, blind, SETTLED_S - 1.0 / 120.0);
        let back = since(&steps, back_s);
        check_not_thrown(&what, &blind[0], back);
        let end_m_s = fastest_m_s(since(back, 5.9));
        assert!(end_m_s < CALM_M_S, "{what}: {end_m_s} m/s at the end");
    }
}

#[tokio::test]
async fn bodies_only_fall_once_a_node_is_lost() {
    let (scene, rig) = (Scene::named("rest").expect("shipped"), rig());
    let (mut nodes, mut served) = (vec![], vec![]);
    for cameras in [0..1, 1..4] {
        served.push(Served::start(node_config(&scene, &rig, cameras.clone())).await);
        let address = served[served.len() - 1].address.clone();
        nodes.push(expected_node(&rig, address, &cameras.collect::<Vec<_>>()));
    }
    let shapes = world(&scene).asked_shapes().collect();
    let transport =
        Transport::connect(nodes, Placement::Nodes, Agreement::new(ProbeSettings::default(), FPS, shapes));
    let observers = node_config(&scene, &rig, 0..4).observers();
    let mut keeper = Keeper::default();
    keeper.tells = served[1].loses.take().map(|tell| (SETTLED_S, tell));
    let run = (keeper, std::future::pending());
    let (steps, figures) = play_over(transport, observers, &scene, settings(2.8), run).await;
    check_settled("a node is lost", &steps, SETTLED_S);
    let blind = &steps[steps.partition_point(|step| step.frame.is_some())..];
    assert!(
        blind.len() > 40 && blind.len() as u64 == figures.counts.misses.blind_steps(),
        "{} steps",
        blind.len()
    );
    check_falls("a node is lost", blind, blind[0].film_s - 1.0 / 120.0);
    assert!(farthest_m(blind) > 0.3, "they fall through what no camera sees");
    assert_eq!(figures.counts.faults, 0);
}

#[tokio::test]
async fn a_live_run_begins_without_a_camera_that_never_films_and_ends_with_its_name_if_too_few_do() {
    let watch = Watch::start();
    let (scene, rig) = (Scene::named("rest").expect("shipped"), rig());
    for silent in [3..4, 2..4] {
        let (mut nodes, mut served) = (vec![], vec![]);
        for (cameras, is_silent) in [(0..silent.start, false), (silent.clone(), true)] {
            let config = if is_silent { silent_node_config } else { node_config };
            let node = Served::start(config(&scene, &rig, cameras.clone())).await;
            nodes.push(expected_node(&rig, node.address.clone(), &cameras.collect::<Vec<_>>()));
            served.push(node);
        }
        let shapes = world(&scene).asked_shapes().collect();
        let agreement = Agreement::new(ProbeSettings::default(), FPS, shapes);
        let transport = Transport::connect(nodes, Placement::Nodes, agreement);
        let observers = node_config(&scene, &rig, 0..4).observers();
        let is_enough = silent.len() == 1;
        let seconds = if is_enough { 1000.0 } else { 6.0 };
        let live =
            RunSettings { lock_step: false, connect_timeout: Duration::from_secs(60), ..settings(seconds) };
        let (tell, told) = oneshot::channel();
        let mut keeper = Keeper::default();
        keeper.tells = Some((0.0, tell));
        let stop = async {
            // The first step drops the sender.
            let _ = told.await;
        };
        let (steps, figures) = play_over(transport, observers, &scene, live, (keeper, stop)).await;
        if is_enough {
            timely!(
                watch,
                steps.first().is_some_and(|step| step.frame.is_some())
                    && figures.counts.misses.blind_steps() == 0,
                "it waited in vain: {} steps without a hull",
                figures.counts.misses.blind_steps()
            );
            assert_eq!(figures.film_failure, None);
        } else {
            let why = "2 of 4 cameras, 3 needed: no frame has come from \"cam_2\", \"cam_3\"";
            assert_eq!((steps.len(), figures.film_failure.as_deref()), (0, Some(why)));
        }
    }
}

#[tokio::test]
async fn bodies_at_rest_stay_where_they_are_when_film_jumps_back_or_drops_frames() {
    for (name, seconds) in [("rest", 4.0), ("tray", 3.4), ("lift", 3.3)] {
        let scene = Scene::named(name).expect("shipped");
        // The person repeats four thirds of a second, whose frames have new numbers; their own; five frames a second.
        let looped = (0..150).map(|frame| (frame, if frame < 60 { frame } else { 20 + (frame - 60) % 40 }));
        let back = (0..60).chain(30..50).map(|frame| (frame, frame));
        let slow = (0..150).filter(|frame| *frame < 30 || frame % 6 == 0).map(|frame| (frame, frame.min(59)));
        let films: [(&str, Vec<(u64, u64)>); 3] =
            [("looped", looped.collect()), ("back", back.collect()), ("slow", slow.collect())];
        for (fault, shown) in films {
            let what = format!("{name}, {fault}");
            let film = Film::of(&scene, &rig(), shown);
            let run = RunSettings { hold_s: 5.0, ..settings(seconds) };
            let (steps, figures) = play(film, &scene, run, std::future::pending()).await;
            check_settled(&what, &steps, 1.0);
            let goes_back = steps.windows(2).any(|pair| pair[1].frame < pair[0].frame);
            assert_eq!(
                (goes_back, figures.counts.misses.blind_steps(), figures.counts.faults),
                (fault == "back", 0, 0),
                "{what}"
            );
            let after = since(&steps, 1.0);
            // Where the film is looped his arms are elsewhere from one frame to the next, and the hull near the lid.
            let most_m_s = if fault == "looped" { 0.5 } else { CALM_M_S };
            let (found_m_s, moved_m) = (fastest_m_s(after), farthest_m(after));
            assert!(found_m_s < most_m_s && moved_m < 0.02, "{what}: {found_m_s} m/s, {moved_m} m");
            let end_m_s = fastest_m_s(since(&steps, SETTLED_S + 0.5));
            assert!(end_m_s < CALM_M_S, "{what}: {end_m_s} m/s at the end");
        }
    }
}

/// The same rig with one camera elsewhere: it stands at a point and looks along +Z.
fn with_camera_at(rig: &Rig, at_m: [f64; 3]) -> Rig {
    let camera = &rig.cameras()[0];
    let rotation = Matrix3::new(-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0);
    let size = (camera.width(), camera.height());
    let moved = Camera::from_matrices(
        camera.name().to_owned(),
        size,
        *camera.intrinsics(),
        [0.0; 5],
        &rotation,
        -(rotation * Vector3::from(at_m)),
    );
    let others = rig.cameras()[1..].iter().cloned();
    Rig::new(std::iter::once(moved.expect("a camera")).chain(others).collect()).expect("a rig")
}

#[tokio::test]
async fn a_camera_that_stands_in_a_contact_throws_no_body() {
    let scene = Scene::named("rest").expect("shipped");
    let (still, _) =
        play(Film::of(&scene, &rig(), all(80)), &scene, settings(2.0), std::future::pending()).await;
    let foot = still.last().expect("steps").positions_m[0];
    // At the middle of the face on which the lowest box rests, at a corner of it, and within the box.
    for off_m in [[0.0, -0.1, 0.0], [0.1, -0.1, 0.1], [0.0, -0.05, 0.0]] {
        let at_m = (foot + Vector3::from(off_m)).into();
        let film = Film::of(&scene, &with_camera_at(&rig(), at_m), all(80));
        let (steps, figures) = play(film, &scene, settings(2.5), std::future::pending()).await;
        assert!(steps.iter().any(|step| step.contacts > 0), "{off_m:?}: nothing touched");
        assert_eq!((figures.counts.misses.blind_steps(), figures.counts.faults), (0, 0), "{off_m:?}");
        // It sees background where the table is, and they fall: no faster than from their own height.
        let highest_m = steps[0].positions_m.iter().map(|position| position.y).fold(0.0, f64::max);
        let (found_m_s, most_m_s) = (fastest_m_s(&steps), (2.0 * GRAVITY_M_S2 * highest_m).sqrt() + 0.1);
        assert!(found_m_s < most_m_s, "{off_m:?}: {found_m_s} m/s, expected {most_m_s}");
        let end_m_s = fastest_m_s(since(&steps, 2.2));
        assert!(end_m_s < CALM_M_S, "{off_m:?}: {end_m_s} m/s at the end");
    }
}
