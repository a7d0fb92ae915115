//! The rigid motion that explains how far a surface moves out along its normals, here and there.
//!
//! Motion along a surface does not show where a body touches it, but in its sides, in the hands that hold it, in
//! whatever of it is near. Frames add up, the newest counts most. Noise is no motion: one that explains the planes
//! little better than none is none.

use nalgebra::{Matrix6, Vector3, Vector6};

/// How exactly a plane is known to have moved, pixels.
const SIGMA_PIXELS: f64 = 0.2;
/// A plane turns about its camera as the edge moves through which it goes: elsewhere it moves by so much more or less.
const SIGMA_SHARE: f64 = 0.1;
/// And of what moves along it, for its normal is not known exactly: so much of the share.
const ALONG: f64 = 0.3;
/// None is known better.
const LEAST_SIGMA_M: f64 = 1e-5;
/// A plane that is off by so many times that counts a quarter: it may be of something else.
const OFF_SIGMAS: f64 = 3.0;
/// How often planes are weighed again.
const ROUNDS: usize = 5;
/// What a frame counts in the next.
const KEPT: f64 = 0.4;
/// Metres a frame that a surface is taken to move without being seen to, and radians.
const PRIOR_MOVED_M: f64 = 0.05;
const PRIOR_TURNED_RAD: f64 = 0.007;
/// Planes near each other see the same pixels: so many count as one.
const ALIKE: f64 = 4.0;
/// What moves otherwise than in the frame before must explain so many times as much.
const LEAST_GAIN: f64 = 1.15;
/// Nothing moves unless the best motion explains so much, in squares of what a plane may be off.
const LEAST_SQUARES: f64 = 6.0;
/// Contacts face alike if their normals are so near: cosine of 30 degrees.
const FACE_ALIKE: f64 = 0.866;
/// Planes so far from the contacts count little, metres.
const NEAR_M: f64 = 0.3;
/// And so far before them.
const BEFORE_M: f64 = 0.02;

/// A place of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Outward, world.
    pub normal: Vector3<f64>,
    /// Where it is from the middle of the body, metres.
    pub lever: Vector3<f64>,
}

/// What one plane says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub place: Place,
    /// How far it moved out in a frame.
    pub moved_m: f64,
    /// A pixel there.
    pub pixel_m: f64,
}

/// How a surface moves in a frame: a shift at the middle of the body, metres, and a turn, radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion(Vector6<f64>);

impl Motion {
    /// A shift without a turn, metres.
    fn of_shift_m(shift_m: &Vector3<f64>) -> Motion {
        Motion(Vector6::new(shift_m.x, shift_m.y, shift_m.z, 0.0, 0.0, 0.0))
    }

    /// How far a place, from the middle of the body, moves in a frame.
    pub fn moved_m(&self, lever: &Vector3<f64>) -> Vector3<f64> {
        self.0.fixed_rows::<3>(0) + self.turned_rad().cross(lever)
    }

    /// How far it turns in a frame.
    pub fn turned_rad(&self) -> Vector3<f64> {
        self.0.fixed_rows::<3>(3).into()
    }
}

/// What frames have said so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Estimate {
    frame: Option<u64>,
    sums: Sums,
    motion: Option<Motion>,
}

/// The normal equations of a motion.
#[derive(Clone, Debug, Default)]
struct Sums {
    weights: Matrix6<f64>,
    moved: Vector6<f64>,
}

impl Row {
    /// What it says of a shift and of a turn.
    fn six(&self) -> Vector6<f64> {
        let Place { normal, lever } = &self.place;
        Vector6::from_iterator(normal.iter().chain(&lever.cross(normal)).copied())
    }

    /// How exactly it would be known if that were the motion. What it says itself must not decide: those that say
    /// little would be known best, and hold everything back.
    fn sigma_m(&self, motion: &Motion) -> f64 {
        let moved_m = motion.moved_m(&self.place.lever);
        let shown_m = moved_m.dot(&self.place.normal).abs().max(ALONG * moved_m.norm());
        libm::hypot(SIGMA_PIXELS * self.pixel_m, SIGMA_SHARE * shown_m).max(LEAST_SIGMA_M)
    }

