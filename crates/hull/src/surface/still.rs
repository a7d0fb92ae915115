//! Filters the planes of a surface: outlines flicker, and what rests on them must not.
//!
//! Samples whose normals agree look at one piece of surface. While half of a piece's samples find it within half a pixel
//! of where it was, it has not moved: all keep their planes, and an outlier is accepted once it has been one for
//! long. When a piece moves, all of the body's planes are taken as they are found, for a few frames.

use nalgebra::{Point3, Vector3};

use crate::contact::{Eye, SurfaceContact};

/// A piece that moved less than this many pixels stands still.
const STILL_PIXELS: f64 = 0.5;
/// A sample that finds the surface farther from where it was than this many pixels is an outlier.
const OUTLIER_PIXELS: f64 = 1.0;
/// Its new plane is accepted when it has been an outlier for more than so many frames in a row.
const MAX_OUTLIER_FRAMES: u8 = 6;
/// For so many frames after a piece has moved, all is taken as it is found.
const UNFILTERED_FRAMES: u8 = 5;
/// Samples look at one piece if their normals are so near: cosine of 30 degrees.
const SAME_PIECE: f64 = 0.866;
/// A sample that is new to a piece of at least so many has to wait, if its body rests: one that moves meets new surface.
const MANY: usize = 3;
/// A body rests if no sample moved farther since it was asked about before, metres.
const AT_REST_M: f64 = 3e-4;

/// The planes of a body's samples that are accepted, and those that are not yet.
#[derive(Clone, Debug, Default)]
pub(super) struct PlaneFilter {
    /// Ascending by sample.
    planes: Vec<FilteredPlane>,
    /// For how many more frames all planes are taken as they are found.
    unfiltered_frames: u8,
}

#[derive(Clone, Copy, Debug)]
struct FilteredPlane {
    contact: SurfaceContact,
    is_accepted: bool,
    /// For how many frames in a row another plane was found, or none.
    outlier_frames: u8,
}

/// What a frame says of a sample, and its filtered plane before.
struct Pair {
    new: Option<SurfaceContact>,
    old: Option<FilteredPlane>,
    /// How far the surface moved out, metres; none unless both are there.
    moved_m: Option<f64>,
    /// A pixel of the camera of the edge, there, metres.
    pixel_m: f64,
}

/// Samples of one body whose filtered normals agree.
struct Piece {
    normal: Vector3<f64>,
    moved_m: Vec<f64>,
    pixel_m: f64,
}

impl Piece {
    fn is_still(&self) -> bool {
        let mut moved_m: Vec<f64> = self.moved_m.iter().map(|moved_m| moved_m.abs()).collect();
        moved_m.sort_by(f64::total_cmp);
        moved_m[moved_m.len() / 2] <= STILL_PIXELS * self.pixel_m
    }
}

impl PlaneFilter {
    /// Whether nothing is near.
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// The planes that are accepted.
    pub fn contacts(&self) -> impl Iterator<Item = &SurfaceContact> {
        self.planes.iter().filter(|plane| plane.is_accepted).map(|plane| &plane.contact)
    }

    /// Takes in what a frame says of the samples, ascending, of a body that moved so far, metres, and whether the
    /// surface `slides`. `place` says where a sample is; planes that are no contact any more, by `is_contact`, are
    /// dropped.
    pub fn update(
        &mut self,
        seen: &[SurfaceContact],
        moved_m: f64,
        slides: bool,
        place: impl Fn(u32) -> Point3<f64>,
        is_contact: impl Fn(&SurfaceContact, f64) -> bool,
        eyes: &[Eye],
    ) {
        let is_contact = |found: &SurfaceContact| {
            found.depth_at_m(&place(found.sample), eyes).is_some_and(|depth_m| is_contact(found, depth_m))
        };
        self.planes.retain(|plane| is_contact(&plane.contact));
        let pairs = pairs(&self.planes, seen, place, eyes);
        let pieces = pieces(&pairs);
        let moves = pieces.iter().any(|piece| !piece.is_still()) || slides;
        self.unfiltered_frames =
            if moves { UNFILTERED_FRAMES } else { self.unfiltered_frames.saturating_sub(1) };
        let judged = |pair: &Pair| {
            if self.unfiltered_frames > 0 {
                pair.new.map(FilteredPlane::accepted)
            } else {
                pair.judged(&pieces, moved_m < AT_REST_M)
            }
        };
        self.planes = pairs.iter().filter_map(judged).collect();
    }
}

impl FilteredPlane {
    fn accepted(contact: SurfaceContact) -> FilteredPlane {
        FilteredPlane { contact, is_accepted: true, outlier_frames: 0 }
    }

