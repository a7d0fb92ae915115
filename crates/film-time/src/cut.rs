//! Where film is cut into frames: in the widest gap between the cameras' own phases, so that what they capture at
//! about the same time is one frame. Plain decisions: time is an argument.

use std::collections::BTreeMap;

use crate::{CameraPace, FrameReport, Stamps};

/// Cameras whose pace is not known so long after the first frame are not waited for, seconds of film.
const PATIENCE_S: f64 = 5.0;
/// The cut stays while it keeps this share of the distance from all captures that it could have.
const GOOD_SHARE: f64 = 0.5;
/// The phase is within this many periods: a little more than half, so that it does not turn back and forth.
const MOST_PHASE: f64 = 0.75;

/// Of a run: the phases of its live cameras, and what follows from them.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// By place in the rig; `None` while it is not known.
    phases: BTreeMap<u16, Option<f64>>,
    first_s: Option<f64>,
    phase: Option<f64>,
}

impl Cut {
    /// Takes note of a node's frame.
    pub fn heard(&mut self, report: &FrameReport) {
        let first_s = *self.first_s.get_or_insert(report.capture_time_s);
        let mut changed = false;
        for camera in report.cameras.iter().filter(|camera| camera.stamps != Stamps::Index) {
            let known = camera.pace.map(|CameraPace { phase, frames_per_s: _ }| phase);
            changed |= self.phases.insert(camera.rig_index, known) != Some(known);
        }
        if changed || self.phase.is_none() {
            let is_late = report.capture_time_s - first_s > PATIENCE_S;
            self.decide(is_late);
        }
    }

    /// Frame `n` is what is captured nearest to `n` plus this many periods of film; `None` before that is decided, and
    /// without live cameras.
    pub fn phase(&self) -> Option<f64> {
        self.phase
    }

    fn decide(&mut self, is_late: bool) {
        if self.phase.is_none() && !is_late && self.phases.values().any(Option::is_none) {
            return;
        }
        let mut phases: Vec<f64> = self.phases.values().flatten().copied().collect();
        phases.sort_by(f64::total_cmp);
        let Some((at, width)) = widest_gap(&phases) else { return };
        if let Some(phase) = self.phase {
            let distance = |of: &f64| {
                let past = (of - (phase + 0.5)).rem_euclid(1.0);
                past.min(1.0 - past)
            };
            let least = phases.iter().map(distance).fold(1.0, f64::min);
            if least >= GOOD_SHARE * 0.5 * width {
                return;
            }
        }
        // Halfway from cut to cut.
        let best = at + 0.5 * width + 0.5;
        let near = self.phase.unwrap_or_default();
        let nearest = best + (near - best).round();
        self.phase = Some(if nearest.abs() > MOST_PHASE { nearest - nearest.round() } else { nearest });
    }
}

/// Where the widest gap between phases begins, and its width; phases ascend from 0 to 1 and come round.
fn widest_gap(phases: &[f64]) -> Option<(f64, f64)> {
    let (first, last) = (*phases.first()?, *phases.last()?);
    let gaps = phases.windows(2).map(|pair| (pair[0], pair[1] - pair[0]));
    gaps.chain([(last, first + 1.0 - last)]).max_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraReport;

    /// Cameras of a node that film at these phases, seen at a film time.
    fn report(phases: &[Option<f64>], capture_time_s: f64) -> FrameReport {
        let camera = |(place, phase): (usize, &Option<f64>)| CameraReport {
            rig_index: place as u16,
            admitted: None,
            area: 0,
            silhouette_bytes: 0,
            segment_ms: 0.0,
            late_s: 0.0,
            stamps: Stamps::Arrival,
            pace: phase.map(|phase| CameraPace { phase, frames_per_s: 30.0 }),
        };
        let cameras = phases.iter().enumerate().map(camera).collect();
        FrameReport { frame: 0, capture_time_s, captured_unix_s: 0.0, cameras, skipped: 0 }
    }

    fn cut_of(phases: &[f64]) -> f64 {
        let mut cut = Cut::default();
        cut.heard(&report(&phases.iter().copied().map(Some).collect::<Vec<_>>(), 0.0));
        cut.phase().expect("decided")
    }

    #[test]
    fn the_cut_lies_in_the_middle_of_the_widest_gap() {
        for (phases, expected) in [
            (&[0.0][..], 0.0),
            (&[0.3], 0.3),
            (&[0.9], -0.1),
            (&[0.45, 0.55], 0.5),
            (&[0.1, 0.2, 0.6], 0.35),
            (&[0.1, 0.9], 0.0),
        ] {
            let phase = cut_of(phases);
            assert!((phase - expected).abs() < 1e-9 || (phase + 0.5).abs() < 1e-9, "{phases:?}: {phase}");
        }
    }

    #[test]
    fn all_cameras_are_waited_for_and_none_for_ever() {
        let mut cut = Cut::default();
        cut.heard(&report(&[Some(0.2), None], 1.0));
        cut.heard(&report(&[Some(0.2), None], 5.9));
        assert_eq!(cut.phase(), None);
        cut.heard(&report(&[Some(0.2), None], 6.1));
        assert!(cut.phase().is_some_and(|phase| (phase - 0.2).abs() < 1e-9));
    }

    #[test]
    fn a_cut_stays_until_a_camera_comes_near_and_never_leaves_its_range() {
        let mut cut = Cut::default();
        let (mut before, mut changes) = (None, 0);
        for step in 0..4000 {
            let phase = (0.3 + f64::from(step) * 0.001).rem_euclid(1.0);
            cut.heard(&report(&[Some(phase), Some((phase + 0.2).rem_euclid(1.0))], 0.0));
            let now = cut.phase().expect("decided");
            assert!(now.abs() <= MOST_PHASE);
            changes += u32::from(before.replace(now) != Some(now));
        }
        assert!((10..40).contains(&changes), "four turns, {changes} changes");
    }
}