    /// 1 if a motion explains it, 0 if not at all.
    fn agreement(&self, motion: &Motion) -> f64 {
        let off = (self.moved_m - self.six().dot(&motion.0)) / (OFF_SIGMAS * self.sigma_m(motion));
        let agreement = 1.0 / (1.0 + off * off);
        agreement * agreement
    }
}

impl Estimate {
    /// The motion in the newest frame; `None` while nothing is seen to move.
    pub fn motion(&self) -> Option<&Motion> {
        self.motion.as_ref()
    }

    /// Puts a motion that is known otherwise in the place of what planes told of the newest frame.
    pub fn replace(&mut self, shift_m: Vector3<f64>) {
        self.motion = Some(Motion::of_shift_m(&shift_m));
    }

    /// Takes a frame, once: where the body's contacts are, what those of them say that were found in the frame before, and what
    /// the planes around it do.
    pub fn take(&mut self, frame: u64, contacts: &[Place], own: &[Row], around: &[Row]) {
        if self.frame.replace(frame) == Some(frame) {
            return;
        }
        let told: Vec<f64> = around.iter().map(|row| told_of_slides(row, contacts)).collect();
        let own = levelled(own);
        let own = own.iter().map(|row| (row, 1.0));
        let told_by = around.iter().zip(told.iter().copied());
        let all = own.chain(told_by.clone());
        let score = |motion: &Motion| -> f64 {
            told_by.clone().map(|(row, told)| told * row.agreement(motion)).sum()
        };
        let before = self.motion.unwrap_or_default();
        let (tracked, tracked_sums) = self.sums.kept().fitted(&all, Some(before));
        let (fresh, fresh_sums) = Sums::default().fitted(&all, None);
        let is_tracked = score(&tracked) * LEAST_GAIN > score(&fresh);
        let (motion, sums) = if is_tracked { (tracked, tracked_sums) } else { (fresh, fresh_sums) };
        self.sums = sums;
        let moves = motion.0.dot(&self.sums.moved) > LEAST_SQUARES;
        self.motion = moves.then_some(motion);
    }
}

/// The contacts with the mean normals of those that face alike: what single normals are off would tell of slides.
fn levelled(own: &[Row]) -> Vec<Row> {
    let mean = |row: &Row| {
        let alike = own.iter().filter(|other| other.place.normal.dot(&row.place.normal) > FACE_ALIKE);
        let sum: Vector3<f64> = alike.map(|other| other.place.normal).sum();
        Row { place: Place { normal: sum.normalize(), ..row.place }, ..*row }
    };
    own.iter().map(mean).collect()
}

/// How much a plane tells of how the contacts' surface slides: nothing if it faces as they do, and little if it is far
/// from them or before them: what carries a body lies behind its surface.
fn told_of_slides(row: &Row, contacts: &[Place]) -> f64 {
    let (mut alike, mut near_m, mut before_m) = (0.0_f64, f64::INFINITY, 0.0);
    for contact in contacts {
        let cosine = row.place.normal.dot(&contact.normal);
        alike = alike.max(cosine * cosine);
        let from_contact = row.place.lever - contact.lever;
        if from_contact.norm() < near_m {
            near_m = from_contact.norm();
            before_m = from_contact.dot(&contact.normal).max(0.0);
        }
    }
    let (near, before) = (near_m / NEAR_M, before_m / BEFORE_M);
    (1.0 - alike) * libm::exp(-near * near - before * before)
}

impl Sums {
    fn kept(&self) -> Sums {
        Sums { weights: self.weights * KEPT, moved: self.moved * KEPT }
    }

