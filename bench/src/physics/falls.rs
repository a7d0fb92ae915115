//! When bodies fall, and whether they fall as those of a reference do.

use nalgebra::{Isometry3, Vector3};
use setup::cli::Outcome;
use stage::{NEUTRAL_S, Prop, StageSettings};

use super::metric::{Limit, Metric, metric};
use super::response::Response;
use super::track::{BodyAt, MOVED_M, Track};

/// What leans so much more than it did, against what it stands on, falls, degrees; and so does what has sunk so far,
/// metres.
const LEANS_DEG: f64 = 10.0;
const SINKS_M: f64 = 0.05;
/// Runs of a reference whose starts are moved.
const MOVED_RUNS: u64 = 5;
/// Falls begin no farther apart than this, seconds.
const MOST_APART_S: f64 = 0.1;
/// Bodies end no farther apart than so many times the reference's own spread.
const MOST_SPREADS: f64 = 1.5;

/// Whether a scene's falls are compared with those of references.
pub fn is_compared(scene: &str) -> bool {
    ["lift", "topple"].contains(&scene)
}

/// How a fall begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fall {
    Leans,
    Sinks,
}

/// What bodies of a scene stand on, world from that.
fn ground(scene: &str, stage: &StageSettings, time_s: f64) -> Isometry3<f64> {
    if scene == "lift" { stage.prop_world(Prop::LiftedBox, time_s) } else { Isometry3::identity() }
}

/// When and how a body begins to fall, film time, if it does.
fn fall(scene: &str, track: &Track, stage: &StageSettings, index: usize) -> Option<(f64, Fall)> {
    let steps = track.since(NEUTRAL_S);
    let against = |film_s: f64, body: &BodyAt| {
        let ground = ground(scene, stage, film_s);
        let up = ground.inverse_transform_vector(&(body.pose.rotation() * Vector3::y()));
        (up, ground.inverse_transform_point(&body.place()).y)
    };
    let first = steps.first()?;
    let (up, height_m) = against(first.film_s, &first.bodies[index]);
    steps.iter().find_map(|step| {
        let (up_now, height_now_m) = against(step.film_s, &step.bodies[index]);
        if up.angle(&up_now).to_degrees() > LEANS_DEG {
            return Some((step.film_s, Fall::Leans));
        }
        (height_m - height_now_m > SINKS_M).then_some((step.film_s, Fall::Sinks))
    })
}

/// How many bodies fall, and how it begins.
pub fn falls(scene: &str, track: &Track, stage: &StageSettings) -> Vec<Metric> {
    let falls: Vec<(f64, Fall)> =
        (0..track.names.len()).filter_map(|index| fall(scene, track, stage, index)).collect();
    let count = |kind: Fall| falls.iter().filter(|(_, found)| *found == kind).count() as f64;
    let first_s = falls.iter().map(|(film_s, _)| *film_s).fold(f64::INFINITY, f64::min);
    vec![
        metric("falls, leaning first", count(Fall::Leans), None),
        metric("falls, sinking first", count(Fall::Sinks), None),
        metric("first fall at, s", first_s, None),
    ]
}

/// How far bodies are apart at the end of two runs, metres: the mean over bodies of the corners' root mean square.
fn ends_apart_m(a: &Track, b: &Track) -> f64 {
    let (Some(a_last), Some(b_last)) = (a.steps.last(), b.steps.last()) else { return f64::NAN };
    let apart = |((a, b), reach_m): ((&BodyAt, &BodyAt), &[f64; 3])| {
        let corner = |place: usize, body: &BodyAt| {
            let signs = std::array::from_fn(|axis| if place >> axis & 1 == 0 { -1.0 } else { 1.0 });
            let at: Vector3<f64> = Vector3::from(*reach_m).component_mul(&Vector3::from(signs));
            body.place().coords + body.pose.rotation() * at
        };
        let squared = (0..8).map(|place| (corner(place, a) - corner(place, b)).norm_squared());
        (squared.sum::<f64>() / 8.0).sqrt()
    };
    let bodies = a_last.bodies.iter().zip(&b_last.bodies).zip(&a.reaches_m);
    bodies.map(apart).sum::<f64>() / a.names.len().max(1) as f64
}

/// What a run is compared with.
pub struct Reference {
    response: Response,
    track: Track,
    spread_m: f64,
}

