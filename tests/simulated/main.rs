//! The whole chain on a simulated network, in simulated time: the real client, pass and coordinator, the real service over
//! film without threads. Seeds give delays, losses, cuts and deaths, or a node that lies; the same seed gives the same log.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

mod film;
mod liar;
mod poison;
mod room;

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use film::Studio;
use room::{Outcome, Trouble, play};
use testkit::{Watch, timely};

/// Seeds from 0 of each trouble; `HULLTOUCH_SEEDS` says another number.
const SEEDS_OF_NETWORKS: u64 = 50;
const SEEDS_OF_LIARS: u64 = 40;
const SEEDS_OF_POISON: u64 = 4;

/// What is wrong with a seed.
enum Wrong {
    /// The room did what it must not.
    Room(String),
    /// Played again it gave another log.
    Differs(String),
}

/// Plays a seed twice.
fn check(studio: &Studio, seed: u64, trouble: Trouble) -> Result<Outcome, Wrong> {
    let (first, again) = (play(studio, seed, trouble), play(studio, seed, trouble));
    if let Some(why) = first.wrong.or(again.wrong) {
        return Err(Wrong::Room(format!("seed {seed}: {why}")));
    }
    let lines = first.log.iter().zip(&again.log).enumerate();
    if let Some((line, (one, other))) = lines.clone().find(|(_, (one, other))| one != other) {
        return Err(Wrong::Differs(format!("seed {seed}: its logs differ in line {line}:\n{one}\n{other}")));
    }
    let (lines, lines_again) = (first.log.len(), again.log.len());
    if lines != lines_again {
        return Err(Wrong::Differs(format!("seed {seed}: its logs have {lines} and {lines_again} lines")));
    }
    Ok(Outcome { wrong: None, ..first })
}

#[test]
fn rooms_whose_network_fails_are_whole_again_and_the_same_seed_fails_the_same() {
    check_all(Trouble::Network, SEEDS_OF_NETWORKS);
}

#[test]
fn a_node_that_lies_does_not_end_a_run_nor_blind_it_for_a_second() {
    check_all(Trouble::Liar, SEEDS_OF_LIARS);
}

#[test]
fn a_world_that_one_node_made_up_is_not_gone_on_from() {
    check_all(Trouble::Poison, SEEDS_OF_POISON);
}

/// `HULLTOUCH_SEED` tries one alone, and prints its log.
fn check_all(trouble: Trouble, seeds: u64) {
    let host_s = || if turmoil::in_simulation() { turmoil::elapsed().as_secs_f64() } else { 0.0 };
    film_time::simulate(host_s);
    let studio = Studio::new();
    let named = |name| std::env::var(name).ok().and_then(|number: String| number.parse().ok());
    if let Some(seed) = named("HULLTOUCH_SEED") {
        let outcome = play(&studio, seed, trouble);
        outcome.log.iter().for_each(|line| eprintln!("{line}"));
        if let Err(Wrong::Room(why) | Wrong::Differs(why)) = check(&studio, seed, trouble) {
            panic!("{why}");
        }
        return;
    }
    let seeds = named("HULLTOUCH_SEEDS").unwrap_or(seeds);
    let (next, steps) = (AtomicU64::new(0), AtomicU64::new(0));
    let (wrong, differing) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
    let watch = Watch::start();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= seeds {
                        break;
                    }
                    match check(&studio, seed, trouble) {
                        Ok(outcome) => _ = steps.fetch_add(outcome.steps, Ordering::Relaxed),
                        Err(Wrong::Room(why)) => wrong.lock().expect("no panic").push(why),
                        Err(Wrong::Differs(why)) => differing.lock().expect("no panic").push(why),
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{trouble:?}: {} of {seeds} seeds:\n{}", wrong.len(), wrong.join("\n"));
    // One clock is not simulated: HTTP/2 remembers a stream that was reset for a second of the machine's own.
    let differing = differing.into_inner().expect("no panic");
    let (count, lines) = (differing.len(), differing.join("\n"));
    timely!(watch, differing.is_empty(), "{trouble:?}: {count} of {seeds} seeds:\n{lines}");
    eprintln!("{trouble:?}: {seeds} seeds, {} steps", steps.into_inner());
}
