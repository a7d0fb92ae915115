//! Runners side by side: every engine takes its turn, then all again, so that what else the machine does
//! meets them alike.

use std::time::{Duration, Instant};

use setup::cli::Outcome;

use crate::usage::thread_cpu_s;

/// A figure is the median of so many repetitions,
const REPETITIONS: usize = 7;
/// of so many where one takes longer than [`LONG`].
const LONG_REPETITIONS: usize = 3;
/// Longer is long.
const LONG: Duration = Duration::from_secs(2);
/// A repetition takes at least so long, seconds of processor time.
pub const REPETITION_S: f64 = 0.15;

/// One engine on one load.
pub struct Lane<'a> {
    /// Its name in the table.
    pub engine: &'static str,
    /// One repetition: points per second.
    repetition: Box<dyn FnMut() -> Outcome<f64> + 'a>,
}

impl<'a> Lane<'a> {
    /// A lane whose repetitions return their own rate.
    pub fn new(engine: &'static str, repetition: impl FnMut() -> Outcome<f64> + 'a) -> Lane<'a> {
        Lane { engine, repetition: Box::new(repetition) }
    }

    /// A lane that does some work on so many points, per second that the processor gave this thread:
    /// other programs take turns with it, but do not count.
    pub fn of_work(engine: &'static str, points: usize, mut work: impl FnMut() -> Outcome + 'a) -> Lane<'a> {
        Lane::new(engine, move || {
            let (began_s, mut rounds) = (thread_cpu_s(), 0usize);
            loop {
                work()?;
                rounds += 1;
                let took_s = thread_cpu_s() - began_s;
                if took_s >= REPETITION_S {
                    return Ok((rounds * points) as f64 / took_s);
                }
            }
        })
    }
}

/// Each lane's median rate, points per second, in their order. The first turn of each warms it up and does
/// not count.
pub fn medians(lanes: &mut [Lane]) -> Outcome<Vec<f64>> {
    let mut repetitions = Vec::new();
    for lane in lanes.iter_mut() {
        let began = Instant::now();
        (lane.repetition)()?;
        repetitions.push(if began.elapsed() > LONG { LONG_REPETITIONS } else { REPETITIONS });
    }
    let mut rates: Vec<Vec<f64>> = vec![Vec::new(); lanes.len()];
    for turn in 0..REPETITIONS {
        for (index, lane) in lanes.iter_mut().enumerate() {
            if turn < repetitions[index] {
                rates[index].push((lane.repetition)()?);
            }
        }
    }
    Ok(rates.into_iter().map(median).collect())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_take_turns_and_the_median_is_what_they_usually_say() {
        let turns = std::cell::RefCell::new(String::new());
        let lane = |engine: &'static str, rates: &'static [f64]| {
            let (mut at, turns) = (0, &turns);
            Lane::new(engine, move || {
                turns.borrow_mut().push_str(engine);
                at += 1;
                Ok(rates[at % rates.len()])
            })
        };
        let mut lanes = [lane("a", &[5.0, 1.0, 9.0]), lane("b", &[2.0])];
        assert_eq!(medians(&mut lanes), Ok(vec![5.0, 2.0]));
        drop(lanes);
        assert_eq!(turns.into_inner(), "ab".repeat(8));
    }
}
