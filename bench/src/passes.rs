//! Passes one after the other, as a running coordinator makes them.

use std::sync::Arc;

use hull::cull::WorldBox;
use hull::faces::FaceNormals;
use hull::pass::{AskedBody, BodyResult, Pass, Reaches, Round};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{ProbeSettings, ViewSet};
use nalgebra::Point3;

use setup::cli::{Failure, Outcome};

/// A body's points in the world, metres.
pub fn world_points(body: &Points) -> Vec<Point3<f64>> {
    match body {
        Points::World(points_m) => points_m.iter().map(|&point| Point3::from(point)).collect(),
        Points::Body { shape, pose } => {
            let world_from_body = pose.world_from_body();
            shape.samples_body().iter().map(|&sample| world_from_body(sample)).collect()
        }
    }
}

/// What passes ask about a body.
pub trait Asked {
    /// Whether the pass is one for contacts: planes instead of edges, and no responses.
    const IS_OF_CONTACTS: bool;

    /// The body as a pass takes it.
    fn asked<'a>(&self, reaches: &'a Reaches) -> AskedBody<'a>;

    /// How many points the classes of are asked.
    fn point_count(&self) -> usize;
}

impl Asked for Points {
    const IS_OF_CONTACTS: bool = false;

    fn asked<'a>(&self, reaches: &'a Reaches) -> AskedBody<'a> {
        AskedBody::plain(self.clone(), reaches)
    }

    fn point_count(&self) -> usize {
        self.len()
    }
}

/// A body as worlds ask about it with contacts.
#[derive(Clone, Debug)]
pub struct ContactBody {
    /// Its samples, and each of them again a centimetre out.
    pub probes: Points,
    /// Points around it, if it is asked about for the first time in a frame.
    pub around: Option<Points>,
    /// Which way its faces look: where none is faced, its ways out are asked for.
    pub faces: Option<Arc<FaceNormals>>,
}

impl Asked for ContactBody {
    const IS_OF_CONTACTS: bool = true;

    fn asked<'a>(&self, reaches: &'a Reaches) -> AskedBody<'a> {
        let ContactBody { probes, around, faces } = self;
        AskedBody {
            points: probes.clone(),
            around: around.clone(),
            faces: faces.clone(),
            back_m: None,
            reaches,
        }
    }

    fn point_count(&self) -> usize {
        self.probes.len()
    }
}

/// A pass that is asked again and again, with its buffers and what it learned of the bodies.
pub struct Passes {
    /// The pass that was begun last.
    pub pass: Pass,
    reaches: Vec<Reaches>,
    scratch: Scratch,
    answer: Answer,
}

impl Passes {
    /// To be asked of so many groups, in two phases where several answer.
    pub fn new(settings: ProbeSettings, group_count: usize) -> Passes {
        let mut pass = Pass::new(Vec::new(), None, settings, group_count);
        pass.ask_in_two_phases(true);
        Passes { pass, reaches: Vec::new(), scratch: Scratch::default(), answer: Answer::default() }
    }

    /// Begins the next. Bodies that were asked before are searched at first as far as their edges were then.
    pub fn begin<B: Asked>(&mut self, bodies: &[B], hull_box: &WorldBox) {
        self.reaches.resize_with(bodies.len(), Reaches::default);
        self.reaches.iter_mut().zip(self.pass.results()).for_each(|(reaches, result)| reaches.note(result));
        if B::IS_OF_CONTACTS {
            self.pass.for_contacts();
        } else {
            self.pass.for_response();
        }
        let asked = bodies.iter().zip(&self.reaches).map(|(body, reaches)| body.asked(reaches));
        self.pass.restart(asked, Some(hull_box));
    }

    /// Has it answered on this thread, by the groups one after the other. `lap` hears of every round that was
    /// answered, and of [`Round::Done`] after what lies between: making questions and merging answers.
    pub fn answer(&mut self, groups: &[ViewSet], mut lap: impl FnMut(Round)) -> Outcome {
        while let Some(question) = self.pass.question() {
            let next = (0..groups.len()).find(|&group| self.pass.asks(group));
            let group = next.ok_or_else(|| Failure::run("a pass asks no group"))?;
            let round = self.pass.round();
            groups[group].answer(question, &mut self.scratch, &mut self.answer);
            lap(round);
            self.pass.answer(group, &self.answer).map_err(Failure::run)?;
            lap(Round::Done);
        }
        Ok(())
    }

    /// A whole pass on this thread.
    pub fn ask<B: Asked>(&mut self, bodies: &[B], groups: &[ViewSet], hull_box: &WorldBox) -> Outcome {
        self.begin(bodies, hull_box);
        self.answer(groups, |_| {})
    }

    /// How many samples of all bodies the last pass found inside.
    pub fn inside_count(&self) -> usize {
        self.pass.results().iter().map(BodyResult::inside_count).sum()
    }
}
