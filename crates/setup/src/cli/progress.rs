//! Progress on standard error, for work that takes longer than a second.

use std::thread;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shorter work shows nothing.
const SHOWN_AFTER: Duration = Duration::from_secs(1);

/// A bar that appears when work has taken longer than a second and standard error is a terminal.
pub struct Progress {
    bar: ProgressBar,
    began: Instant,
    is_shown: bool,
}

impl Progress {
    /// A bar of so many steps.
    pub fn new(what: &'static str, steps: u64) -> Progress {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        bar.set_message(what);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
            bar.set_style(style);
        }
        Progress { bar, began: Instant::now(), is_shown: false }
    }

    /// One more step is done.
    pub fn step(&mut self) {
        if !self.is_shown && self.began.elapsed() > SHOWN_AFTER {
            // Draws nothing where standard error is no terminal.
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
            self.is_shown = true;
        }
        self.bar.inc(1);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Works on another thread, and after a second shows that it does.
pub fn while_working<T: Send>(what: &'static str, work: impl FnOnce() -> T + Send) -> T {
    thread::scope(|scope| {
        let worker = scope.spawn(work);
        let began = Instant::now();
        let mut spinner: Option<ProgressBar> = None;
        while !worker.is_finished() {
            // Short naps first: quick work should not wait for its end to be noticed.
            let nap = (began.elapsed() / 8).clamp(Duration::from_micros(200), Duration::from_millis(100));
            thread::sleep(nap);
            if began.elapsed() > SHOWN_AFTER {
                let spinner = spinner.get_or_insert_with(|| ProgressBar::new_spinner().with_message(what));
                spinner.tick();
            }
        }
        if let Some(spinner) = spinner {
            spinner.finish_and_clear();
        }
        worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}
