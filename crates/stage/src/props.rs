//! Real things in the studio that cameras see as foreground: a table, the box that is lifted, the tray that is carried.

use std::str::FromStr;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::lifted_box::BoxState;
pub use crate::lifted_box::{BOX_REST_M, BOX_RISE_M, BOX_SIZE_M, TABLE_HEIGHT_M};
use crate::maths::turn_z;
use crate::motion::Motion;
use crate::motions::{carry, lift};
use crate::solid::{Material, Solid};
use crate::tray;
pub use crate::tray::{TRAY_REST_M, TRAY_SIZE_M};

/// The table's top: across (x), thick (y), deep (z), metres.
pub const TABLE_TOP_M: [f64; 3] = [0.80, 0.04, 0.60];
/// The middle of the table on the floor.
pub const TABLE_PLACE_M: [f64; 3] = [0.0, 0.0, 0.52];
/// A real thing in the studio. Without the person all stay where they are at time 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Prop {
    /// A table in front of the person: [`TABLE_TOP_M`] on four legs, at [`TABLE_PLACE_M`].
    Table,
    /// A cardboard box of [`BOX_SIZE_M`] at [`BOX_REST_M`]; the motion `lift` moves it.
    LiftedBox,
    /// A wooden tray of [`TRAY_SIZE_M`] on two feet, its board at [`TRAY_REST_M`]; the motion `tray` moves it.
    Tray,
}

/// A prop's name is not one of those known.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("prop {found:?}, expected one of table, box, tray")]
pub struct UnknownProp {
    /// What was given.
    pub found: String,
}

impl Prop {
    /// The name used on command lines and in files.
    pub fn name(self) -> &'static str {
        match self {
            Prop::Table => "table",
            Prop::LiftedBox => "box",
            Prop::Tray => "tray",
        }
    }

    /// The solids of the prop at that time, in the world.
    pub(crate) fn solids(self, motion: Motion, moving: bool, time_s: f64, solids: &mut Vec<Solid>) {
        let (middle, tilt_rad) = self.place(motion, moving, time_s);
        match self {
            Prop::Table => table(solids),
            Prop::LiftedBox => {
                let half = Vector3::from(BOX_SIZE_M) * 0.5;
                solids.push(Solid::cuboid(middle, turn_z(tilt_rad), half, Material::Cardboard));
            }
            Prop::Tray => tray::tray(middle, solids),
        }
    }

    /// Where the prop's middle is (of the box, the tray's board, the table on the floor), world, metres, and how far it
    /// is turned about +Z, radians. `moving` is false in a studio without the person.
    pub(crate) fn place(self, motion: Motion, moving: bool, time_s: f64) -> (Vector3<f64>, f64) {
        match self {
            Prop::Table => (Vector3::from(TABLE_PLACE_M), 0.0),
            Prop::LiftedBox => {
                let state = box_state(motion, moving, time_s);
                (Vector3::from(state.centre_world_m()), state.tilt_rad)
            }
            Prop::Tray => {
                let is_carried = motion == Motion::Tray && moving;
                let loop_s = motion.since_s(time_s) % carry::TRAY_PERIOD_S;
                let offset = if is_carried { carry::tray_offset(loop_s) } else { Vector3::zeros() };
                (Vector3::from(TRAY_REST_M) + offset, 0.0)
            }
        }
    }
}

impl FromStr for Prop {
    type Err = UnknownProp;

    fn from_str(text: &str) -> Result<Prop, UnknownProp> {
        [Prop::Table, Prop::LiftedBox, Prop::Tray]
            .into_iter()
            .find(|prop| prop.name() == text)
            .ok_or_else(|| UnknownProp { found: text.to_owned() })
    }
}

/// Where the lifted box is at a time of the film, seconds. `moving` is false in a studio without the person.
pub(crate) fn box_state(motion: Motion, moving: bool, time_s: f64) -> BoxState {
    if motion == Motion::Lift && moving {
        lift::box_state(motion.since_s(time_s) % lift::LIFT_PERIOD_S)
    } else {
        BoxState { rise_m: 0.0, tilt_rad: 0.0 }
    }
}

fn table(solids: &mut Vec<Solid>) {
    let place = Vector3::from(TABLE_PLACE_M);
    let mut push = |centre: Vector3<f64>, half: Vector3<f64>| {
        solids.push(Solid::cuboid(place + centre, Matrix3::identity(), half, Material::Wood));
    };
    let half = Vector3::from(TABLE_TOP_M) * 0.5;
    push(Vector3::new(0.0, TABLE_HEIGHT_M - half.y, 0.0), half);
    let leg_half = 0.025;
    let height_m = TABLE_HEIGHT_M - TABLE_TOP_M[1];
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let centre = Vector3::new(x * (half.x - 0.05), 0.5 * height_m, z * (half.z - 0.05));
        push(centre, Vector3::new(leg_half, 0.5 * height_m, leg_half));
    }
}
