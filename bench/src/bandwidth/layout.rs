//! The six layouts, and what is known of each once it has been measured.

use crate::cluster::connection::PASSES_PER_FRAME;
use crate::cluster::film::FPS;

/// Where bodies and silhouettes meet, and as what they travel (spec §7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layout {
    /// Images are gathered, a byte a pixel.
    RawImages,
    /// Silhouettes are gathered, a bit a pixel.
    BitMasks,
    /// Silhouettes are gathered as runs.
    Runs,
    /// Silhouettes are gathered as runs, compressed.
    RunsLz4,
    /// Points of the world are asked about.
    RawPoints,
    /// Registered bodies at poses are asked about.
    RegisteredBodies,
}

impl Layout {
    /// Those whose silhouettes travel.
    pub const GATHERED: [Layout; 4] = [Layout::RawImages, Layout::BitMasks, Layout::Runs, Layout::RunsLz4];

    /// As in the JSON.
    pub fn name(self) -> &'static str {
        match self {
            Layout::RawImages => "raw_images",
            Layout::BitMasks => "bit_masks",
            Layout::Runs => "runs",
            Layout::RunsLz4 => "runs_lz4",
            Layout::RawPoints => "raw_points",
            Layout::RegisteredBodies => "registered_bodies",
        }
    }

    /// True if silhouettes travel, once a frame; else questions do, with every pass.
    pub fn is_gathered(self) -> bool {
        Layout::GATHERED.contains(&self)
    }
}

/// How often things happen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Frames of film a second.
    pub frames_per_s: f64,
    /// Passes a second.
    pub passes_per_s: f64,
}

/// Bodies stepped at four times the rate of film.
pub const STEPS: Rates = Rates { frames_per_s: FPS, passes_per_s: FPS * PASSES_PER_FRAME as f64 };
/// One question a frame of film.
pub const FRAMES_ONLY: Rates = Rates { frames_per_s: FPS, passes_per_s: FPS };

/// What one layout costs, for all cameras together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// The layout.
    pub layout: Layout,
    /// The encoding of numbers on the wire: `exact` or `quantised`.
    pub precision: &'static str,
    /// Bytes that every frame takes: its news, and its silhouettes if they are gathered.
    pub bytes_per_frame: f64,
    /// Bytes that every pass takes.
    pub bytes_per_pass: f64,
    /// Computation that a new frame needs before its first pass can be answered, milliseconds.
    pub frame_ms: f64,
    /// Computation of a pass, one thing after the other, milliseconds.
    pub pass_ms: f64,
    /// Round trips of a new frame.
    pub frame_trips: f64,
    /// Round trips of a pass.
    pub pass_trips: f64,
}

impl Cost {
    /// Bytes a second.
    pub fn bytes_per_s(&self, rates: Rates) -> f64 {
        self.bytes_per_frame * rates.frames_per_s + self.bytes_per_pass * rates.passes_per_s
    }

    /// Bytes of a second divided by its passes.
    pub fn mean_bytes_per_pass(&self, rates: Rates) -> f64 {
        self.bytes_per_s(rates) / rates.passes_per_s
    }

    /// How long the first pass over a new frame takes, milliseconds, and the mean over all passes, where
    /// everything crosses one link of the coordinator and a round trip takes `trip_s` beside.
    pub fn pass_takes_ms(&self, link_bits_per_s: f64, trip_s: f64, rates: Rates) -> (f64, f64) {
        let crossing_ms = |bytes: f64| bytes * 8e3 / link_bits_per_s;
        let frame_ms = crossing_ms(self.bytes_per_frame) + self.frame_ms + self.frame_trips * trip_s * 1e3;
        let pass_ms = crossing_ms(self.bytes_per_pass) + self.pass_ms + self.pass_trips * trip_s * 1e3;
        // A layout that gathers nothing does not wait for frame reports.
        let frame_ms = if self.layout.is_gathered() { frame_ms } else { 0.0 };
        (frame_ms + pass_ms, frame_ms * rates.frames_per_s / rates.passes_per_s + pass_ms)
    }

