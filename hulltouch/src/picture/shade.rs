//! Colours and light. Colours here are linear, 0 to 1; sRGB comes in and goes out.

use nalgebra::Vector3;

/// A linear colour.
pub(super) type Colour = Vector3<f64>;

/// The person's hull: matte clay.
pub(super) const HULL_SRGB: [f32; 3] = [0.90, 0.76, 0.65];
/// Samples inside the hull.
pub(super) const SAMPLE_SRGB: [f32; 3] = [1.0, 0.95, 0.25];
const TOP_SRGB: [f32; 3] = [0.20, 0.23, 0.29];
const BOTTOM_SRGB: [f32; 3] = [0.10, 0.12, 0.15];
const FLOOR_SRGB: [f32; 3] = [0.24, 0.27, 0.33];
const LINE_SRGB: [f32; 3] = [0.40, 0.45, 0.53];
/// What is left of the floor's light in the shadow.
const SHADOW: f64 = 0.38;
/// The floor fades into the background about so far from what is shown, metres.
const FLOOR_FADE_M: f64 = 4.0;
/// Width of the floor's lines, metres.
const LINE_M: f64 = 0.012;
/// From line to line, metres.
const LINE_SPACING_M: f64 = 0.5;

/// The lamp and the sky of a picture.
pub(super) struct Light {
    /// Unit vector to the lamp.
    pub towards_lamp: Vector3<f64>,
    /// Unit vector to the dim lamp on the other side.
    towards_fill: Vector3<f64>,
    up: Vector3<f64>,
}

impl Light {
    /// A lamp above the viewer's left shoulder.
    pub fn new(up: Vector3<f64>, right: &Vector3<f64>, towards_viewer: &Vector3<f64>) -> Light {
        Light {
            towards_lamp: (up * 1.3 - right * 0.9 + towards_viewer * 0.9).normalize(),
            towards_fill: (up * 0.2 + right * 1.0 + towards_viewer * 0.6).normalize(),
            up,
        }
    }

    /// The light that a matte surface sends back; `lit` if the lamp reaches it.
    pub fn matte(&self, colour: &Colour, normal: &Vector3<f64>, lit: bool) -> Colour {
        let lamp = if lit { normal.dot(&self.towards_lamp).max(0.0) } else { 0.0 };
        let fill = normal.dot(&self.towards_fill).max(0.0);
        let sky = 0.5 + 0.5 * normal.dot(&self.up);
        let light = Vector3::new(0.95, 0.91, 0.84) * lamp
            + Vector3::new(0.14, 0.17, 0.23) * fill
            + Vector3::new(0.15, 0.17, 0.20) * sky
            + Vector3::new(0.06, 0.055, 0.05);
        colour.component_mul(&light)
    }
}

/// Linear from sRGB.
pub(super) fn linear(srgb: [f32; 3]) -> Colour {
    // The curve's square is near enough for a picture.
    Vector3::from(srgb.map(|value| f64::from(value) * f64::from(value)))
}

/// sRGB bytes from linear.
pub(super) fn bytes(colour: &Colour) -> [u8; 3] {
    let byte = |value: f64| (value.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8;
    [byte(colour.x), byte(colour.y), byte(colour.z)]
}

/// The background at a share of the picture's height, from its top.
pub(super) fn background(share: f64) -> Colour {
    linear(TOP_SRGB).lerp(&linear(BOTTOM_SRGB), share.clamp(0.0, 1.0))
}

/// The floor: `place_m` on its axes, `footprint_m` of a pixel along each, `away_m` from the centre.
pub(super) fn floor(
    place_m: [f64; 2],
    footprint_m: [f64; 2],
    away_m: f64,
    lit: bool,
    background: &Colour,
) -> Colour {
    let mut line: f64 = 0.0;
    for axis in 0..2 {
        let from_line_m = (place_m[axis] / LINE_SPACING_M).round() * LINE_SPACING_M - place_m[axis];
        let footprint_m = footprint_m[axis].max(1e-6);
        let covered = 0.5 + (0.5 * LINE_M - from_line_m.abs()) / footprint_m;
        // A line narrower than a pixel covers no more than its share of it.
        line = line.max(covered.clamp(0.0, (LINE_M / footprint_m).min(1.0)));
    }
    let plain = linear(FLOOR_SRGB).lerp(&linear(LINE_SRGB), line);
    let shown = if lit { plain } else { plain * SHADOW };
    let fade = 1.0 / (1.0 + (away_m / FLOOR_FADE_M).powi(4));
    background.lerp(&shown, fade)
}
