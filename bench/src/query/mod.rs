//! `hulltouch-bench query`: points per second of one core.

mod bounds;
mod engines;
mod lanes;
mod opponent;
mod report;
mod rounds;
mod twin;

use clap::Args;
use hull::coordinates::Coordinates;
use hull::cull::WorldBox;
use hull::question::Points;
use nalgebra::Point3;
use serde::Serialize;
use setup::cli::{Failure, Outcome, Progress, parse_size};
use std::cell::RefCell;
use std::slice;

use self::bounds::{BoundSavings, Bounds};
use self::engines::{Sets, contact_lanes, inside_lanes, pass_lanes};
use self::lanes::{Lane, medians};
use self::opponent::{Agreement, Opponent, SCRIPT, TOUCHING};
use self::rounds::{RoundCosts, round_costs};
use self::twin::check_planes;
use super::cluster::bodies::{Bodies, SAMPLES};
use super::loads::{BODY_POINTS, Studio, StudioPlan, paper_mix};
use super::outputs::Outputs;
use super::passes::{Asked, ContactBody, Passes, world_points};
use super::peers::Python;
use super::random::Random;
use super::table::Machine;

/// Cameras of the studio.
const CAMERAS: usize = 8;
/// Points of the inside test.
const BOX_POINTS: usize = 1 << 18;
/// Points of a full pass: those of one film frame.
const PASS_POINTS: usize = 15_000;

/// Bodies of a contact pass, which have as many samples.
const TOUCHING_BODIES: usize = PASS_POINTS / SAMPLES;

/// Points per second of one core: the inside test alone, and full passes.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench query --size 640x480,1920x1080 --python python3 --json query.json --plot charts\n\n\
    Loads: `inside` is the inside test alone, on random points in the box of a person of the stage, most \
    of them outside; `contacts` are full passes over points 1 to 3 cm inside, `anywhere` over points \
    uniformly inside, both in bodies of 64 neighbours. `touching` are contact passes over 30 bodies of \
    500 samples that touch the person: classes of every sample and of its offset sample, a centimetre \
    out, which are counted, planes near those inside and near 192 points around every body; no frame before is \
    there to tell how planes move. `_bent` are the same with distorting lenses. `paper` is the paper's \
    own set-up: 7 cameras and a heap of boxes, all samples counted.\n\n\
    Engines: `hulltouch`; `hulltouch_portable`, the same without vectors that not every machine has; \
    `hulltouch_unpruned`, a node for each camera, all their work on one core; `literal`, the paper's \
    text on masks of a byte a pixel; `opencv`, OpenCV and NumPy on one thread with the distance \
    transform for free, `opencv_single_precision` the same in 32 bits, `opencv_with_transform` with a \
    transform for every 15,000 points, `opencv_with_cropped_transform` with one of the silhouette's \
    rectangle alone. For planes OpenCV transforms the background too, and sums discs around its nearest \
    pixels, which it does not make smaller near thin limbs as ours are. Those of OpenCV need a Python \
    with the packages of bench/peers/requirements.txt; without it their rows are left out. They must \
    agree with ours, and some of our planes with a slow twin, or the bench fails.")]
pub struct QueryBenchArguments {
    /// Image sizes of the eight cameras.
    #[arg(long, value_name = "WxH,…", default_value = "640x480,1920x1080,3840x2160,7680x4320", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    #[command(flatten)]
    python: Python,
    #[command(flatten)]
    outputs: Outputs,
}

/// One figure.
#[derive(Clone, Debug, Serialize)]
struct Row {
    size: String,
    load: String,
    engine: &'static str,
    points_per_s: f64,
    cameras: usize,
    /// `straight` or `bent`.
    lens: &'static str,
}

/// What the slow twin was asked.
#[derive(Clone, Debug, Serialize)]
struct TwinCheck {
    size: String,
    load: String,
    /// Planes compared.
    planes: usize,
    /// Samples and offset samples inside.
    inside: usize,
    /// Points around the bodies with a plane near.
    around: usize,
    /// A plane that differs, if one does.
    failed: Option<String>,
}

/// Everything measured.
#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    machine: Machine,
    /// What the opponent is, or null.
    opencv: serde_json::Value,
    rows: Vec<Row>,
    agreement: Vec<Agreement>,
    twins: Vec<TwinCheck>,
    bounds: Vec<BoundSavings>,
    rounds: Vec<RoundCosts>,
}

