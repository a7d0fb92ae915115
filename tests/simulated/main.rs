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

/// Seeds from 0 of each trouble; `HULLTOUCH_SEEDS` says another number.
const SEEDS_OF_NETWORKS: u64 = 50;
const SEEDS_OF_LIARS: u64 = 40;
const SEEDS_OF_POISON: u64 = 4;

/// Both logs of a seed, and what was wrong.
fn check(studio: &Studio, seed: u64, trouble: Trouble) -> Result<Outcome, String> {
    let (first, again) = (play(studio, seed, trouble), play(studio, seed, trouble));
    let lines = first.log.iter().zip(&again.log).enumerate();
    if let Some((line, (one, other))) = lines.clone().find(|(_, (one, other))| one != other) {
        return Err(format!("its logs differ in line {line}:\n{one}\n{other}"));
    }
    if first.log.len() != again.log.len() {
        return Err(format!("its logs have {} and {} lines", first.log.len(), again.log.len()));
    }
    match first.wrong {
        Some(why) => Err(why),
        None => Ok(first),
    }
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
    proto::simulate(host_s);
    let studio = Studio::new();
    let named = |name| std::env::var(name).ok().and_then(|number: String| number.parse().ok());
    if let Some(seed) = named("HULLTOUCH_SEED") {
        let outcome = play(&studio, seed, trouble);
        outcome.log.iter().for_each(|line| eprintln!("{line}"));
        check(&studio, seed, trouble).unwrap_or_else(|why| panic!("seed {seed}: {why}"));
        return;
    }
    let seeds = named("HULLTOUCH_SEEDS").unwrap_or(seeds);
    let (next, wrong, steps) = (AtomicU64::new(0), Mutex::new(Vec::new()), AtomicU64::new(0));
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
                        Err(why) => wrong.lock().expect("no panic").push(format!("seed {seed}: {why}")),
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{trouble:?}: {} of {seeds} seeds:\n{}", wrong.len(), wrong.join("\n"));
    eprintln!("{trouble:?}: {seeds} seeds, {} steps", steps.into_inner());
}
