//! The box that is lifted: its size, where it rests, and where it is.

/// The table's top face is this high, metres.
pub const TABLE_HEIGHT_M: f64 = 0.80;
/// The lifted box: across (x), high (y), deep (z), metres.
pub const BOX_SIZE_M: [f64; 3] = [0.50, 0.35, 0.40];
/// The middle of the box while it rests on the table.
pub const BOX_REST_M: [f64; 3] = [0.0, TABLE_HEIGHT_M + 0.5 * BOX_SIZE_M[1], 0.46];
/// How far the box is lifted, metres.
pub const BOX_RISE_M: f64 = 0.35;

/// Where the lifted box is: up from its rest, and turned about the axis through its middle along +Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BoxState {
    pub rise_m: f64,
    pub tilt_rad: f64,
}

impl BoxState {
    pub fn centre_world_m(self) -> [f64; 3] {
        [BOX_REST_M[0], BOX_REST_M[1] + self.rise_m, BOX_REST_M[2]]
    }
}