/// Runs it.
pub fn run(arguments: &QueryBenchArguments) -> Outcome {
    arguments.outputs.prepare()?;
    let opponent = arguments.python.start(SCRIPT)?.map(|peer| RefCell::new(Opponent { peer }));
    let mut report = Report {
        bench: "query",
        machine: Machine::here(),
        opencv: opponent
            .as_ref()
            .map_or_else(Default::default, |opponent| opponent.borrow().peer.greeting().clone()),
        rows: Vec::new(),
        agreement: Vec::new(),
        twins: Vec::new(),
        bounds: Vec::new(),
        rounds: Vec::new(),
    };
    let measured = report.measure_all(&arguments.size, opponent.as_ref());
    arguments.outputs.write(measured, &report, |folder| report.draw(folder))
}

/// The points of one studio.
struct Loads {
    in_box: Coordinates,
    contacts: Vec<Points>,
    anywhere: Vec<Points>,
    touching: Vec<ContactBody>,
}

impl Loads {
    fn new(studio: &Studio) -> Outcome<Loads> {
        let mut random = Random::new(1);
        let in_box = studio.in_box(&mut random, BOX_POINTS, 0.0).into_iter().map(Point3::from).collect();
        let contacts = studio.bodies(studio.inside(&mut random, PASS_POINTS, true)?);
        let anywhere = studio.bodies(studio.inside(&mut random, PASS_POINTS, false)?);
        let bodies = Bodies::place(TOUCHING_BODIES, SAMPLES, &studio.views, &studio.person_box())?;
        let mut touching = bodies.contacts_at_pass(0, true);
        // Ways out are rare, and nothing that others do too.
        touching.iter_mut().for_each(|body| body.faces = None);
        Ok(Loads { in_box, contacts, anywhere, touching })
    }

    fn passes(&self) -> [(&'static str, &[Points]); 2] {
        [("contacts", &self.contacts), ("anywhere", &self.anywhere)]
    }
}

impl Report {
    /// Everything, with the tables; fails at the end if answers differ that must not.
    fn measure_all(&mut self, sizes: &[(u32, u32)], opponent: Option<&RefCell<Opponent>>) -> Outcome {
        self.print_head()?;
        for &size in sizes {
            self.measure(StudioPlan { cameras: CAMERAS, size, bent: false }, opponent)?;
            self.measure(StudioPlan { cameras: CAMERAS, size, bent: true }, None)?;
        }
        self.measure_paper()?;
        self.print_tail()?;
        let agreements = self.agreement.iter().map(|compared| &compared.failed);
        let failed: Vec<&str> = agreements
            .chain(self.twins.iter().map(|twin| &twin.failed))
            .filter_map(Option::as_deref)
            .collect();
        if failed.is_empty() { Ok(()) } else { Err(Failure::run(failed.join("; "))) }
    }

    /// All loads of one studio.
    fn measure(&mut self, plan: StudioPlan, opponent: Option<&RefCell<Opponent>>) -> Outcome {
        let studio = Studio::new(plan)?;
        let loads = Loads::new(&studio)?;
        let sets = Sets::new(&studio, WorldBox::EVERYWHERE);
        if let Some(opponent) = opponent {
            self.agree(&studio, plan, &loads, &mut opponent.borrow_mut())?;
        }
        self.check_twin(&studio, plan, &loads)?;
        let mut progress = Progress::new("measuring", 4);
        self.record(plan, "inside", &mut inside_lanes(&studio, &sets, &loads.in_box, opponent))?;
        progress.step();
        for (load, bodies) in loads.passes() {
            let theirs = opponent.map(|opponent| (opponent, load));
            self.record(plan, load, &mut pass_lanes(&studio, &sets, bodies, PASS_POINTS, theirs))?;
            self.add_rounds(&studio, plan, load, &sets, bodies)?;
            progress.step();
        }
        self.record(plan, TOUCHING, &mut contact_lanes(&studio, &sets, &loads.touching, opponent))?;
        self.add_rounds(&studio, plan, TOUCHING, &sets, &loads.touching)?;
        progress.step();
        Ok(())
    }

