//! Whether other programs left this machine too little time for a test that judges real time.
//!
//! A bound that is missed fails its test. If other programs took the processors meanwhile, the test says nothing about the
//! product: it ends as inconclusive, and a line of the log says so.

use std::collections::HashMap;
use std::fs;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::skip::write_line;

/// The probe sleeps so long, and then computes: a thread that only sleeps is preferred by the scheduler, and hardly waits.
const SLEEPS: Duration = Duration::from_millis(20);
const COMPUTES: Duration = Duration::from_millis(1);
/// Measured over stretches of this length: a shorter one has too few ticks of the system's clock.
const STRETCH: Duration = Duration::from_millis(500);
/// Other programs had at least this share of all processors in a stretch in which a test was starved.
const OTHERS_SHARE: f64 = 0.25;
/// And the probe waited for at least this share of the time in which it could have computed.
const WAITED_SHARE: f64 = 0.3;
/// Characters of a missed bound that its line shows.
const MOST_SHOWN: usize = 300;

/// What a run says that gave up because a node or a camera was slower than its limits.
const OUT_OF_TIME: [&str; 4] = ["within ", "no frame has come", "in time", "no answer"];

/// Whether a run that ended with status 1 says that something took too long: a busy machine does that. Other failures say
/// something else.
pub fn ran_out_of_time(said: &str) -> bool {
    OUT_OF_TIME.iter().any(|words| said.contains(words))
}

/// What was measured in one stretch of time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Stretch {
    /// The share of all processors that went to processes other than the test's program and its descendants.
    others_share: f64,
    /// How long the probe waited for a processor, over how long it waited or computed.
    waited_share: f64,
    /// How late the probe woke at most, milliseconds.
    latest_ms: f64,
}

impl Stretch {
    /// Other programs took processors, and what wanted to compute waited.
    fn is_starved(&self) -> bool {
        self.others_share >= OTHERS_SHARE && self.waited_share >= WAITED_SHARE
    }
}

/// What a bound says of the product.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    /// It was kept.
    Kept,
    /// It was missed on a machine that had time.
    Missed,
    /// It was missed on a machine that had none: the worst of what was measured in starved stretches.
    Inconclusive(Stretch),
}

/// Judges a bound by what was measured while it was to be kept.
fn verdict(is_kept: bool, stretches: &[Stretch]) -> Verdict {
    if is_kept {
        return Verdict::Kept;
    }
    let worst = |worst: Stretch, stretch: &Stretch| Stretch {
        others_share: worst.others_share.max(stretch.others_share),
        waited_share: worst.waited_share.max(stretch.waited_share),
        latest_ms: worst.latest_ms.max(stretch.latest_ms),
    };
    let starved = stretches.iter().filter(|stretch| stretch.is_starved());
    starved
        .copied()
        .reduce(|before, stretch| worst(before, &stretch))
        .map_or(Verdict::Missed, Verdict::Inconclusive)
}

/// Measures how busy the machine is, from its start until it is dropped.
pub struct Watch {
    stretches: Arc<Mutex<Vec<Stretch>>>,
    /// Its end ends the probe.
    _ends: Sender<()>,
}

impl Watch {
    /// Begins to measure.
    pub fn start() -> Watch {
        let stretches = Arc::new(Mutex::new(Vec::new()));
        let (sender, ends) = channel();
        let kept = Arc::clone(&stretches);
        std::thread::spawn(move || measure(&kept, &ends));
        Watch { stretches, _ends: sender }
    }

    /// Whether a bound was kept. Panics if it was missed on a machine that had time; `false` if the machine was too busy
    /// to tell, which the log says: the test ends then.
    #[track_caller]
    #[must_use]
    pub fn holds(&self, is_kept: bool, missed: impl FnOnce() -> String) -> bool {
        self.judge(if is_kept { Ok(()) } else { Err(missed()) }).is_some()
    }

    /// The same of a result that a slow machine spoils.
    #[track_caller]
    #[must_use]
    pub fn judge<T>(&self, result: Result<T, String>) -> Option<T> {
        let missed = match result {
            Ok(value) => return Some(value),
            Err(missed) => missed,
        };
        // The stretch in which it was missed is measured to its end.
        std::thread::sleep(2 * STRETCH);
        let stretches = self.stretches.lock();
        match inconclusive(&missed, &stretches) {
            Ok(line) => write_line(&line),
            Err(failure) => panic!("{failure}"),
        }
        None
    }
}

/// Ends the test unless a bound of real time holds: it fails, or is inconclusive on a machine that was too busy. For tests
/// and functions that return nothing, an `Option` or a `bool`.
#[macro_export]
macro_rules! timely {
    ($watch:expr, $is_kept:expr, $($missed:tt)+) => {
        if !$watch.holds($is_kept, || format!($($missed)+)) {
            return ::core::default::Default::default();
        }
    };
}

