//! What the person does: the names of the motions and their timing.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use thiserror::Error;

use crate::motions::blow;
use crate::motions::lift::{RISE_S, TILT_S};

/// Seconds of film for which every motion first holds the neutral pose (arms at the sides).
pub const NEUTRAL_S: f64 = 1.0;

/// The box of the first lift rises between these film times, seconds, by [`crate::props::BOX_RISE_M`].
pub const LIFT_RISE_S: (f64, f64) = (NEUTRAL_S + RISE_S.0, NEUTRAL_S + RISE_S.1);
/// It tilts between the first two of these film times, and back between the last two.
pub const LIFT_TILT_S: [f64; 4] =
    [NEUTRAL_S + TILT_S[0], NEUTRAL_S + TILT_S[1], NEUTRAL_S + TILT_S[2], NEUTRAL_S + TILT_S[3]];

/// How fast a motion is where it is steady, in whole millimetres a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Speed(u16);

impl Speed {
    /// What it may be, m/s.
    pub const RANGE_M_S: RangeInclusive<f64> = 0.1..=20.0;

    /// The speed nearest to one, m/s; `None` out of [`Speed::RANGE_M_S`].
    pub fn from_m_s(m_s: f64) -> Option<Speed> {
        Speed::RANGE_M_S.contains(&m_s).then(|| Speed((1e3 * m_s).round() as u16))
    }

    /// The speed, m/s.
    pub fn m_s(self) -> f64 {
        f64::from(self.0) / 1e3
    }
}

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
    /// Holds the left arm straight out to the side, with a fist.
    Reach,
    /// Swings the left arm level from behind to the front, straight, with a fist whose knuckles reach a speed.
    Swing(Speed),
    /// Glides to its left at a speed, without a step, 1.5 m in all.
    Glide(Speed),
}

/// The names for messages.
const NAMES: &str = "idle, wave, walk, punch, sweep, lift, tray, push, squeeze, reach, or swing or glide with m/s, as `swing 2`";

/// A motion's name is not one of those known.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("motion {found:?}, expected one of {NAMES}")]
pub struct UnknownMotion {
    /// What was given.
    pub found: String,
}

impl Motion {
    /// All motions; those with a speed at 2 m/s.
    pub const ALL: [Motion; 12] = [
        Motion::Idle,
        Motion::Wave,
        Motion::Walk,
        Motion::Punch,
        Motion::Sweep,
        Motion::Lift,
        Motion::Tray,
        Motion::Push,
        Motion::Squeeze,
        Motion::Reach,
        Motion::Swing(Speed(2000)),
        Motion::Glide(Speed(2000)),
    ];

    /// The name used on command lines and in files, there followed by its speed if it has one.
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
            Motion::Reach => "reach",
            Motion::Swing(_) => "swing",
            Motion::Glide(_) => "glide",
        }
    }

    /// Its speed, if it has one.
    pub fn speed(self) -> Option<Speed> {
        match self {
            Motion::Swing(speed) | Motion::Glide(speed) => Some(speed),
            _ => None,
        }
    }

    /// The same motion at a speed; `None` if it has none.
    pub fn at(self, speed: Speed) -> Option<Motion> {
        match self {
            Motion::Swing(_) => Some(Motion::Swing(speed)),
            Motion::Glide(_) => Some(Motion::Glide(speed)),
            _ => None,
        }
    }

    /// From when to when it is at its speed for the first time, film time, seconds; `None` if it has no speed.
    pub fn steady_s(self) -> Option<(f64, f64)> {
        let (from_s, to_s) = match self {
            Motion::Swing(speed) => blow::swing_steady_s(speed.m_s()),
            Motion::Glide(speed) => blow::glide_steady_s(speed.m_s()),
            _ => return None,
        };
        Some((NEUTRAL_S + from_s, NEUTRAL_S + to_s))
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
                | Motion::Squeeze
                | Motion::Swing(_)
                | Motion::Glide(_) => 0.0,
                Motion::Reach => blow::REACH_S,
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
            // It holds still: any period will do.
            Motion::Reach => 1.0,
            Motion::Swing(speed) => blow::swing_period_s(speed.m_s()),
            Motion::Glide(speed) => blow::glide_period_s(speed.m_s()),
        }
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.speed() {
            None => formatter.pad(self.name()),
            Some(speed) => formatter.pad(&format!("{} {}", self.name(), speed.m_s())),
        }
    }
}

impl FromStr for Motion {
    type Err = UnknownMotion;

    fn from_str(text: &str) -> Result<Motion, UnknownMotion> {
        let unknown = || UnknownMotion { found: text.to_owned() };
        let (name, m_s) = text.split_once(' ').map_or((text, None), |(name, m_s)| (name, Some(m_s)));
        let motion = Motion::ALL.into_iter().find(|motion| motion.name() == name).ok_or_else(unknown)?;
        match (motion.speed(), m_s) {
            (None, None) => Ok(motion),
            (Some(_), Some(m_s)) => {
                let speed = m_s.parse().ok().and_then(Speed::from_m_s);
                speed.and_then(|speed| motion.at(speed)).ok_or_else(unknown)
            }
            _ => Err(unknown()),
        }
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
        for wrong in ["jump", "swing", "swing fast", "swing 0", "swing 21", "swing nan", "wave 2", "", " "] {
            let error = wrong.parse::<Motion>().expect_err(wrong).to_string();
            assert!(error.starts_with(&format!("motion {wrong:?}, expected one of idle, wave")), "{error}");
        }
        assert_eq!(
            "glide 3.5".parse::<Motion>().map(|motion| motion.to_string()),
            Ok("glide 3.5".to_owned())
        );
    }
}
