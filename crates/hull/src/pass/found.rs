//! What a pass finds: samples inside the hull, with the surface near them, and what moves a body out.

use nalgebra::Vector3;

use crate::question::Edge;

/// What the pass found for one sample inside the hull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The sample's index in its body.
    pub sample: u32,
    /// How many cameras say inside.
    pub inside_count: u32,
    /// The nearest edge; `None` if no camera has one (all its candidates are ignored).
    pub edge: Option<Edge>,
    /// The distance to the exit along the edge's normal, metres; negative of a [contact](crate::contact) that is still
    /// outside.
    pub exit_m: Option<f32>,
    /// Of a contact: how fast the surface moves out along its normal, m/s, where the frame before tells.
    pub speed_m_s: Option<f32>,
    /// Of a contact: how fast the surface moves along itself, world, m/s; nothing where it is unknown.
    pub slide_m_s: [f32; 3],
}

impl Touch {
    pub(crate) fn new(sample: u32, inside_count: usize) -> Touch {
        Touch {
            sample,
            inside_count: inside_count as u32,
            edge: None,
            exit_m: None,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        }
    }

    /// Whether the sample is inside the hull: a contact may be above its surface.
    pub fn is_inside(&self) -> bool {
        self.exit_m.is_none_or(|exit_m| exit_m >= 0.0)
    }

    /// The normal of its edge, world; zero without one.
    pub(crate) fn normal_world(&self) -> Vector3<f64> {
        self.edge.map_or_else(Vector3::zeros, |edge| Vector3::from(edge.normal_world.map(f64::from)))
    }

    /// The same of a surface that stands still.
    pub(crate) fn at_rest(self) -> Touch {
        Touch { speed_m_s: Some(0.0), slide_m_s: [0.0; 3], ..self }
    }

    /// The sample's response `w`, metres, world; `None` without an exit.
    pub fn response_m(&self) -> Option<[f64; 3]> {
        let (edge, exit_m) = (self.edge?, self.exit_m?);
        Some(edge.normal_world.map(|n| f64::from(n) * f64::from(exit_m)))
    }
}

/// Why a body has no response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoResponse {
    /// The body is clear of the hull.
    Clear,
    /// No sample found its way out along its normal.
    NoDirection,
    /// A sample has no exit along the body's direction within the search depth.
    NoExit,
}

/// What the pass found for one body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyResult {
    /// Its samples inside the hull, ascending.
    pub touches: Vec<Touch>,
    /// The vector that moves it out, metres, world, or why there is none.
    pub response_m: Result<[f64; 3], NoResponse>,
    /// How many of the samples inside are still inside after the response.
    pub left_inside: usize,
    /// Of contacts: how fast the surface turns, world, rad/s; nothing where it is unknown.
    pub spin_rad_s: [f32; 3],
    /// Of points around it that have a plane near, if it touches and they were asked about.
    pub around: Vec<Touch>,
}

impl Default for BodyResult {
    fn default() -> BodyResult {
        BodyResult {
            touches: Vec::new(),
            response_m: Err(NoResponse::Clear),
            left_inside: 0,
            spin_rad_s: [0.0; 3],
            around: Vec::new(),
        }
    }
}
