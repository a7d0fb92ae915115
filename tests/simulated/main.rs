//! The whole chain on a simulated network, in simulated time: the real client, pass and coordinator, the real service over
//! film without threads. Seeds give delays, losses, cuts and deaths; the same seed gives the same log.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]

mod film;
mod room;

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use film::Studio;
use room::{Outcome, play};

/// Seeds from 0 that are tried.
const SEEDS: u64 = 100;

/// Both logs of a seed, and what was wrong.
fn check(studio: &Studio, seed: u64) -> Result<Outcome, String> {
    let (first, again) = (play(studio, seed), play(studio, seed));
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

/// `HULLTOUCH_SEED` tries one alone, and prints its log.
#[test]
fn rooms_whose_network_fails_are_whole_again_and_the_same_seed_fails_the_same() {
    let host_s = || if turmoil::in_simulation() { turmoil::elapsed().as_secs_f64() } else { 0.0 };
    proto::simulate(host_s);
    let studio = Studio::new();
    if let Some(seed) = std::env::var("HULLTOUCH_SEED").ok().and_then(|seed| seed.parse().ok()) {
        let outcome = play(&studio, seed);
        outcome.log.iter().for_each(|line| eprintln!("{line}"));
        check(&studio, seed).unwrap_or_else(|why| panic!("seed {seed}: {why}"));
        return;
    }
    let (next, wrong, steps) = (AtomicU64::new(0), Mutex::new(Vec::new()), AtomicU64::new(0));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= SEEDS {
                        break;
                    }
                    match check(&studio, seed) {
                        Ok(outcome) => _ = steps.fetch_add(outcome.steps, Ordering::Relaxed),
                        Err(why) => wrong.lock().expect("no panic").push(format!("seed {seed}: {why}")),
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{} of {SEEDS} seeds:\n{}", wrong.len(), wrong.join("\n"));
    eprintln!("{SEEDS} seeds, {} steps", steps.into_inner());
}
