//! `hulltouch-bench physics`: whether bodies behave as a physicist expects.

mod blows;
mod falls;
mod film;
mod judge;
mod metric;
mod normals;
mod response;
mod rows;
mod solids;
mod track;

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use clap::Args;
use setup::cli::{ArgumentError, Failure, Outcome, check_json_writable, outln, parse_size};
use setup::{ClusterFile, SceneChoice};
use sim::{Scene, StageHint};
use stage::{Motion, Prop, StageSettings};

use self::blows::Blow;
use self::falls::{Reference, is_compared};
use self::film::{FINEST, StageFilm};
use self::judge::{Conditions, judge, judge_any, seconds_of};
use self::metric::Metric;
use self::normals::NORMALS;
use self::response::Response;
use self::rows::{Row, RowKind, TABLE};
use self::track::{DROPS, Film, RunPlan, Track};
use super::outputs::within;
use super::table::{Machine, Table, write_json};

/// Scenes as their bodies went, against what they must keep to.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch-bench physics --scene rest,lift --size 640x480,1280x720 --noise 0,0.01 --seeds 3\n  \
    hulltouch-bench physics --scene topple,lift --response contacts,solids,8k\n  \
    hulltouch-bench physics --scene normals --size 1280x720,3840x2160\n  \
    hulltouch-bench physics --recording deploy/uu_horseman.cluster.toml --bodies \
    deploy/uu_horseman_knees.scene.toml\n\n\
    Every run sees the true silhouettes of the studio, in lock-step; with noise, a share of the pixels \
    on either side of every outline is inverted in every frame. Of several seeds each figure is the \
    worst; of `drops` each lets one cube fall.\n\n\
    `between` is `contacts` with the hull between the two newest frames, one frame later; in `no-speeds` \
    it is unknown how surfaces move. `one-contact` leaves each body the deepest of its contacts. Two \
    responses are references: `solids` has no hull, its bodies meet the studio's true solids; `8k` is \
    `contacts` seen at 7680x4320. Of lift and topple the falls and ends of the others are compared with \
    those of the references that are asked for too, and ends with the spread of the reference's own ends \
    when its bodies start a millimetre elsewhere.\n\n\
    The scene `normals` has no bodies: it compares the normals of the hull's surface, by disc and by \
    square, with those at 7680x4320 on a person, and with exact ones on a table.\n\n\
    In `strike` a fist and a forearm meet balls at rest, 50 of each speed; in `throw` 200 balls fly at an arm; in \
    `shove` a person glides into a box, in eight phases of a film frame; in `bounce` balls jump a thousand times on a \
    table. `solids` says what true solids do.")]
pub struct PhysicsBenchArguments {
    /// The scenes, `normals`, and `strike`, `throw`, `shove` and `bounce`.
    #[arg(
        long,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "rest,lift,topple,tray,push,punch,drops,squeeze,normals"
    )]
    scene: Vec<String>,
    /// How bodies answer the hull.
    #[arg(
        long,
        value_enum,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "paper,contacts,between,no-speeds,one-contact,solids,8k"
    )]
    response: Vec<Response>,
    /// Image sizes.
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', default_value = "640x480,1280x720", value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// The share of outline pixels that flicker.
    #[arg(long, value_name = "SHARE,…", value_delimiter = ',', default_value = "0", value_parser = parse_share)]
    noise: Vec<f64>,
    /// Runs of each kind, each with another flicker, other drops, and in `rest` with starts a millimetre elsewhere;
    /// other scenes without noise are run once.
    #[arg(long, value_name = "N", default_value = "1", value_parser = parse_seeds)]
    seeds: u64,
    /// Cameras of the studio.
    #[arg(long, value_name = "N", default_value = "8", value_parser = super::cluster::parse_nodes)]
    cameras: usize,
    /// Film of each run, seconds [default: what the scene needs].
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// A cluster file whose recording is seen instead of the studio.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "size", "noise", "cameras"])]
    recording: Option<PathBuf>,
    /// With a recording: a scene file instead of the recording's.
    #[arg(long, value_name = "FILE", requires = "recording")]
    bodies: Option<PathBuf>,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn parse_share(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.0, 1.0)
}

fn parse_seeds(text: &str) -> Result<u64, ArgumentError> {
    within(text, 1, 1000)
}

fn parse_seconds(text: &str) -> Result<f64, ArgumentError> {
    within(text, 3.0, 3600.0)
}