    /// The motion that explains rows best, each of so much weight, and the sums with them.
    fn fitted<'a>(
        &self,
        rows: &(impl Iterator<Item = (&'a Row, f64)> + Clone),
        start: Option<Motion>,
    ) -> (Motion, Sums) {
        let mut motion = start.unwrap_or_default();
        let mut sums = self.clone();
        for round in 0..ROUNDS {
            sums = self.clone();
            for (row, weight) in rows.clone() {
                let is_blind = round == 0 && start.is_none();
                let (robust, sigma_m) = if is_blind {
                    // Nothing else says how fast it may be.
                    (1.0, libm::hypot(row.sigma_m(&motion), SIGMA_SHARE * row.moved_m))
                } else {
                    (row.agreement(&motion), row.sigma_m(&motion))
                };
                let weight = robust * weight / (ALIKE * sigma_m.powi(2));
                let six = row.six();
                sums.weights += six * six.transpose() * weight;
                sums.moved += six * (weight * row.moved_m);
            }
            let inverse = (sums.weights + prior()).try_inverse();
            motion = inverse.map_or(Motion::default(), |inverse| Motion(inverse * sums.moved));
        }
        (motion, sums)
    }
}

fn prior() -> Matrix6<f64> {
    let of = |axis: usize| if axis < 3 { PRIOR_MOVED_M } else { PRIOR_TURNED_RAD };
    Matrix6::from_diagonal(&Vector6::from_fn(|axis, _| of(axis).powi(-2)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lid under a body, four places, and some of its sides.
    const LID: [([f64; 3], [f64; 3]); 9] = [
        ([-0.1, 0.0, -0.1], [0.0, 1.0, 0.0]),
        ([0.1, 0.0, -0.1], [0.0, 1.0, 0.0]),
        ([-0.1, 0.0, 0.1], [0.0, 1.0, 0.0]),
        ([0.1, 0.0, 0.1], [0.0, 1.0, 0.0]),
        ([0.2, -0.05, 0.0], [1.0, 0.0, 0.0]),
        ([-0.2, -0.05, 0.1], [-1.0, 0.0, 0.0]),
        ([-0.2, -0.05, -0.1], [-1.0, 0.0, 0.0]),
        ([0.0, -0.05, 0.2], [0.0, 0.0, 1.0]),
        ([0.1, -0.05, -0.2], [0.0, 0.0, -1.0]),
    ];

    fn rows(motion: &Motion) -> Vec<Row> {
        let row = |(lever, normal): ([f64; 3], [f64; 3])| {
            let (lever, normal) = (Vector3::from(lever), Vector3::from(normal));
            Row {
                place: Place { normal, lever },
                moved_m: motion.moved_m(&lever).dot(&normal),
                pixel_m: 0.004,
            }
        };
        LID.into_iter().map(row).collect()
    }

    fn estimate(rows: &[Row]) -> Estimate {
        let mut estimate = Estimate::default();
        let places: Vec<Place> = rows[..4].iter().map(|row| row.place).collect();
        (0..6).for_each(|frame| estimate.take(frame, &places, &rows[..4], &rows[4..]));
        estimate
    }

    #[test]
    fn a_thing_that_slides_lifts_and_turns_is_known_by_its_sides() {
        let truth = Motion(Vector6::new(0.02, 0.01, -0.005, 0.0, 0.004, 0.006));
        let motion = *estimate(&rows(&truth)).motion().expect("it moves");
        for (lever, _) in LID {
            let lever = Vector3::from(lever);
            assert!((motion.moved_m(&lever) - truth.moved_m(&lever)).norm() < 1.5e-3, "{lever}");
        }
    }

    #[test]
    fn what_moves_otherwise_beside_it_does_not_count() {
        let truth = Motion(Vector6::new(0.02, 0.0, 0.0, 0.0, 0.0, 0.0));
        let mut rows = rows(&truth);
        rows.extend((0..3).map(|at| Row {
            place: Place { normal: Vector3::x(), lever: Vector3::new(0.3, 0.05 * f64::from(at), 0.0) },
            moved_m: -0.06,
            pixel_m: 0.004,
        }));
        let motion = *estimate(&rows).motion().expect("it moves");
        assert!(
            (motion.moved_m(&Vector3::zeros()) - Vector3::new(0.02, 0.0, 0.0)).norm() < 2e-3,
            "{motion:?}"
        );
    }

    #[test]
    fn what_flickers_by_a_fraction_of_a_pixel_stands_still() {
        let mut rows = rows(&Motion(Vector6::zeros()));
        assert!(estimate(&rows).motion().is_none());
        for (at, row) in rows.iter_mut().enumerate() {
            row.moved_m = 0.001 * [1.0, -0.6, 0.3][at % 3];
        }
        assert!(estimate(&rows).motion().is_none());
    }
}
