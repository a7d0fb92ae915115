//! What a pass finds for each body, by the response that asks.

use super::contacts::BodyPlanes;
use super::paper::PaperResult;
use crate::question::Edge;

/// What the pass found for one body.
#[derive(Clone, Debug, PartialEq)]
pub enum BodyResult {
    /// For the paper's response.
    Paper(PaperResult),
    /// For contacts.
    Planes(BodyPlanes),
    /// Of classes alone: the samples inside, ascending.
    Inside(Vec<u32>),
}

impl BodyResult {
    /// What was found for the paper's response, if that was asked.
    pub fn paper(&self) -> Option<&PaperResult> {
        match self {
            BodyResult::Paper(paper) => Some(paper),
            BodyResult::Planes(_) | BodyResult::Inside(_) => None,
        }
    }

    /// What was found for contacts, if these were asked.
    pub fn planes(&self) -> Option<&BodyPlanes> {
        match self {
            BodyResult::Planes(planes) => Some(planes),
            BodyResult::Paper(_) | BodyResult::Inside(_) => None,
        }
    }

    /// The samples inside, of a pass for classes alone.
    pub fn inside(&self) -> Option<&[u32]> {
        match self {
            BodyResult::Inside(inside) => Some(inside),
            BodyResult::Paper(_) | BodyResult::Planes(_) => None,
        }
    }

    /// Whether no sample is inside the hull.
    pub fn is_clear(&self) -> bool {
        match self {
            BodyResult::Paper(paper) => paper.is_clear(),
            BodyResult::Planes(planes) => planes.samples.is_empty(),
            BodyResult::Inside(inside) => inside.is_empty(),
        }
    }

    /// How many samples are inside the hull.
    pub fn inside_count(&self) -> usize {
        match self {
            BodyResult::Paper(paper) => paper.inside.len(),
            BodyResult::Planes(planes) => planes.samples.len(),
            BodyResult::Inside(inside) => inside.len(),
        }
    }

    /// How far the edges of the samples inside are, metres; those without one are left out.
    pub(super) fn distances_m(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        let (inside, planes) = match self {
            BodyResult::Paper(paper) => (&paper.inside[..], &[][..]),
            BodyResult::Planes(planes) => (&[][..], &planes.samples[..]),
            BodyResult::Inside(_) => (&[][..], &[][..]),
        };
        let inside = inside.iter().filter_map(|inside| Some((inside.sample, inside.edge?.distance_m)));
        inside.chain(planes.iter().filter_map(|found| Some((found.sample, found.plane?.distance_m))))
    }
}

/// What is known of a sample inside the hull while its body is asked about.
#[derive(Clone, Copy, Debug)]
pub(super) struct FoundSample {
    /// The sample's index in its body.
    pub sample: u32,
    /// How many cameras say inside.
    pub inside_count: u32,
    /// The nearest edge, or plane; `None` if no camera has one, or before it is asked for.
    pub edge: Option<Edge>,
}

impl FoundSample {
    pub fn new(sample: u32, inside_count: usize) -> FoundSample {
        FoundSample { sample, inside_count: inside_count as u32, edge: None }
    }
}
