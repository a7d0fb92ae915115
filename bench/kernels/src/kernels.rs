//! Six kernels, each a piece of work over the studio that says something of what it found.

use std::hint::black_box;

use hull::camera::Pixel;
use hull::pass::AROUND_REACH;
use hull::probe::classify::Block;
use hull::probe::edge_normal::sum_of_background;
use hull::probe::nearest_edge::nearest_edge;
use hull::question::{Answer, Batch, Edge, Points, Question, QuestionKind, Standing};
use hull::silhouette::Index;
use hull::view_set::Scratch;
use hull::{VectorPath, ViewSet};

use crate::drawing::Studio;

/// Points that ask for an edge, an exit or a window.
const INSIDE: usize = 512;
/// No limit to a search.
const EVERYWHERE: i64 = i64::MAX;

/// What a kernel does.
pub type Kernel = fn(&mut Kernels) -> u64;

/// The kernels by name.
pub const KERNELS: [(&str, Kernel); 6] = [
    ("inside", Kernels::inside),
    ("nearest_edge", Kernels::nearest_edge),
    ("normal_window", Kernels::normal_window),
    ("exit", Kernels::exit),
    ("touching", Kernels::touching),
    ("index", Kernels::index),
];

/// A studio with everything that a kernel needs, so that nothing but the kernel is measured.
pub struct Kernels {
    studio: Studio,
    views: ViewSet,
    /// For each view the pixels of points inside.
    starts: Vec<Vec<Pixel>>,
    /// For each view the edges nearest to them.
    edges: Vec<Vec<Pixel>>,
    exits: Question,
    planes: Question,
    /// The frames of the person that planes are asked of by turns: what is kept of one is of no use to the next.
    frames: [ViewSet; 2],
    block: Block,
    standings: Vec<Standing>,
    scratch: Scratch,
    answer: Answer,
}

impl Kernels {
    /// The kernels on images of that size, with these instructions if the processor has them.
    pub fn new(size: (u32, u32), points: usize, path: VectorPath) -> Kernels {
        let mut studio = Studio::new(size, points);
        studio.inside.truncate(INSIDE);
        let views = ViewSet::new(studio.views()).with_path(path);
        let starts: Vec<Vec<Pixel>> = views
            .views()
            .iter()
            .map(|view| studio.inside.iter().filter_map(|point| view.camera().pixel(point)).collect())
            .collect();
        let mut kernels = Kernels {
            exits: exits(&studio, &views),
            planes: planes(&studio),
            frames: [&views, &views]
                .map(|before| ViewSet::new(studio.views()).with_path(path).after(before, 1)),
            edges: Vec::new(),
            studio,
            views,
            starts,
            block: Block::default(),
            standings: Vec::new(),
            scratch: Scratch::default(),
            answer: Answer::default(),
        };
        kernels.edges = kernels.found_edges();
        kernels
    }

    fn found_edges(&self) -> Vec<Vec<Pixel>> {
        let pairs = self.views.views().iter().zip(&self.starts);
        let edges = pairs.map(|(view, starts)| {
            let edge =
                |&start: &Pixel| nearest_edge(view.edge_candidates(), start, EVERYWHERE, self.views.path());
            starts.iter().filter_map(edge).map(|edge| edge.pixel).collect()
        });
        edges.collect()
    }

    /// The inside test of a block in all cameras: how many points are inside.
    pub fn inside(&mut self) -> u64 {
        self.standings.clear();
        self.views.standings(black_box(&self.studio.in_box), &mut self.block, &mut self.standings);
        self.standings.iter().filter(|standing| standing.inside_count().is_some()).count() as u64
    }

    /// The nearest background pixel in every camera, without bounds: the sum of squared distances.
    pub fn nearest_edge(&mut self) -> u64 {
        let mut sum = 0;
        for (view, starts) in self.views.views().iter().zip(&self.starts) {
            for &start in black_box(starts) {
                let found = nearest_edge(view.edge_candidates(), start, EVERYWHERE, self.views.path());
                sum += found.map_or(0, |edge| edge.squared as u64);
            }
        }
        sum
    }

    /// The window sums at every edge: how many do not vanish.
    pub fn normal_window(&mut self) -> u64 {
        let mut count = 0;
        for (view, edges) in self.views.views().iter().zip(&self.edges) {
            let window = view.observer().window_pixels();
            for &edge in black_box(edges) {
                let candidates = view.edge_candidates().map();
                let sum = sum_of_background(candidates, edge, window, self.views.path());
                count += u64::from(sum.x != 0.0 || sum.y != 0.0);
            }
        }
        count
    }

    /// The exit of every point among all cameras: how many have one.
    pub fn exit(&mut self) -> u64 {
        self.views.answer(black_box(&self.exits), &mut self.scratch, &mut self.answer);
        self.answer.exits_m.iter().filter(|t_m| t_m.is_finite()).count() as u64
    }

    /// The planes of the surface near points in the box, of a frame that nothing was asked of: how many there are.
    pub fn touching(&mut self) -> u64 {
        self.frames.swap(0, 1);
        self.frames[0].answer(black_box(&self.planes), &mut self.scratch, &mut self.answer);
        self.answer.edges.iter().flatten().count() as u64
    }

    /// Every camera's index, made again: its bytes.
    pub fn index(&mut self) -> u64 {
        let made =
            self.studio.silhouettes.iter().map(|silhouette| Index::foreground(black_box(silhouette), 1));
        made.map(|index| index.heap_bytes() as u64).sum()
    }
}

/// Every point inside asks along the normal of its edge.
fn exits(studio: &Studio, views: &ViewSet) -> Question {
    let points: Vec<[f64; 3]> = studio.inside.iter().map(|&point| point.into()).collect();
    let batches = vec![Batch::all(Points::World(points.into()))];
    let edges = Question { kind: QuestionKind::Edges, batches: batches.clone(), ..Question::default() };
    let mut answer = Answer::default();
    views.answer(&edges, &mut Scratch::default(), &mut answer);
    let normal = |edge: &Option<Edge>| edge.map_or([0.0, 1.0, 0.0], |edge| edge.normal_world);
    let directions = answer.edges.iter().map(normal).collect();
    Question { kind: QuestionKind::Exits, batches, directions, ..Question::default() }
}

/// Every point in the box asks for a plane that is as near as those around bodies are.
fn planes(studio: &Studio) -> Question {
    let points: Vec<[f64; 3]> = (0..studio.in_box.len()).map(|at| studio.in_box.point(at).into()).collect();
    let within = vec![AROUND_REACH; points.len()];
    let batches = vec![Batch::all(Points::World(points.into()))];
    Question { kind: QuestionKind::Planes, batches, within, ..Question::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_finds_something_and_the_same_on_every_path() {
        let mut plain = Kernels::new((640, 480), 4096, VectorPath::Portable);
        let mut best = Kernels::new((640, 480), 4096, VectorPath::best());
        for (name, kernel) in KERNELS {
            let found = kernel(&mut plain);
            assert!(found > 0, "{name} found nothing");
            assert_eq!(found, kernel(&mut best), "{name}");
        }
    }
}
