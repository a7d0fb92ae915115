//! How far the edges of a body are worth searching at first: about as far as they were a moment before. What
//! is not found so near is asked for again, so answers never depend on it.

use super::BodyResult;
use crate::reach::Reach;

/// How far the edges of a body of which nothing is known are searched at first.
pub const FIRST_REACH: Reach = Reach::from_code(110);

/// Reaches of a body's samples, from what the pass before found.
#[derive(Clone, Debug)]
pub struct Reaches {
    /// Of samples that were outside.
    others: Reach,
    /// Of those that were inside, ascending.
    samples: Vec<(u32, Reach)>,
    /// How far the body had to move, metres; zero if it did not.
    response_m: f64,
}

impl Default for Reaches {
    /// Nothing is known.
    fn default() -> Reaches {
        Reaches { others: FIRST_REACH, samples: Vec::new(), response_m: 0.0 }
    }
}

impl Reaches {
    /// Takes over what a pass found. Between frames of film people move by centimetres.
    pub fn note(&mut self, result: &BodyResult) {
        let distances = || result.distances_m().map(|(sample, distance_m)| (sample, f64::from(distance_m)));
        let deepest_m = distances().fold(0.0, |deepest_m: f64, (_, distance_m)| deepest_m.max(distance_m));
        let about = |share: f64, distance_m: f64| Reach::covering(share * distance_m + 0.01);
        self.others = if deepest_m == 0.0 { FIRST_REACH } else { about(1.5, deepest_m) };
        let length_m = |m: [f64; 3]| m.iter().map(|part| part * part).sum::<f64>().sqrt();
        let response_m = result.paper().and_then(|paper| paper.response_m.ok());
        self.response_m = response_m.map_or(0.0, length_m);
        self.samples.clear();
        self.samples.extend(distances().map(|(sample, distance_m)| (sample, about(1.25, distance_m))));
    }

    /// The samples that were inside, ascending, and their reaches.
    pub(super) fn touched(&self) -> impl ExactSizeIterator<Item = (u32, Reach)> {
        self.samples.iter().copied()
    }

    /// The same, in the buffers of another.
    pub(super) fn copy_from(&mut self, other: &Reaches) {
        self.others = other.others;
        self.response_m = other.response_m;
        self.samples.clear();
        self.samples.extend_from_slice(&other.samples);
    }

    /// The reach of exits along the body's direction, of samples whose longest exit along their own normals
    /// is `longest_m`. One that is too short costs two rounds, one that is too long some work.
    pub(super) fn of_body(&self, longest_m: f32) -> Reach {
        let longest_m = f64::from(longest_m);
        let reach_m = if self.response_m > 0.0 {
            (2.0 * self.response_m + 0.03).max(1.25 * longest_m + 0.01)
        } else {
            4.0 * longest_m + 0.05
        };
        Reach::covering(reach_m).coarse()
    }

    /// The reach of a sample; `from` is the place in the list to look from, for ascending samples.
    pub(super) fn of(&self, sample: u32, from: &mut usize) -> Reach {
        *from += self.samples[*from..].iter().take_while(|(known, _)| *known < sample).count();
        let known = self.samples.get(*from).filter(|(known, _)| *known == sample);
        known.map_or(self.others, |(_, reach)| *reach)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{InsideSample, PaperResult};
    use super::*;
    use crate::camera::Pixel;
    use crate::question::Edge;

    fn inside(sample: u32, distance_m: f32) -> InsideSample {
        let pixel = Pixel { column: 0, row: 0 };
        let edge = Edge { distance_m, camera: 0, pixel, normal_world: [1.0, 0.0, 0.0], moved_m: None };
        InsideSample { sample, inside_count: 2, edge: Some(edge), exit_m: None }
    }

    #[test]
    fn a_sample_is_searched_about_as_far_as_its_edge_was_and_others_as_far_as_any() {
        let mut reaches = Reaches::default();
        assert_eq!(reaches.of(7, &mut 0), FIRST_REACH);
        let result = |inside| BodyResult::Paper(PaperResult { inside, ..PaperResult::default() });
        reaches.note(&result(vec![inside(3, 0.01), inside(7, 0.04)]));
        let mut from = 0;
        let found: Vec<Reach> = [1, 3, 5, 7, 9].map(|sample| reaches.of(sample, &mut from)).into();
        let (near, far, any) = (Reach::covering(0.0225), Reach::covering(0.06), Reach::covering(0.07));
        assert_eq!(found, [any, near, any, far, any]);
        reaches.note(&result(vec![]));
        assert_eq!(reaches.of(3, &mut 0), FIRST_REACH);
    }
}
