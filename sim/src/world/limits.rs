//! What a world may hold, so that a step takes bounded time and memory. One check for scenes, kept worlds and bodies that
//! come later; the overlapping pairs are counted again before each step of a world that could have too many.

use super::{Body, BodySamples};
use crate::scene::{BodySpec, MAX_BODIES};
use crate::solid::Solid;
use hull::{Pose, Shape};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;
use thiserror::Error;

/// Samples of all moving bodies at most: half of what one question may hold, and a quarter of a second of a node's work.
pub const MAX_SAMPLES: usize = 500_000;
/// Samples of all different shapes at most, those of fixed bodies too: 24 MB.
pub(super) const MAX_KEPT_SAMPLES: usize = 2_000_000;
/// Pairs of bodies whose boxes overlap at most: those of a hundred bodies at one place. Piles have two to three a body. The worst
/// shapes, hulls of 256 corners, cost the solver 0.3 ms a pair; a thousand boxes at one place took it 12 s and 2.2 GB a step.
pub const MAX_PAIRS: usize = 5 * MAX_BODIES;

/// What a world holds too much of. Every message is one line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum LimitError {
    /// Too many bodies.
    #[error("{found} bodies, expected at most {MAX_BODIES}")]
    Bodies {
        /// How many there would be.
        found: usize,
    },
    /// The moving bodies have too many samples.
    #[error("body `{body}` makes it {found} samples of all moving bodies, expected at most {MAX_SAMPLES}")]
    MovingSamples {
        /// The body that passes the limit.
        body: String,
        /// Samples with it.
        found: usize,
    },
    /// The different shapes have too many samples.
    #[error(
        "body `{body}` makes it {found} samples of all different shapes, expected at most {MAX_KEPT_SAMPLES}"
    )]
    KeptSamples {
        /// The body that passes the limit.
        body: String,
        /// Samples with it.
        found: usize,
    },
    /// Too many bodies overlap.
    #[error(
        "{found} pairs of overlapping bodies, expected at most {MAX_PAIRS}: body `{body}` overlaps {others} others"
    )]
    Pairs {
        /// Number of overlapping pairs.
        found: usize,
        /// The body in most pairs.
        body: String,
        /// In how many.
        others: usize,
    },
}

/// The samples of bodies so far.
#[derive(Default)]
pub(super) struct SampleCount {
    moving: usize,
    /// Samples of every shape, by its address: bodies of equal solids share it.
    kept: BTreeMap<*const Shape, usize>,
}

impl SampleCount {
    /// The samples of bodies that are within the limits.
    pub fn of(bodies: &[Body]) -> SampleCount {
        let mut count = SampleCount::default();
        for body in bodies {
            count.add(body.asked_shapes(), body.fixed);
        }
        count
    }

    fn add(&mut self, shapes: impl Iterator<Item = Arc<Shape>>, fixed: bool) {
        for shape in shapes {
            let samples = shape.samples_body().len();
            self.moving += if fixed { 0 } else { samples };
            self.kept.insert(Arc::as_ptr(&shape), samples);
        }
    }

    /// Counts another body; fails if that is too much.
    pub fn admit(&mut self, spec: &BodySpec, samples: &BodySamples) -> Result<(), LimitError> {
        self.add(samples.asked_shapes(), spec.fixed);
        let body = || spec.name.clone();
        if self.moving > MAX_SAMPLES && !spec.fixed {
            return Err(LimitError::MovingSamples { body: body(), found: self.moving });
        }
        let found = self.kept.values().sum();
        if found > MAX_KEPT_SAMPLES {
            return Err(LimitError::KeptSamples { body: body(), found });
        }
        Ok(())
    }
}

/// A body as it takes part in pairs.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a> {
    pub name: &'a str,
    pub solid: &'a Solid,
    pub pose: &'a Pose,
    pub fixed: bool,
}

impl<'a> From<&'a Body> for Placed<'a> {
    fn from(body: &'a Body) -> Placed<'a> {
        Placed { name: &body.name, solid: &body.solid, pose: &body.pose, fixed: body.fixed }
    }
}

impl<'a> From<&'a BodySpec> for Placed<'a> {
    fn from(spec: &'a BodySpec) -> Placed<'a> {
        Placed { name: &spec.name, solid: &spec.solid, pose: &spec.pose, fixed: spec.fixed }
    }
}

/// The box around a body along the axes of the world, metres.
struct WorldBox {
    low_m: Vector3<f64>,
    high_m: Vector3<f64>,
    fixed: bool,
    index: usize,
}

impl WorldBox {
    fn of((index, body): (usize, Placed<'_>)) -> WorldBox {
        let body_from_world = body.pose.rotation().transpose();
        let reach_m = |sign: f64| {
            Vector3::from_fn(|axis, _| {
                let direction_world = Vector3::from_fn(|row, _| if row == axis { sign } else { 0.0 });
                sign * body.solid.reach_m(body_from_world * direction_world)
            })
        };
        let origin_m = Vector3::from(body.pose.position_m());
        WorldBox {
            low_m: origin_m + reach_m(-1.0),
            high_m: origin_m + reach_m(1.0),
            fixed: body.fixed,
            index,
        }
    }

    /// Whether the solver looks for contacts of the two.
    fn overlaps(&self, other: &WorldBox) -> bool {
        let apart = |axis| self.high_m[axis] < other.low_m[axis] || other.high_m[axis] < self.low_m[axis];
        !(self.fixed && other.fixed || (0..3).any(apart))
    }
}

/// Fails if so many bodies overlap that a step would take seconds. Free for fewer bodies than can make so many pairs.
pub(super) fn check_pairs<'a, T: Into<Placed<'a>>>(
    bodies: impl ExactSizeIterator<Item = T> + Clone,
) -> Result<(), LimitError> {
    let count = bodies.len();
    if count * count.saturating_sub(1) / 2 <= MAX_PAIRS {
        return Ok(());
    }
    let overlaps = overlaps_of(bodies.clone().map(Into::into));
    let found = overlaps.iter().sum::<usize>() / 2;
    let worst = bodies.zip(&overlaps).max_by_key(|(_, overlaps)| **overlaps);
    match worst {
        Some((body, &others)) if found > MAX_PAIRS => {
            Err(LimitError::Pairs { found, body: body.into().name.to_owned(), others })
        }
        _ => Ok(()),
    }
}

/// How many others each body overlaps.
fn overlaps_of<'a>(bodies: impl Iterator<Item = Placed<'a>>) -> Vec<usize> {
    let mut boxes: Vec<WorldBox> = bodies.enumerate().map(WorldBox::of).collect();
    let axis = longest_axis(&boxes);
    boxes.sort_unstable_by(|one, other| one.low_m[axis].total_cmp(&other.low_m[axis]));
    let mut overlaps = vec![0; boxes.len()];
    for (place, one) in boxes.iter().enumerate() {
        let near = boxes[place + 1..].iter().take_while(|other| other.low_m[axis] <= one.high_m[axis]);
        for other in near.filter(|other| one.overlaps(other)) {
            overlaps[one.index] += 1;
            overlaps[other.index] += 1;
        }
    }
    overlaps
}

/// The axis along which the boxes lie farthest apart.
fn longest_axis(boxes: &[WorldBox]) -> usize {
    let deviation = |axis: usize| {
        let mean = boxes.iter().map(|one| one.low_m[axis]).sum::<f64>() / boxes.len() as f64;
        boxes.iter().map(|one| (one.low_m[axis] - mean).abs()).sum::<f64>()
    };
    (0..3).max_by(|&one, &other| deviation(one).total_cmp(&deviation(other))).unwrap_or_default()
}