/// Runs it.
pub fn run(arguments: &PhysicsBenchArguments) -> Outcome {
    if let Some(path) = &arguments.json {
        check_json_writable(path)?;
    }
    let experiments = match &arguments.recording {
        Some(path) => vec![recorded(path, arguments)?],
        None => arguments.scene.iter().map(|name| Experiment::named(name)).collect::<Outcome<_>>()?,
    };
    let machine = Machine::here();
    let mut rows: Vec<Row> = Vec::new();
    let mut keep = |found: Vec<Row>| -> Outcome {
        found.iter().try_for_each(|row| TABLE.print(row))?;
        rows.extend(found);
        Ok(())
    };
    let measured = outln!("{}", machine.line()).and_then(|()| TABLE.print_titles()).and_then(|()| {
        experiments.iter().try_for_each(|experiment| experiment.measure(arguments, &mut keep))
    });
    // What was measured is written also where measuring failed.
    let written = write_json(&Table { bench: "physics", machine, rows }, arguments.json.as_deref());
    measured.and(written)
}

/// What is measured.
enum Experiment {
    /// A scene in the studio.
    Studio(Scene),
    /// A scene in a recording.
    Recording(Scene, Film),
    /// How the hull's normals are off.
    Normals,
    /// Bodies that meet what moves.
    Blow(Blow),
}

impl Experiment {
    fn named(name: &str) -> Outcome<Experiment> {
        if name == NORMALS {
            return Ok(Experiment::Normals);
        }
        if let Some(blow) = Blow::ALL.into_iter().find(|blow| blow.name() == name) {
            return Ok(Experiment::Blow(blow));
        }
        let scene = Scene::named(name);
        scene.map(Experiment::Studio).map_err(|error| Failure::input(format_args!("--scene: {error}")))
    }

    fn measure(
        &self,
        arguments: &PhysicsBenchArguments,
        keep: &mut dyn FnMut(Vec<Row>) -> Outcome,
    ) -> Outcome {
        match self {
            Experiment::Normals => normals::measure(&arguments.size, arguments.cameras, keep),
            Experiment::Blow(blow) => blow.measure(arguments, keep),
            Experiment::Studio(scene) => in_studio(scene, arguments, keep),
            Experiment::Recording(scene, film) => {
                for &response in arguments.response.iter().filter(|response| response.is_of_recordings()) {
                    let kind = Kind { scene, stage: None, response, size: None, noise: 0.0, film };
                    keep(kind.rows(arguments, &[])?.0)?;
                }
                Ok(())
            }
        }
    }
}

/// The recording of a cluster file with the bodies of its scene, or of a scene file instead.
fn recorded(path: &Path, arguments: &PhysicsBenchArguments) -> Outcome<Experiment> {
    if !arguments.response.iter().any(|response| response.is_of_recordings()) {
        return Err(Failure::input("--response: found only what a recording has not, expected another too"));
    }
    let mut file = ClusterFile::open(path)?;
    if let Some(scene) = &arguments.bodies {
        file.scene = SceneChoice::File(scene.clone());
    }
    let scene = file.load_scene().map_err(Failure::input)?;
    Ok(Experiment::Recording(scene, Film::Recording(Box::new(file))))
}

/// A scene in the studio: the references first, then what is compared with them.
fn in_studio(
    scene: &Scene,
    arguments: &PhysicsBenchArguments,
    keep: &mut dyn FnMut(Vec<Row>) -> Outcome,
) -> Outcome {
    let stage = stage_of(scene)?;
    let film_of = |size| StageFilm::new(stage.clone(), arguments.cameras, size).map(Arc::new);
    let mut references = Vec::new();
    let is_asked = |response: &Response| arguments.response.contains(response);
    for response in Response::REFERENCES.into_iter().filter(is_asked) {
        let (size, film) = match response {
            Response::Solids => (None, Film::Solids(stage.clone())),
            _ => (Some(FINEST), Film::Studio(film_of(FINEST)?, 0.0)),
        };
        let kind = Kind { scene, stage: Some(&stage), response, size, noise: 0.0, film: &film };
        let (rows, track) = kind.rows(arguments, &[])?;
        keep(rows)?;
        if let Some(track) = track.filter(|_| is_compared(scene.name())) {
            let reference = Reference::of(response, track, |seed| kind.track(arguments, seed, true))?;
            keep(vec![kind.row_kind(1).row(reference.spread())])?;
            references.push(reference);
        }
    }
    for &size in &arguments.size {
        let film = film_of(size)?;
        for &response in arguments.response.iter().filter(|response| !response.is_reference()) {
            for &noise in &arguments.noise {
                let film = Film::Studio(Arc::clone(&film), noise);
                let (stage, size) = (Some(&stage), Some(size));
                let kind = Kind { scene, stage, response, size, noise, film: &film };
                keep(kind.rows(arguments, &references)?.0)?;
            }
        }
    }
    Ok(())
}