    /// The same after one more frame as an outlier, at rest; `None` if that was one too many.
    fn after_outlier(self) -> Option<FilteredPlane> {
        let (contact, outlier_frames) = (self.contact.at_rest(), self.outlier_frames + 1);
        let is_kept = outlier_frames <= MAX_OUTLIER_FRAMES;
        is_kept.then_some(FilteredPlane { contact, outlier_frames, ..self })
    }
}

impl Pair {
    /// The filtered plane while nothing moves.
    fn judged(&self, pieces: &[Piece], is_at_rest: bool) -> Option<FilteredPlane> {
        let of_piece = |contact: &SurfaceContact| {
            pieces.iter().find(|piece| piece.normal.dot(&contact.normal()) > SAME_PIECE)
        };
        match (self.new, self.old) {
            (Some(new), Some(old)) if !old.is_accepted => {
                if !is_at_rest {
                    return Some(FilteredPlane::accepted(new));
                }
                // It waits, with the plane that it has now.
                let waiting = FilteredPlane { contact: new, ..old }.after_outlier();
                Some(waiting.unwrap_or_else(|| FilteredPlane::accepted(new.at_rest())))
            }
            (Some(new), Some(old)) => {
                if self.moved_m.is_some_and(|moved_m| moved_m.abs() > OUTLIER_PIXELS * self.pixel_m) {
                    return Some(
                        old.after_outlier().unwrap_or_else(|| FilteredPlane::accepted(new.at_rest())),
                    );
                }
                Some(FilteredPlane { contact: old.contact.at_rest(), outlier_frames: 0, ..old })
            }
            (Some(new), None) => {
                let waits = is_at_rest && of_piece(&new).is_some_and(|piece| piece.moved_m.len() >= MANY);
                Some(FilteredPlane { is_accepted: !waits, ..FilteredPlane::accepted(new) })
            }
            (None, Some(old)) => {
                let is_among_others = old.is_accepted && of_piece(&old.contact).is_some();
                is_among_others.then(|| old.after_outlier()).flatten()
            }
            (None, None) => None,
        }
    }
}

fn pairs(
    filtered: &[FilteredPlane],
    seen: &[SurfaceContact],
    place: impl Fn(u32) -> Point3<f64>,
    eyes: &[Eye],
) -> Vec<Pair> {
    let (mut old, mut new) = (filtered.iter().peekable(), seen.iter().peekable());
    let mut pairs = Vec::with_capacity(seen.len().max(filtered.len()));
    loop {
        let next = [old.peek().map(|plane| plane.contact.sample), new.peek().map(|found| found.sample)];
        let Some(sample) = next.into_iter().flatten().min() else { return pairs };
        let old = old.next_if(|plane| plane.contact.sample == sample).copied();
        let new = new.next_if(|found| found.sample == sample).copied();
        let at = place(sample);
        let depth_m = |contact: SurfaceContact| contact.depth_at_m(&at, eyes);
        let before_m = old.filter(|old| old.is_accepted).and_then(|old| depth_m(old.contact));
        let moved_m = new.and_then(depth_m).zip(before_m).map(|(now_m, before_m)| now_m - before_m);
        let eye = new.and_then(|found| eyes.get(usize::from(found.camera)));
        pairs.push(Pair { new, old, moved_m, pixel_m: eye.map_or(0.0, |eye| eye.pixel_m(&at)) });
    }
}

