//! A pass allocates nothing once its buffers have grown.

mod common;

#[allow(unsafe_code, reason = "an allocator is unsafe; this one counts and leaves the work to the system's")]
mod counting {
    use std::alloc::{GlobalAlloc, Layout, System};
    use std::cell::Cell;

    thread_local! {
        static COUNT: Cell<u64> = const { Cell::new(0) };
    }

    pub struct Counting;

    unsafe impl GlobalAlloc for Counting {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            // While a thread ends its counter is gone, and is not read.
            let _ = COUNT.try_with(|count| count.set(count.get() + 1));
            unsafe { System.alloc(layout) }
        }

        unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
            unsafe { System.dealloc(pointer, layout) }
        }
    }

    /// Allocations of this thread so far.
    pub fn count() -> u64 {
        COUNT.with(Cell::get)
    }
}

use std::sync::Arc;

use common::{Dice, random_rig};
use hull::cull::WorldBox;
use hull::pass::{AskedBody, BodyResult, Pass, Reaches};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{HullRule, NormalWindow, OutOfView, Pose, ProbeSettings, Shape, VectorPath, ViewSet};

#[global_allocator]
static ALLOCATOR: counting::Counting = counting::Counting;

/// A ball of samples.
fn shape() -> Arc<Shape> {
    let mut dice = Dice(5);
    let samples = (0..400).map(|_| std::array::from_fn(|_| dice.between(-0.25, 0.25) as f32));
    Arc::new(Shape::new(samples.collect()).expect("finite"))
}

fn run(sets: &[ViewSet], pass: &mut Pass, poses: &[Pose], shape: &Arc<Shape>, buffers: &mut Buffers) {
    let body = |pose: &Pose| Points::Body { shape: Arc::clone(shape), pose: *pose };
    buffers.reaches.resize_with(poses.len(), Reaches::default);
    buffers.reaches.iter_mut().zip(pass.results()).for_each(|(reaches, result)| reaches.note(result));
    let bodies =
        poses.iter().zip(&buffers.reaches).map(|(pose, reaches)| AskedBody::plain(body(pose), reaches));
    pass.restart(bodies, Some(&WorldBox::EVERYWHERE));
    while let Some(question) = pass.question() {
        for (set, answer) in sets.iter().zip(&mut buffers.answers) {
            set.answer(question, &mut buffers.scratch, answer);
        }
        for (group, answer) in buffers.answers.iter().enumerate() {
            if pass.asks(group) {
                pass.answer(group, answer).expect("a fitting answer");
            }
        }
    }
}

#[derive(Default)]
struct Buffers {
    scratch: Scratch,
    answers: Vec<Answer>,
    reaches: Vec<Reaches>,
}

/// Allocations of passes after others with the same bodies have run, and the samples inside in the last.
fn allocations(out_of_view: OutOfView, alone: bool, path: VectorPath) -> (u64, usize) {
    let rule = HullRule { out_of_view, min_views: 2 };
    let settings = ProbeSettings::new(rule, NormalWindow::Auto, 1.0).expect("in range");
    let (_, views) = random_rig(7, settings, false);
    let sets: Vec<ViewSet> = if alone {
        vec![ViewSet::new(views)]
    } else {
        views.into_iter().map(|view| ViewSet::new(vec![view])).collect()
    };
    let sets: Vec<ViewSet> = sets.into_iter().map(|set| set.with_path(path)).collect();
    let shape = shape();
    let mut dice = Dice(9);
    let mut pose = || {
        let place = std::array::from_fn(|_| dice.between(-0.4, 0.4));
        Pose::new(place, [0.0, 0.0, 0.0, 1.0]).expect("unit")
    };
    let poses: Vec<Pose> = (0..6).map(|_| pose()).collect();
    let mut pass = Pass::new(Vec::new(), None, settings, sets.len());
    let mut buffers = Buffers { answers: vec![Answer::default(); sets.len()], ..Buffers::default() };
    for _ in 0..3 {
        run(&sets, &mut pass, &poses, &shape, &mut buffers);
    }
    let before = counting::count();
    for _ in 0..5 {
        run(&sets, &mut pass, &poses, &shape, &mut buffers);
    }
    let inside = pass.results().iter().map(BodyResult::inside_count).sum();
    (counting::count() - before, inside)
}

#[test]
fn a_pass_allocates_nothing_after_warm_up() {
    for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
        for alone in [true, false] {
            let (count, inside) = allocations(OutOfView::Outside, alone, path);
            assert!(inside > 50, "{inside} samples inside: the bodies test nothing");
            assert_eq!(count, 0, "{path:?}, alone: {alone}");
        }
    }
}

#[test]
fn nor_when_cameras_abstain() {
    let (count, inside) = allocations(OutOfView::Abstain, false, VectorPath::best());
    assert!(inside > 50, "{inside} samples inside: the bodies test nothing");
    assert_eq!(count, 0);
}

#[test]
fn the_counter_counts() {
    let before = counting::count();
    drop(std::hint::black_box(vec![1, 2, 3]));
    assert_eq!(counting::count() - before, 1);
}
