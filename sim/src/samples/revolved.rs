//! Samples of surfaces of revolution about body Y: rings of points along a profile.
//!
//! Two points at radii ρ₁, ρ₂ from the axis and an angle φ apart are at most
//! √(profile distance² + ρ₁·ρ₂·φ²) from each other. A ring answers for the profile half-way to its
//! neighbours; with rings `reach·√2` apart the first term is half of `reach²`, and enough points on the
//! ring keep the second below the other half.

use super::faces::steps;
use core::f64::consts::{FRAC_PI_2, PI, TAU};

/// A piece of the profile, from the top down, along which the radius only grows or only shrinks.
#[derive(Clone, Copy, Debug)]
pub(super) enum ProfilePiece {
    /// From one (radius, y) to another, metres.
    Line { from: [f64; 2], to: [f64; 2] },
    /// A quarter circle about a point of the axis: from pole to equator if upper, or on to the other pole.
    Arc { centre_y_m: f64, radius_m: f64, upper: bool },
}

impl ProfilePiece {
    fn length_m(&self) -> f64 {
        match self {
            ProfilePiece::Line { from, to } => {
                let (across, down) = (to[0] - from[0], to[1] - from[1]);
                (across * across + down * down).sqrt()
            }
            ProfilePiece::Arc { radius_m, .. } => FRAC_PI_2 * radius_m,
        }
    }

    /// (radius, y) at a share of the piece's length.
    fn at(&self, share: f64) -> [f64; 2] {
        match *self {
            ProfilePiece::Line { from, to } => {
                [0, 1].map(|i| if share == 1.0 { to[i] } else { from[i] + (to[i] - from[i]) * share })
            }
            ProfilePiece::Arc { centre_y_m, radius_m, upper } => {
                let (sine, cosine) = libm::sincos(FRAC_PI_2 * share);
                // At the poles the radius is zero, not a rounding error.
                let (inner, outer) = if share == 1.0 { (0.0, 1.0) } else { (cosine, sine) };
                if upper {
                    [radius_m * outer, centre_y_m + radius_m * inner]
                } else {
                    [radius_m * inner, centre_y_m - radius_m * outer]
                }
            }
        }
    }
}

/// The rings of a whole profile; where two pieces meet there is one ring.
pub(super) fn points(pieces: &[ProfilePiece], reach_m: f64) -> Vec<[f64; 3]> {
    let mut points = vec![];
    for (index, piece) in pieces.iter().enumerate() {
        let count = steps(piece.length_m(), reach_m);
        let half = 0.5 / count as f64;
        let mut widest_before = 0.0f64;
        if index > 0 {
            let before = pieces[index - 1];
            let half_before = 0.5 / steps(before.length_m(), reach_m) as f64;
            widest_before = before.at(1.0 - half_before)[0];
        }
        let last = if index + 1 == pieces.len() { count } else { count - 1 };
        for ring in 0..=last {
            let share = ring as f64 / count as f64;
            let [radius_m, y_m] = piece.at(share);
            let above = if ring == 0 { widest_before } else { piece.at(share - half)[0] };
            let below = if ring == count { 0.0 } else { piece.at(share + half)[0] };
            push_ring(radius_m, y_m, radius_m.max(above).max(below), reach_m, &mut points);
        }
    }
    points
}

/// A ring's points; they answer for surface points no farther from the axis than `widest_m`.
fn push_ring(radius_m: f64, y_m: f64, widest_m: f64, reach_m: f64, points: &mut Vec<[f64; 3]>) {
    let across_m = reach_m * core::f64::consts::FRAC_1_SQRT_2;
    let count = (PI * (radius_m * widest_m).sqrt() / across_m).ceil().max(1.0) as usize;
    for index in 0..count {
        let (sine, cosine) = libm::sincos(TAU * index as f64 / count as f64);
        points.push([radius_m * cosine, y_m, radius_m * sine]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_are_single_points_and_joints_single_rings() {
        let pieces = [
            ProfilePiece::Arc { centre_y_m: 0.0, radius_m: 0.1, upper: true },
            ProfilePiece::Arc { centre_y_m: 0.0, radius_m: 0.1, upper: false },
        ];
        let points = points(&pieces, 0.03);
        let level = |y: f64| points.iter().filter(|p| (p[1] - y).abs() < 1e-12).count();
        assert_eq!((level(0.1), level(-0.1)), (1, 1));
        let equator = (PI * 0.1 / (0.03 * 0.5f64.sqrt())).ceil() as usize;
        assert_eq!(level(0.0), equator);
    }
}