fn pieces(pairs: &[Pair]) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    for pair in pairs {
        let (Some(old), Some(moved_m)) = (&pair.old, pair.moved_m) else { continue };
        let normal = old.contact.normal();
        match pieces.iter_mut().find(|piece| piece.normal.dot(&normal) > SAME_PIECE) {
            Some(piece) => piece.moved_m.push(moved_m),
            None => pieces.push(Piece { normal, moved_m: vec![moved_m], pixel_m: pair.pixel_m }),
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera 2 m from the samples, whose pixels are 4 mm there.
    fn eyes() -> Vec<Eye> {
        vec![Eye { centre_world: Point3::new(2.0, 0.0, 0.0), focal_pixels: 500.0 }]
    }

    /// Contacts with a level surface that goes through the first camera's centre.
    fn seen(samples: impl IntoIterator<Item = u32>) -> Vec<SurfaceContact> {
        let contact = |sample| SurfaceContact {
            sample,
            camera: 0,
            normal_world: [0.0, 1.0, 0.0],
            moved_m: None,
            depth_m: 0.0,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        };
        samples.into_iter().map(contact).collect()
    }

    /// Where samples are: one so far below that plane, all others 1 mm.
    fn place(odd: u32, depth_mm: f64) -> impl Fn(u32) -> Point3<f64> {
        move |sample| Point3::new(0.0, if sample == odd { -1e-3 * depth_mm } else { -1e-3 }, 0.0)
    }

    fn samples(filter: &PlaneFilter) -> Vec<u32> {
        filter.contacts().map(|contact| contact.sample).collect()
    }

    /// With a second camera, so many millimetres higher: its planes lie as much higher.
    fn raised(mm: f64) -> Vec<Eye> {
        let mut eyes = eyes();
        eyes.push(Eye { centre_world: Point3::new(2.0, 1e-3 * mm, 0.0), ..eyes[0] });
        eyes
    }

    fn by_second(contacts: &mut [SurfaceContact]) {
        contacts.iter_mut().for_each(|contact| contact.camera = 1);
    }

    fn cameras(filter: &PlaneFilter) -> Vec<u16> {
        filter.contacts().map(|contact| contact.camera).collect()
    }

    #[test]
    fn what_flickers_by_less_than_half_a_pixel_stays_where_it_was() {
        let (mut filter, eyes) = (PlaneFilter::default(), raised(1.9));
        filter.update(&seen(0..5), 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        assert_eq!(samples(&filter), [0, 1, 2, 3, 4], "a landing is accepted at once");
        let mut moved = seen(0..5);
        by_second(&mut moved);
        filter.update(&moved, 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        assert_eq!(cameras(&filter), [0; 5]);
        assert!(filter.contacts().all(|contact| contact.speed_m_s == Some(0.0)));
    }

    #[test]
    fn a_piece_that_moves_takes_all_along_and_for_a_while() {
        let (mut filter, eyes) = (PlaneFilter::default(), raised(2.5));
        filter.update(&seen(0..5), 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        let mut moved = seen(0..5);
        by_second(&mut moved[..4]);
        filter.update(&moved, 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        assert_eq!(cameras(&filter), [1, 1, 1, 1, 0]);
        // A little farther is taken too, now that it moves.
        by_second(&mut moved);
        filter.update(&moved, 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        assert_eq!(cameras(&filter), [1; 5]);
    }

    #[test]
    fn an_outlier_is_accepted_in_the_end() {
        let (mut filter, eyes) = (PlaneFilter::default(), raised(6.0));
        let update = |filter: &mut PlaneFilter, seen: &[SurfaceContact]| {
            filter.update(seen, 0.0, false, place(9, 0.0), |_, _| true, &eyes);
        };
        update(&mut filter, &seen(0..5));
        let mut odd = seen(0..5);
        by_second(&mut odd[2..3]);
        for _ in 0..6 {
            update(&mut filter, &odd);
            assert_eq!(cameras(&filter), [0; 5]);
        }
        update(&mut filter, &odd);
        assert_eq!(cameras(&filter), [0, 0, 1, 0, 0]);
        // Agreeing once begins the count again.
        for _ in 0..3 {
            (0..6).for_each(|_| update(&mut filter, &seen(0..5)));
            update(&mut filter, &odd);
        }
        assert_eq!(cameras(&filter), [0, 0, 1, 0, 0]);
    }

    #[test]
    fn what_comes_and_goes_waits() {
        let mut filter = PlaneFilter::default();
        let update = |filter: &mut PlaneFilter, seen: &[SurfaceContact]| {
            filter.update(seen, 0.0, false, place(9, 0.0), |_, _| true, &eyes());
        };
        update(&mut filter, &seen(0..4));
        (0..6).for_each(|_| update(&mut filter, &seen([0, 1, 2, 3, 6])));
        assert_eq!(samples(&filter), [0, 1, 2, 3]);
        (0..2).for_each(|_| update(&mut filter, &seen([0, 1, 2, 3, 6])));
        assert_eq!(samples(&filter), [0, 1, 2, 3, 6]);
        (0..6).for_each(|_| update(&mut filter, &seen([0, 1, 2, 3])));
        assert_eq!(samples(&filter), [0, 1, 2, 3, 6]);
        update(&mut filter, &seen([0, 1, 2, 3]));
        assert_eq!(samples(&filter), [0, 1, 2, 3]);
        // Alone it is not held for.
        update(&mut filter, &[]);
        assert_eq!(samples(&filter), []);
    }

    #[test]
    fn what_is_no_contact_any_more_is_forgotten() {
        let mut filter = PlaneFilter::default();
        filter.update(&seen(0..4), 0.0, false, place(9, 0.0), |_, _| true, &eyes());
        let is_contact = |_: &SurfaceContact, depth_m: f64| depth_m > -0.02;
        filter.update(&seen([0, 1, 3]), 0.0, false, place(2, -50.0), is_contact, &eyes());
        assert_eq!(samples(&filter), [0, 1, 3]);
    }
}
