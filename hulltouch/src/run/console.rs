//! The live line on a terminal, what systemd hears, and the pictures of a run.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use coordinator::{GoneOn, Progress, Snapshot, Watcher};
use hull::Observer;
use indicatif::{ProgressBar, ProgressStyle};
use telemetry::{Beat, systemd};

use super::run_setup::Setup;
use super::snapshot::Album;

/// The live line and the pictures.
pub struct Console {
    line: ProgressBar,
    album: Option<Album>,
    next_picture_s: f64,
    /// Of the run's loop; none if it waits for film however long that takes.
    beat: Option<Arc<Beat>>,
    /// Why there is no hull, as systemd heard it last.
    told: Option<String>,
}

/// Film time between pictures, seconds.
const PICTURE_EVERY_S: f64 = 1.0;

impl Console {
    /// A console of a run whose loop has this beat.
    pub fn new(setup: &Setup, observers: &[Arc<Observer>], beat: Arc<Beat>) -> Console {
        let line = if setup.outlets.live_line { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{msg}") {
            line.set_style(style);
        }
        let floor_m = setup.scene.floor().map(|floor| floor.height_m);
        let begin =
            |folder: &PathBuf| Album::begin(folder, setup.file.rig.clone(), observers.to_vec(), floor_m);
        let album = setup.outlets.snapshots.as_ref().map(begin);
        let beat = (!setup.lock_step).then_some(beat);
        // No reason at all is one: the first report is told.
        Console { line, album, next_picture_s: 0.5, beat, told: Some(String::new()) }
    }

    /// Removes the line; returns the pictures, which may still be drawn.
    pub fn finish(self) -> Option<Album> {
        self.line.finish_and_clear();
        self.album
    }

    /// Says whether there is a hull, whenever that changes.
    fn tell_systemd(&mut self, hull_unavailable: Option<&str>) {
        if self.told.as_deref() == hull_unavailable {
            return;
        }
        self.told = hull_unavailable.map(ToOwned::to_owned);
        match hull_unavailable {
            None => systemd::status("runs"),
            Some(why) => systemd::status(&format!("runs without a hull: {why}")),
        }
    }
}

impl Watcher for Console {
    fn gone_on(&mut self, from: &GoneOn) {
        let GoneOn { scene, bodies, steps, time_s, age_s } = from;
        self.line.suspend(|| {
            // A closed standard error is no reason not to run.
            let _ = writeln!(
                std::io::stderr(),
                "going on from the world that the nodes remember: scene {scene}, {bodies} bodies, step {steps} \
                 ({time_s:.1} s), {age_s:.1} s old; --fresh starts over"
            );
        });
    }

    fn turned(&mut self) {
        if let Some(beat) = &self.beat {
            beat.works();
        }
    }

    fn progress(&mut self, progress: &Progress) {
        self.tell_systemd(progress.hull_unavailable.as_deref());
        let hull =
            progress.hull_unavailable.as_ref().map_or_else(String::new, |why| format!("  NO HULL: {why}"));
        self.line.set_message(format!(
            "{:6.1} s  frame {}  {:4.0} steps/s  {:3.0} passes/s  p50 {:.2} ms  p99 {:.2} ms  {} samples  {} contacts  {:.0} KB/s{hull}",
            progress.film_s,
            progress.frame.map_or_else(|| "-".to_owned(), |frame| frame.to_string()),
            progress.steps_per_s,
            progress.passes_per_s,
            progress.p50_ms,
            progress.p99_ms,
            progress.samples,
            progress.contacts,
            progress.bytes_per_s / 1e3,
        ));
    }

    fn wants_snapshot(&mut self, film_s: f64) -> bool {
        let wants = self.album.is_some() && film_s >= self.next_picture_s;
        if wants {
            self.next_picture_s += PICTURE_EVERY_S;
        }
        wants
    }

    fn snapshot(&mut self, snapshot: Snapshot<'_>) {
        if let Some(album) = &self.album {
            album.add(snapshot);
        }
    }
}