/// The line of a test that ends without a result, or what a test fails with that missed a bound in time it had.
fn inconclusive(missed: &str, stretches: &[Stretch]) -> Result<String, String> {
    let Verdict::Inconclusive(worst) = verdict(false, stretches) else {
        return Err(format!("{missed}\nthe machine had time: {}", busiest(stretches)));
    };
    let thread = std::thread::current();
    let (test, missed) = (thread.name().unwrap_or("a test"), missed.lines().next().unwrap_or_default());
    let missed: String = missed.chars().take(MOST_SHOWN).collect();
    Ok(format!(
        "inconclusive: machine too busy (woke up to {:.0} ms late, other programs had up to {:.0} % of the processors): \
         {test}: {missed}",
        worst.latest_ms,
        100.0 * worst.others_share
    ))
}

fn busiest(stretches: &[Stretch]) -> String {
    let most = |of: fn(&Stretch) -> f64| stretches.iter().map(of).fold(0.0, f64::max);
    format!(
        "other programs had at most {:.0} % of it, and the probe waited at most {:.0} % of its time",
        100.0 * most(|stretch| stretch.others_share),
        100.0 * most(|stretch| stretch.waited_share)
    )
}

/// The probe: it sleeps and computes in turn, and looks at who had the processors.
fn measure(stretches: &Mutex<Vec<Stretch>>, ends: &Receiver<()>) {
    let mut before = ProcessorTime::read();
    loop {
        let (began, mut latest, mut waited, mut computed) =
            (Instant::now(), Duration::ZERO, Duration::ZERO, Duration::ZERO);
        while began.elapsed() < STRETCH {
            let turn = Instant::now();
            if ends.recv_timeout(SLEEPS) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            let woke = Instant::now();
            latest = latest.max((woke - turn).saturating_sub(SLEEPS));
            while woke.elapsed() < COMPUTES {
                std::hint::spin_loop();
            }
            waited += turn.elapsed().saturating_sub(SLEEPS + COMPUTES);
            computed += COMPUTES;
        }
        let after = ProcessorTime::read();
        let stretch = Stretch {
            others_share: others_share(before, after),
            waited_share: waited.as_secs_f64() / (waited + computed).as_secs_f64(),
            latest_ms: 1e3 * latest.as_secs_f64(),
        };
        before = after;
        stretches.lock().push(stretch);
    }
}

/// Processor time since the system began, in ticks of its clock.
#[derive(Clone, Copy, Debug, Default)]
struct ProcessorTime {
    /// Of all processors, idle or not.
    all: u64,
    /// In which programs ran, or another machine on the same hardware.
    busy: u64,
    /// Of this process and its descendants.
    own: u64,
}

impl ProcessorTime {
    /// All zero on a system that does not tell: no test is starved there.
    fn read() -> ProcessorTime {
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
        let stats = ids.filter_map(|id| Some((id, fs::read_to_string(format!("/proc/{id}/stat")).ok()?)));
        let stats: HashMap<u32, (u32, u64)> =
            stats.filter_map(|(id, stat)| Some((id, parent_and_ticks(&stat)?))).collect();
        let (all, busy) =
            all_and_busy(&fs::read_to_string("/proc/stat").unwrap_or_default()).unwrap_or_default();
        ProcessorTime { all, busy, own: ticks_of_tree(&stats, std::process::id()) }
    }
}

/// All ticks, and those of programs and of other machines, in the text of `/proc/stat`. Interrupts count for no program:
/// a test's own packets make most of them.
fn all_and_busy(stat: &str) -> Option<(u64, u64)> {
    let line = stat.lines().find_map(|line| line.strip_prefix("cpu "))?;
    let ticks: Vec<u64> = line.split_whitespace().take(8).map_while(|ticks| ticks.parse().ok()).collect();
    let [user, nice, system, _idle, _io, _interrupts, _soft, steal] = ticks.as_slice().try_into().ok()?;
    Some((ticks.iter().sum(), user + nice + system + steal))
}

/// A process's parent, and the ticks of it and of its children that have ended, in the text of its `stat` file.
fn parent_and_ticks(stat: &str) -> Option<(u32, u64)> {
    // The name before may hold spaces and brackets.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = fields.get(11..15)?.iter().map(|ticks| ticks.parse::<u64>());
    Some((fields.get(1)?.parse().ok()?, ticks.sum::<Result<u64, _>>().ok()?))
}

/// The ticks of a process and all its descendants.
fn ticks_of_tree(stats: &HashMap<u32, (u32, u64)>, root: u32) -> u64 {
    let descends = |id: u32| {
        let parents = std::iter::successors(Some(id), |id| stats.get(id).map(|(parent, _)| *parent));
        // Parents that were read at another moment may lead in a circle.
        parents.take(64).any(|id| id == root)
    };
    stats.iter().filter(|(id, _)| descends(**id)).map(|(_, (_, ticks))| ticks).sum()
}

