//! Planes of edge pixels that were fitted before: many points share an edge pixel, and so its plane.

use nalgebra::Point3;

use crate::camera::Pixel;
use crate::vector::VectorPath;
use crate::view::{SurfacePlane, Turn, View};

/// Planes that are kept of a view: of a person there are some two thousand edge pixels.
const MOST_SLOTS: usize = 2048;
/// Planes that are kept of all views, so that a machine with hundreds of cameras keeps no more than 15 MB a thread.
const SLOTS_OF_ALL: usize = 1 << 17;

/// Planes of the views of a group, each of one frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes {
    views: Vec<Kept>,
}

/// Planes of one view, in slots by edge pixel: a new one takes the slot of another. None is cleared with its frame: slots
/// know of which frame they are.
#[derive(Clone, Debug, Default)]
struct Kept(Vec<Slot>);

#[derive(Clone, Copy, Debug)]
struct Slot {
    edge: EdgeOfView,
    plane: SurfacePlane,
    turn: Turn,
}

/// An edge pixel of a camera at a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct EdgeOfView {
    /// Of the view.
    serial: u64,
    pixel: Pixel,
}

/// No view has this number.
const NOWHERE: EdgeOfView = EdgeOfView { serial: 0, pixel: Pixel { column: 0, row: 0 } };

impl Planes {
    /// Makes room for the planes of these views.
    pub fn prepare(&mut self, views: &[View]) {
        // Questions about fewer cameras come between.
        let count = views.len().max(self.views.len());
        let slots = (SLOTS_OF_ALL / count.next_power_of_two()).clamp(1, MOST_SLOTS);
        self.views.resize_with(count, Kept::default);
        for Kept(kept) in &mut self.views {
            kept.resize(slots, Slot { edge: NOWHERE, plane: SurfacePlane::NONE, turn: Turn::UNKNOWN });
        }
    }

    /// The plane at an edge pixel of a view; see [`View::plane`].
    #[inline(always)]
    pub fn of(
        &mut self,
        index: usize,
        view: &View,
        edge: Pixel,
        start: Pixel,
        path: VectorPath,
    ) -> SurfacePlane {
        let (slot, of_view) =
            (self.views[index].slot(edge), EdgeOfView { serial: view.serial(), pixel: edge });
        if slot.edge == of_view {
            return slot.plane;
        }
        let (plane, depends_on_start) = view.plane(edge, start, path);
        if !depends_on_start {
            *slot = Slot { edge: of_view, plane, turn: Turn::UNKNOWN };
        }
        plane
    }

    /// How far the plane at an edge pixel of a view moves in a frame near a point, metres; not a number where nothing
    /// tells.
    #[inline(always)]
    pub fn moved_m(
        &mut self,
        index: usize,
        view: &View,
        edge: Pixel,
        plane: &SurfacePlane,
        point: &Point3<f64>,
        path: VectorPath,
    ) -> f32 {
        let mut unknown = Turn::UNKNOWN;
        let (slot, of_view) =
            (self.views[index].slot(edge), EdgeOfView { serial: view.serial(), pixel: edge });
        let turn = if slot.edge == of_view { &mut slot.turn } else { &mut unknown };
        view.moved_m(&plane.line, point, turn, path).map_or(f32::NAN, |moved_m| moved_m as f32)
    }
}

impl Kept {
    /// Where the plane at an edge pixel is kept.
    #[inline(always)]
    fn slot(&mut self, edge: Pixel) -> &mut Slot {
        // Neighbours along an edge have slots of their own. There is a power of two of them.
        let place = (edge.column as u32).wrapping_add((edge.row as u32).wrapping_mul(57)) as usize;
        let last = self.0.len() - 1;
        &mut self.0[place & last]
    }
}
