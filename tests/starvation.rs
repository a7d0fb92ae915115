//! How tests that judge real time tell a slow product from a busy machine.

#[path = "shared/aloud.rs"]
mod aloud;
#[path = "shared/starvation.rs"]
mod starvation;

use std::collections::HashMap;
use std::panic::catch_unwind;

use starvation::{
    ProcessorTime, Stretch, Verdict, Watch, all_and_busy, others_share, parent_and_ticks, ticks_of_tree, verdict,
};

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
fn a_watch_forgives_a_missed_bound_only_with_the_machine_as_its_reason() {
    let watch = Watch::start();
    assert_eq!(watch.judge(Ok(7)), Some(7));
    assert!(watch.holds(true, || "never asked".to_owned()));
    // Either is right, by what else runs here.
    match catch_unwind(|| watch.holds(false, || "3 frames were missed".to_owned())) {
        Ok(holds) => assert!(!holds),
        Err(panic) => {
            let said = panic.downcast_ref::<String>().expect("a message");
            assert!(said.starts_with("3 frames were missed\nthe machine had time: "), "{said}");
        }
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
