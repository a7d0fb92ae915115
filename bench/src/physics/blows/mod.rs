//! Bodies that meet what moves, each kind of blow many times: what was missed, and what became of the rest, against the
//! studio's true solids.

mod bounce;
mod shove;
mod strike;
mod throw;

use std::sync::Arc;

use hull::Pose;
use nalgebra::{Point3, Vector3};
use setup::cli::{Failure, Outcome};
use sim::{BodySpec, MassSpec, Scene, Solid};
use stage::StageSettings;

use super::PhysicsBenchArguments;
use super::film::StageFilm;
use super::metric::Metric;
use super::response::Response;
use super::rows::{Row, RowKind};
use super::track::{BodyAt, Film, RunPlan, Track};
use super::worse;

/// Radius and density of the balls, metres and kg/m³.
const BALL_M: f64 = 0.05;
const DENSITY_KG_M3: f64 = 100.0;

/// What is thrown at true solids moves 2 cm in a step at most.
const SUBSTEPS: u32 = 8;

/// Nothing is there but what a blow puts there: no floor and no gravity, and nothing bounces.
const FREE: &str =
    "gravity = [0.0, 0.0, 0.0]\nfloor.enabled = false\n[hull]\nrestitution = 0.0\nfriction = 0.5\n";

/// A kind of blow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blow {
    /// An arm swings against balls at rest.
    Strike,
    /// Balls fly at an arm that is held still.
    Throw,
    /// A person glides into a box.
    Shove,
    /// Balls jump on a table.
    Bounce,
}

impl Blow {
    /// All kinds.
    pub const ALL: [Blow; 4] = [Blow::Strike, Blow::Throw, Blow::Shove, Blow::Bounce];

    /// Its name among the scenes.
    pub fn name(self) -> &'static str {
        match self {
            Blow::Strike => "strike",
            Blow::Throw => "throw",
            Blow::Shove => "shove",
            Blow::Bounce => "bounce",
        }
    }

    /// Measures it.
    pub fn measure(self, arguments: &PhysicsBenchArguments, keep: &mut Keep<'_>) -> Outcome {
        match self {
            Blow::Strike => strike::measure(arguments, keep),
            Blow::Throw => throw::measure(arguments, keep),
            Blow::Shove => shove::measure(arguments, keep),
            Blow::Bounce => bounce::measure(arguments, keep),
        }
    }
}

/// Takes the rows as they are found.
type Keep<'a> = dyn FnMut(Vec<Row>) -> Outcome + 'a;

/// A stage as one kind of response sees it.
struct Seen {
    film: Film,
    scene: Scene,
    response: Response,
    size: Option<(u32, u32)>,
    noise: f64,
}

impl Seen {
    /// What becomes of a body in so many seconds.
    fn run(&self, body: BodySpec, seconds: f64, seed: u64) -> Outcome<Track> {
        let Seen { scene, response, .. } = self;
        let plan = RunPlan {
            scene,
            response: *response,
            seed,
            is_moved: false,
            seconds,
            guests: &[body],
            substeps: SUBSTEPS,
        };
        Track::of(&self.film, plan)
    }

    /// Whether it is the studio's true solids that bodies meet.
    fn is_of_solids(&self) -> bool {
        self.response == Response::Solids
    }

    /// The worst figures of several seeds, as rows of that name.
    fn rows(
        &self,
        name: &str,
        seeds: u64,
        figures: impl Fn(u64) -> Outcome<Vec<Metric>>,
    ) -> Outcome<Vec<Row>> {
        let mut worst = figures(1)?;
        for seed in 2..=seeds {
            worst = worst
                .into_iter()
                .zip(figures(seed)?)
                .map(|(a, b)| Metric { value: worse(a, b.value), ..a })
                .collect();
        }
        let Seen { response, size, noise, .. } = self;
        let kind =
            RowKind { scene: name.into(), response: response.name(), size: *size, noise: *noise, seeds };
        Ok(worst.into_iter().map(|metric| kind.row(metric)).collect())
    }
}

/// Hands over a stage as all asked responses see it, true solids first. What 7680x4320 would make of it is not asked.
fn each_seen(
    stage: &StageSettings,
    scene: &str,
    arguments: &PhysicsBenchArguments,
    mut use_it: impl FnMut(&Seen) -> Outcome,
) -> Outcome {
    let scene = Scene::from_toml("blow", scene).map_err(Failure::run)?;
    if arguments.response.contains(&Response::Solids) {
        let (film, response) = (Film::Solids(stage.clone()), Response::Solids);
        use_it(&Seen { film, scene: scene.clone(), response, size: None, noise: 0.0 })?;
    }
    for &size in &arguments.size {
        let film = Arc::new(StageFilm::new(stage.clone(), arguments.cameras, size)?);
        for &response in arguments.response.iter().filter(|response| !response.is_reference()) {
            for &noise in &arguments.noise {
                let film = Film::Studio(Arc::clone(&film), noise);
                use_it(&Seen { film, scene: scene.clone(), response, size: Some(size), noise })?;
            }
        }
    }
    Ok(())
}

/// A body that does not bounce.
fn body(solid: Solid, at: Point3<f64>, velocity_m_s: Vector3<f64>) -> Outcome<BodySpec> {
    Ok(BodySpec {
        name: "body".into(),
        solid,
        pose: Pose::new(at.coords.into(), [0.0, 0.0, 0.0, 1.0]).map_err(Failure::run)?,
        velocity_m_s: velocity_m_s.into(),
        mass: MassSpec::DensityKgM3(DENSITY_KG_M3),
        friction: 0.5,
        restitution: 0.0,
        fixed: false,
        color: [0.8, 0.3, 0.2],
    })
}

/// The only body, step by step.
fn course(track: &Track) -> impl DoubleEndedIterator<Item = &BodyAt> + Clone {
    track.steps.iter().filter_map(|step| step.bodies.first())
}

/// The greatest of some figures; zero of none.
fn greatest(figures: impl Iterator<Item = f64>) -> f64 {
    figures.fold(0.0, f64::max)
}