    fn add_rounds<B: Asked>(
        &mut self,
        studio: &Studio,
        plan: StudioPlan,
        load: &str,
        sets: &Sets,
        bodies: &[B],
    ) -> Outcome {
        let (size, load) = (size_text(plan.size), named(load, plan.bent));
        for set in sets.together_and_alone() {
            self.rounds.push(round_costs(studio, (&size, &load), set, bodies)?);
        }
        Ok(())
    }

    /// Compares some planes with the slow twin's.
    fn check_twin(&mut self, studio: &Studio, plan: StudioPlan, loads: &Loads) -> Outcome {
        let mut asked = Passes::new(studio.settings, 1);
        asked.ask(&loads.touching, slice::from_ref(&studio.views), &WorldBox::EVERYWHERE)?;
        let (planes, failed) = check_planes(studio, &loads.touching, &asked);
        self.twins.push(TwinCheck {
            size: size_text(plan.size),
            load: named(TOUCHING, plan.bent),
            planes,
            inside: asked.inside_count(),
            around: asked
                .pass
                .results()
                .iter()
                .filter_map(hull::pass::BodyResult::planes)
                .map(|body| body.around.len())
                .sum(),
            failed,
        });
        Ok(())
    }

    /// The paper's own set-up, and what its bounding volumes save.
    fn measure_paper(&mut self) -> Outcome {
        let plan = StudioPlan { cameras: paper_mix::CAMERAS, size: paper_mix::SIZE, bent: false };
        let studio = Studio::new(plan)?;
        let hull_box = studio.hull_box().ok_or_else(|| Failure::run("no person is on the stage"))?;
        let heap = studio.heap(&mut Random::new(1))?;
        let samples = heap.iter().map(Points::len).sum();
        let sets = Sets::new(&studio, hull_box);
        self.record(plan, "paper", &mut pass_lanes(&studio, &sets, &heap, samples, None))?;
        let bounds = Bounds::new(&studio);
        self.bounds.push(bounds.saved("paper", &heap));
        let in_box = studio.in_box(&mut Random::new(1), BOX_POINTS, 0.0).into();
        self.bounds.push(bounds.saved("inside", &[Points::World(in_box)]));
        Ok(())
    }

    fn record(&mut self, plan: StudioPlan, load: &str, lanes: &mut [Lane]) -> Outcome {
        let rates = medians(lanes)?;
        let first = self.rows.len();
        self.rows.extend(lanes.iter().zip(rates).map(|(lane, points_per_s)| Row {
            size: size_text(plan.size),
            load: named(load, plan.bent),
            engine: lane.engine,
            points_per_s,
            cameras: plan.cameras,
            lens: if plan.bent { "bent" } else { "straight" },
        }));
        self.print_rows(first)
    }

    /// Hands the frame and the points over and compares the answers.
    fn agree(
        &mut self,
        studio: &Studio,
        plan: StudioPlan,
        loads: &Loads,
        opponent: &mut Opponent,
    ) -> Outcome {
        let size = size_text(plan.size);
        opponent.show(studio)?;
        opponent.hand_over("inside", &loads.in_box)?;
        let inside: Vec<bool> = {
            let (mut block, mut standings) = Default::default();
            studio.views.standings(&loads.in_box, &mut block, &mut standings);
            standings.iter().map(|standing| standing.inside_count().is_some()).collect()
        };
        self.agreement.push(opponent.check_inside(studio, &size, &loads.in_box, &inside)?);
        let mut asked = Passes::new(studio.settings, 1);
        for (load, bodies) in loads.passes() {
            let points: Coordinates = bodies.iter().flat_map(world_points).collect();
            debug_assert!(points.len().div_ceil(BODY_POINTS) == bodies.len());
            opponent.hand_over(load, &points)?;
            asked.ask(bodies, slice::from_ref(&studio.views), &WorldBox::EVERYWHERE)?;
            self.agreement.push(opponent.check_responses(studio, &size, load, asked.pass.results())?);
        }
        opponent.hand_over_touching(&loads.touching)?;
        asked.ask(&loads.touching, slice::from_ref(&studio.views), &WorldBox::EVERYWHERE)?;
        let planes = opponent.check_planes(studio, &size, &loads.touching, asked.pass.results())?;
        self.agreement.push(planes);
        Ok(())
    }
}

fn size_text(size: (u32, u32)) -> String {
    format!("{}x{}", size.0, size.1)
}

fn named(load: &str, bent: bool) -> String {
    if bent { format!("{load}_bent") } else { load.to_owned() }
}