/// The studio that a scene wants.
fn stage_of(scene: &Scene) -> Outcome<StageSettings> {
    fn named<T: FromStr<Err: std::fmt::Display>>(text: &str) -> Outcome<T> {
        text.parse().map_err(Failure::input)
    }
    let Some(StageHint { motion, props, person }) = scene.stage() else {
        return Err(Failure::input(format_args!("scene {}: found no [stage], expected one", scene.name())));
    };
    Ok(StageSettings {
        motion: if motion.is_empty() { Motion::default() } else { named::<Motion>(motion)? },
        person: *person,
        props: props.iter().map(|prop| named::<Prop>(prop)).collect::<Outcome<_>>()?,
        ..StageSettings::default()
    })
}

/// Runs that differ by their seeds alone.
struct Kind<'a> {
    scene: &'a Scene,
    /// The studio, if it is there.
    stage: Option<&'a StageSettings>,
    response: Response,
    size: Option<(u32, u32)>,
    noise: f64,
    film: &'a Film,
}

impl Kind<'_> {
    fn track(&self, arguments: &PhysicsBenchArguments, seed: u64, is_moved: bool) -> Outcome<Track> {
        let Kind { scene, response, .. } = *self;
        let seconds = arguments.seconds.unwrap_or_else(|| seconds_of(scene.name()));
        Track::of(self.film, RunPlan { scene, response, seed, is_moved, seconds, guests: &[], substeps: 1 })
    }

    fn row_kind(&self, seeds: u64) -> RowKind {
        let Kind { scene, response, size, noise, .. } = *self;
        // A scene file is called `name.scene.toml`.
        let scene = scene.name().trim_end_matches(".scene").to_owned();
        RowKind { scene, response: response.name(), size, noise, seeds }
    }

    /// The rows of these runs, and the last run.
    fn rows(
        &self,
        arguments: &PhysicsBenchArguments,
        references: &[Reference],
    ) -> Outcome<(Vec<Row>, Option<Track>)> {
        let scene = self.scene.name();
        // Without noise only these are repeated: elsewhere a seed moves starts by less than a millimetre.
        let seeds = if self.noise > 0.0 || [DROPS, "rest"].contains(&scene) { arguments.seeds } else { 1 };
        // True solids are as fine as can be.
        let conditions = Conditions {
            width: self.size.map_or(u32::MAX, |size| size.0),
            flicker: self.noise,
            hull_time: self.response.hull_time(),
        };
        let (mut worst, mut last): (Vec<Metric>, _) = (Vec::new(), None);
        for seed in 1..=seeds {
            let track = self.track(arguments, seed, scene == "rest" && seed > 1)?;
            let found = match self.stage {
                None => judge_any(&track),
                Some(stage) => {
                    let compared = references.iter().flat_map(|known| known.compare(scene, &track, stage));
                    judge(scene, &track, stage, conditions).into_iter().chain(compared).collect()
                }
            };
            worst = if worst.is_empty() {
                found
            } else {
                worst.into_iter().zip(found).map(|(a, b)| Metric { value: worse(a, b.value), ..a }).collect()
            };
            last = Some(track);
        }
        let kind = self.row_kind(seeds);
        Ok((worst.into_iter().map(|metric| kind.row(metric)).collect(), last))
    }
}

/// The worse of two figures of a kind: the greater where nothing must hold.
fn worse(a: Metric, b: f64) -> f64 {
    a.limit.map_or(a.value.max(b), |limit| limit.worse(a.value, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scenes_that_come_with_it_are_known() {
        for name in ["rest", "lift", "topple", "tray", "push", "punch", "drops", "squeeze"] {
            assert!(matches!(Experiment::named(name), Ok(Experiment::Studio(_))), "{name}");
        }
        assert!(matches!(Experiment::named(NORMALS), Ok(Experiment::Normals)));
        for blow in Blow::ALL {
            assert!(matches!(Experiment::named(blow.name()), Ok(Experiment::Blow(found)) if found == blow));
        }
        assert!(Experiment::named("nothing").is_err());
        let knees = include_str!("../../../deploy/uu_horseman_knees.scene.toml");
        assert_eq!(Scene::from_toml("knees", knees).expect("a scene").bodies(1).len(), 1);
    }
}