/// The share of all processors that other programs had between two moments.
fn others_share(before: ProcessorTime, after: ProcessorTime) -> f64 {
    let since = |of: fn(&ProcessorTime) -> u64| of(&after).saturating_sub(of(&before));
    // A descendant that ended and was adopted takes its ticks along: fewer are its own than before.
    let others = since(|time| time.busy).saturating_sub(since(|time| time.own));
    others as f64 / since(|time| time.all).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Stretch = Stretch { others_share: 0.04, waited_share: 0.1, latest_ms: 0.4 };
    /// As measured with eight busy loops on two processors.
    const BUSY: Stretch = Stretch { others_share: 0.86, waited_share: 0.93, latest_ms: 54.0 };

    #[test]
    fn a_bound_that_is_kept_is_kept_however_busy_the_machine_is() {
        assert_eq!(verdict(true, &[]), Verdict::Kept);
        assert_eq!(verdict(true, &[BUSY]), Verdict::Kept);
    }

    #[test]
    fn a_bound_that_is_missed_on_a_quiet_machine_is_missed() {
        assert_eq!(verdict(false, &[]), Verdict::Missed);
        assert_eq!(verdict(false, &[QUIET; 100]), Verdict::Missed);
    }

    #[test]
    fn a_bound_that_is_missed_while_others_took_the_processors_says_nothing() {
        let later = Stretch { latest_ms: 340.0, others_share: 0.5, ..BUSY };
        let worst = Stretch { latest_ms: 340.0, ..BUSY };
        assert_eq!(verdict(false, &[QUIET, BUSY, QUIET, later]), Verdict::Inconclusive(worst));
    }

    #[test]
    fn a_product_that_takes_all_processors_itself_is_no_busy_machine() {
        let its_own = Stretch { others_share: 0.1, ..BUSY };
        assert_eq!(verdict(false, &[its_own; 10]), Verdict::Missed);
    }

    #[test]
    fn others_that_leave_a_processor_free_starve_no_test() {
        let beside = Stretch { waited_share: 0.1, ..BUSY };
        assert_eq!(verdict(false, &[beside; 10]), Verdict::Missed);
    }

    #[test]
    fn a_missed_bound_is_told_with_what_the_machine_did() {
        let line = inconclusive("3 frames were missed\n{}", &[QUIET, BUSY]).expect("too busy");
        let expected = "inconclusive: machine too busy (woke up to 54 ms late, other programs had up to 86 % of the \
                        processors): ";
        assert!(line.starts_with(expected) && line.ends_with(": 3 frames were missed"), "{line}");
        let failure = inconclusive("3 frames were missed", &[QUIET]).expect_err("it had time");
        assert!(failure.starts_with("3 frames were missed\nthe machine had time: "), "{failure}");
    }

    #[test]
    fn a_watch_measures_until_it_is_dropped() {
        let watch = Watch::start();
        assert_eq!(watch.judge(Ok(7)), Some(7));
        assert!(watch.holds(true, || "never asked".to_owned()));
        let by = Instant::now() + Duration::from_secs(60);
        while watch.stretches.lock().len() < 2 {
            assert!(Instant::now() < by, "nothing is measured");
            std::thread::sleep(Duration::from_millis(20));
        }
        let stretches = Arc::downgrade(&watch.stretches);
        drop(watch);
        while stretches.strong_count() > 0 {
            assert!(Instant::now() < by, "the probe does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn processor_time_is_read_as_linux_writes_it() {
        let stat = "cpu  10 20 30 400 50 6 7 8 9 9\ncpu0 1 2 3 4 5 6 7 8 9 9\n";
        assert_eq!(all_and_busy(stat), Some((531, 68)));
        assert_eq!(all_and_busy("cpu  10 20"), None);
        let process = "42 (a) name) S 7 42 42 0 -1 4194560 1 2 3 4 100 20 3 1 20 0 1 0 5 6 7";
        assert_eq!(parent_and_ticks(process), Some((7, 124)));
        assert_eq!(parent_and_ticks("42 (short) S 7"), None);
    }

    #[test]
    fn what_descendants_compute_is_the_tests_own_and_all_else_is_others() {
        let stats = HashMap::from([(1, (0, 1000)), (5, (1, 10)), (6, (5, 20)), (7, (6, 40)), (8, (1, 500))]);
        assert_eq!(ticks_of_tree(&stats, 5), 70);
        let circle = HashMap::from([(5, (1, 10)), (6, (7, 20)), (7, (6, 40))]);
        assert_eq!(ticks_of_tree(&circle, 5), 10);
        let time = |all, busy, own| ProcessorTime { all, busy, own };
        assert!((others_share(time(100, 50, 10), time(300, 150, 30)) - 0.4).abs() < 1e-9);
        assert_eq!(others_share(time(100, 50, 30), time(200, 60, 90)), 0.0);
        assert_eq!(others_share(ProcessorTime::default(), ProcessorTime::default()), 0.0);
    }
}