    /// Passes a second that a link carries, film going on.
    pub fn passes_per_s_on(&self, link_bits_per_s: f64, rates: Rates) -> f64 {
        if self.layout.is_gathered() {
            // More passes cost nothing; more frames do.
            let frames_per_s = link_bits_per_s / (8.0 * self.bytes_per_frame);
            return frames_per_s * rates.passes_per_s / rates.frames_per_s;
        }
        let left = link_bits_per_s / 8.0 - self.bytes_per_frame * rates.frames_per_s;
        (left / self.bytes_per_pass).max(0.0)
    }
}

/// How many bodies make a layout that asks send as much as one that gathers: the cost of asking is taken as
/// straight between the measured numbers of bodies, and beyond the last goes on like between the last two.
/// `None` if asking costs more even for the least.
pub fn crossing(asked: &[(usize, f64)], gathered: f64) -> Option<Crossing> {
    let (&first, &last) = (asked.first()?, asked.last()?);
    if first.1 > gathered {
        return None;
    }
    let segment = asked.windows(2).find(|pair| pair[1].1 > gathered).or(asked.windows(2).last());
    let Some(&[a, b]) = segment else { return Some(Crossing { bodies: first.0 as f64, beyond: true }) };
    let slope = (b.1 - a.1) / (b.0 - a.0) as f64;
    let bodies = if slope > 0.0 { a.0 as f64 + (gathered - a.1) / slope } else { f64::INFINITY };
    Some(Crossing { bodies, beyond: gathered >= last.1 })
}

/// Where two layouts send the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// For how many bodies.
    pub bodies: f64,
    /// True if it lies beyond what was measured.
    pub beyond: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATES: Rates = Rates { frames_per_s: 30.0, passes_per_s: 120.0 };

    fn cost(layout: Layout) -> Cost {
        let gathered = layout.is_gathered();
        Cost {
            layout,
            precision: "exact",
            bytes_per_frame: if gathered { 100_000.0 } else { 1_000.0 },
            bytes_per_pass: if gathered { 0.0 } else { 50_000.0 },
            frame_ms: if gathered { 4.0 } else { 0.0 },
            pass_ms: if gathered { 3.0 } else { 1.0 },
            frame_trips: 1.0,
            pass_trips: if gathered { 0.0 } else { 5.0 },
        }
    }

    #[test]
    fn a_frame_is_shared_by_its_passes_and_a_question_is_not() {
        let (gathered, asked) = (cost(Layout::RunsLz4), cost(Layout::RegisteredBodies));
        assert_eq!((gathered.bytes_per_s(RATES), gathered.mean_bytes_per_pass(RATES)), (3e6, 25_000.0));
        assert_eq!(asked.bytes_per_s(RATES), 6.03e6);
        // At 1 Gbit/s a megabyte takes 8 ms.
        let (first_ms, mean_ms) = gathered.pass_takes_ms(1e9, 1e-4, RATES);
        assert!(
            (first_ms - (0.8 + 4.0 + 0.1 + 3.0)).abs() < 1e-9 && (mean_ms - (4.9 / 4.0 + 3.0)).abs() < 1e-9
        );
        let (first_ms, mean_ms) = asked.pass_takes_ms(1e9, 1e-4, RATES);
        assert!((first_ms - (0.4 + 1.0 + 0.5)).abs() < 1e-9 && first_ms == mean_ms);
        assert!((gathered.passes_per_s_on(1e9, RATES) - 5_000.0).abs() < 1e-6);
        assert!((asked.passes_per_s_on(1e9, RATES) - (1.25e8 - 3e4) / 5e4).abs() < 1e-6);
    }

    #[test]
    fn crossings_are_between_what_was_measured_or_said_to_be_beyond() {
        let asked = [(1, 10.0), (10, 100.0), (100, 1_000.0)];
        assert_eq!(crossing(&asked, 550.0), Some(Crossing { bodies: 55.0, beyond: false }));
        assert_eq!(crossing(&asked, 55.0), Some(Crossing { bodies: 5.5, beyond: false }));
        assert_eq!(crossing(&asked, 2_000.0), Some(Crossing { bodies: 200.0, beyond: true }));
        assert_eq!(crossing(&asked, 9.0), None);
        assert_eq!(crossing(&asked[..1], 20.0), Some(Crossing { bodies: 1.0, beyond: true }));
        assert_eq!(crossing(&[], 20.0), None);
    }
}
