//! What the person does: the names of the motions and their timing.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::motions::lift::{RISE_S, TILT_S};

/// Seconds of film for which every motion first holds the neutral pose (arms at the sides).
pub const NEUTRAL_S: f64 = 1.0;

/// The box of the first lift rises between these film times, seconds, by [`crate::props::BOX_RISE_M`].
pub const LIFT_RISE_S: (f64, f64) = (NEUTRAL_S + RISE_S.0, NEUTRAL_S + RISE_S.1);
/// It tilts between the first two of these film times, and back between the last two.
pub const LIFT_TILT_S: [f64; 4] =
    [NEUTRAL_S + TILT_S[0], NEUTRAL_S + TILT_S[1], NEUTRAL_S + TILT_S[2], NEUTRAL_S + TILT_S[3]];

/// A looped motion of the person. Each holds the neutral pose for [`NEUTRAL_S`] first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Motion {
    /// Stands and breathes.
    Idle,
    /// Raises the right arm and waves it beside the head.
    #[default]
    Wave,
    /// Walks a circle of 0.5 m radius about (0.5, 0, 0), first towards +Z, turning left.
    Walk,
    /// Takes guard and punches to the front, right and left in turn.
    Punch,
    /// Bends, lets the arms hang in front, and sweeps them apart, each to its own side.
    Sweep,
    /// Lifts the box of [`crate::props`] off the table, holds it, tilts it, sets it down.
    Lift,
    /// Lifts the tray of [`crate::props`] off the table and carries it sideways, to the left and far to the right.
    Tray,
    /// Pushes both fists forward at a height of 1.05 m.
    Push,
    /// Presses the palms against a thing 24 cm wide at a height of 1.74 m, lifts it, lets it go.
    Squeeze,
}

/// A motion's name is not one of those known.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("motion {found:?}, expected one of idle, wave, walk, punch, sweep, lift, tray, push, squeeze")]
pub struct UnknownMotion {
    /// What was given.
    pub found: String,
}

impl Motion {
    /// All motions.
    pub const ALL: [Motion; 9] = [
        Motion::Idle,
        Motion::Wave,
        Motion::Walk,
        Motion::Punch,
        Motion::Sweep,
        Motion::Lift,
        Motion::Tray,
        Motion::Push,
        Motion::Squeeze,
    ];

    /// The name used on command lines and in files.
    pub fn name(self) -> &'static str {
        match self {
            Motion::Idle => "idle",
            Motion::Wave => "wave",
            Motion::Walk => "walk",
            Motion::Punch => "punch",
            Motion::Sweep => "sweep",
            Motion::Lift => "lift",
            Motion::Tray => "tray",
            Motion::Push => "push",
            Motion::Squeeze => "squeeze",
        }
    }

    /// Seconds since the motion began; zero before it, and for a time that is no number.
    pub(crate) fn since_s(self, time_s: f64) -> f64 {
        if time_s.is_finite() { (time_s - NEUTRAL_S).max(0.0) } else { 0.0 }
    }

    /// Film time, seconds, from which on the motion repeats itself every [`Self::period_s`].
    pub fn loop_start_s(self) -> f64 {
        NEUTRAL_S
            + match self {
                Motion::Idle
                | Motion::Sweep
                | Motion::Lift
                | Motion::Tray
                | Motion::Push
                | Motion::Squeeze => 0.0,
                Motion::Wave => crate::motions::calm::RAISE_S,
                Motion::Walk => crate::motions::walk::RAMP_S,
                Motion::Punch => crate::motions::strike::GUARD_S,
            }
    }

    /// Seconds after which the pose returns, once looping.
    pub fn period_s(self) -> f64 {
        match self {
            Motion::Idle => crate::motions::calm::BREATH_S,
            Motion::Wave => crate::motions::calm::WAVE_S,
            Motion::Walk => crate::motions::walk::LAP_S,
            Motion::Punch => crate::motions::strike::PUNCHES_S,
            Motion::Sweep => crate::motions::strike::SWEEP_PERIOD_S,
            Motion::Lift => crate::motions::lift::LIFT_PERIOD_S,
            Motion::Tray => crate::motions::carry::TRAY_PERIOD_S,
            Motion::Push => crate::motions::strike::PUSH_PERIOD_S,
            Motion::Squeeze => crate::motions::carry::SQUEEZE_PERIOD_S,
        }
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

impl FromStr for Motion {
    type Err = UnknownMotion;

    fn from_str(text: &str) -> Result<Motion, UnknownMotion> {
        Motion::ALL
            .into_iter()
            .find(|motion| motion.name() == text)
            .ok_or_else(|| UnknownMotion { found: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_others_are_refused() {
        for motion in Motion::ALL {
            assert_eq!(motion.to_string().parse(), Ok(motion));
        }
        let error = "jump".parse::<Motion>().expect_err("unknown");
        assert_eq!(
            error.to_string(),
            "motion \"jump\", expected one of idle, wave, walk, punch, sweep, lift, tray, push, squeeze"
        );
    }
}