impl Reference {
    /// A run of a reference, and how far its ends are from those of runs whose starts are moved; `run` makes one with
    /// a seed.
    pub fn of(response: Response, track: Track, run: impl Fn(u64) -> Outcome<Track>) -> Outcome<Reference> {
        let mut spread_m = MOVED_M;
        for seed in 1..=MOVED_RUNS {
            spread_m = spread_m.max(ends_apart_m(&track, &run(seed)?));
        }
        Ok(Reference { response, track, spread_m })
    }

    /// How far a run is from it.
    pub fn compare(&self, scene: &str, track: &Track, stage: &StageSettings) -> Vec<Metric> {
        let end_s = track.steps.last().map_or(f64::NAN, |step| step.film_s);
        // What never falls falls at the end.
        let fall_s =
            |track: &Track, index: usize| fall(scene, track, stage, index).map_or(end_s, |fall| fall.0);
        let apart_s = |index: usize| {
            let (found_s, expected_s) = (fall_s(track, index), fall_s(&self.track, index));
            tracing::debug!("{}: falls at {found_s:.3} s, expected {expected_s:.3}", track.names[index]);
            (found_s - expected_s).abs()
        };
        let most_s = (0..track.names.len()).map(apart_s).fold(0.0, f64::max);
        let apart_m = ends_apart_m(track, &self.track);
        let [falls, ends, spreads] = match self.response {
            Response::EightK => ["falls from 8k's, s", "ends from 8k's, mm", "ends / spread of 8k's"],
            _ => ["falls from solids', s", "ends from solids', mm", "ends / spread of solids'"],
        };
        vec![
            metric(falls, most_s, Some(Limit::Most(MOST_APART_S))),
            metric(ends, 1e3 * apart_m, None),
            metric(spreads, apart_m / self.spread_m, Some(Limit::Most(MOST_SPREADS))),
        ]
    }

    /// How far its own ends are apart.
    pub fn spread(&self) -> Metric {
        metric("spread of ends, mm", 1e3 * self.spread_m, None)
    }
}

#[cfg(test)]
mod tests {
    use hull::Pose;

    use super::super::track::TrackStep;
    use super::*;

    /// A box that leans, by so many degrees a second from 2 s on, and sinks, metres a second.
    fn track(leans_deg_s: f64, sinks_m_s: f64) -> Track {
        let step = |index: usize| {
            let film_s = index as f64 / 120.0;
            let since_s = (film_s - 2.0).max(0.0);
            let (s, c) = libm::sincos(0.5 * (leans_deg_s * since_s).to_radians());
            let pose = Pose::new([0.0, 1.0 - sinks_m_s * since_s, 0.0], [s, 0.0, 0.0, c]).expect("a pose");
            let still = Vector3::zeros();
            let body = BodyAt { pose, velocity_m_s: still, spin_rad_s: 0.0, sleeps: false, depth_m: 0.0 };
            TrackStep { film_s, bodies: vec![body] }
        };
        Track {
            names: vec!["box".into()],
            reaches_m: vec![[0.1; 3]],
            steps: (0..480).map(step).collect(),
            passes_a_frame: 1.0,
        }
    }

    #[test]
    fn falls_begin_when_bodies_lean_or_sink() {
        let stage = StageSettings::default();
        let found = |track: &Track| fall("topple", track, &stage, 0);
        assert_eq!(found(&track(0.0, 0.0)), None);
        let (at_s, how) = found(&track(20.0, 0.01)).expect("a fall");
        assert!((at_s - 2.5).abs() < 0.02 && how == Fall::Leans, "{at_s} {how:?}");
        let (at_s, how) = found(&track(1.0, 0.1)).expect("a fall");
        assert!((at_s - 2.5).abs() < 0.02 && how == Fall::Sinks, "{at_s} {how:?}");
    }

    #[test]
    fn runs_are_compared_by_falls_and_by_ends_in_spreads() {
        let run = |_| Ok(track(0.0, 0.001));
        let reference = Reference::of(Response::Solids, track(0.0, 0.0), run).expect("runs");
        assert!((reference.spread().value - 2.0).abs() < 0.02, "{:?}", reference.spread());
        let metrics = reference.compare("topple", &track(0.0, 0.1), &StageSettings::default());
        let values: Vec<f64> = metrics.iter().map(|metric| metric.value).collect();
        assert!((values[0] - 1.49).abs() < 0.03, "the reference's falls at the end: {values:?}");
        assert!((values[1] - 199.0).abs() < 2.0 && (values[2] - 100.0).abs() < 2.0, "{values:?}");
    }
}
