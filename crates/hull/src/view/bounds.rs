//! How much a camera's image can stretch and bend over what it shows: what searches may rely on.

use nalgebra::Point2;

use crate::camera::Camera;

/// Bounds on the derivatives of the image by normalised coordinates, over everything that the padded image
/// shows and [`LONGEST_SPAN`] around it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// No image moves faster than this, pixels; over the padded image alone.
    pub stretch: f64,
    /// No image moves slower than this, pixels; over the padded image alone. Nothing if that cannot be said.
    pub shrink: f64,
    /// The normalised radius of the padded image, if its lens bends.
    pub reach: f64,
    /// On the second derivative along a line, pixels.
    pub bend: f64,
    /// On the third, pixels.
    pub twist: f64,
    /// So long a piece of a line is nearly a parabola in the image.
    pub span: f64,
}

/// The longest piece of a line that is looked at as one, in normalised coordinates.
const LONGEST_SPAN: f64 = 0.1;
/// The third derivative of a span may be as much as this, pixels.
const SPAN_TWIST_PIXELS: f64 = 0.2;
/// What a span bends, of its length.
const SPAN_BEND: f64 = 0.03;
/// Places at which a polynomial is looked at for its bound.
const PLACES: u32 = 1024;

impl Bounds {
    /// The bounds of a camera's image with so many pixels around it.
    pub fn of(camera: &Camera, pad: u32) -> Bounds {
        let affine = affine_stretch(camera);
        if camera.lens().is_straight() {
            let endless = f64::INFINITY;
            let shrink = affine_shrink(camera);
            return Bounds { stretch: affine, shrink, reach: endless, bend: 0.0, twist: 0.0, span: endless };
        }
        let reach = reach(camera, pad);
        let r = reach;
        let [k1, k2, p1, p2, k3] = camera.lens().coefficients();
        let tangential = p1.abs() + p2.abs();
        // Across and along the radius.
        let radial = greatest([k1, k2, k3], r * r).max(greatest([3.0 * k1, 5.0 * k2, 7.0 * k3], r * r));
        let stretch = affine * (radial + 6.0 * r * tangential);
        let least = least([k1, k2, k3], r * r).min(least([3.0 * k1, 5.0 * k2, 7.0 * k3], r * r));
        let shrink = (affine_shrink(camera) * (least - 6.0 * r * tangential)).max(0.0);
        let r = (r + LONGEST_SPAN).min(camera.lens().max_radius_squared().sqrt());
        let s = r * r;
        let [k1, k2, k3] = [k1, k2, k3].map(f64::abs);
        let bend = affine * (r * (6.0 * k1 + s * (20.0 * k2 + s * 42.0 * k3)) + 8.0 * tangential);
        let twist = affine * (6.0 * k1 + s * (60.0 * k2 + s * 210.0 * k3));
        let span = LONGEST_SPAN.min(libm::cbrt(SPAN_TWIST_PIXELS / twist)).min(SPAN_BEND * affine / bend);
        Bounds { stretch, shrink, reach, bend, twist, span }
    }
}

/// A bound on the size of `1 + k₁ s + k₂ s² + k₃ s³` for `s` up to `most`.
fn greatest(k: [f64; 3], most: f64) -> f64 {
    if !most.is_finite() {
        return f64::INFINITY;
    }
    let slope = k[0].abs() + most * (2.0 * k[1].abs() + most * 3.0 * k[2].abs());
    let apart = most / f64::from(PLACES);
    let values = (0..=PLACES).map(|at| {
        let s = f64::from(at) * apart;
        (1.0 + s * (k[0] + s * (k[1] + s * k[2]))).abs()
    });
    values.fold(0.0, f64::max) + 0.5 * apart * slope
}

/// A bound from below on `1 + k₁ s + k₂ s² + k₃ s³` for `s` up to `most`.
fn least(k: [f64; 3], most: f64) -> f64 {
    if !most.is_finite() {
        return 0.0;
    }
    let slope = k[0].abs() + most * (2.0 * k[1].abs() + most * 3.0 * k[2].abs());
    let apart = most / f64::from(PLACES);
    let values = (0..=PLACES).map(|at| {
        let s = f64::from(at) * apart;
        1.0 + s * (k[0] + s * (k[1] + s * k[2]))
    });
    values.fold(f64::INFINITY, f64::min) - 0.5 * apart * slope
}

/// How far the intrinsic matrix stretches where it does so least.
fn affine_shrink(camera: &Camera) -> f64 {
    let k = camera.intrinsics();
    let affine = (k[(0, 0)].powi(2) + k[(0, 1)].powi(2) + k[(1, 1)].powi(2)).sqrt();
    if k[(0, 1)] == 0.0 { k[(0, 0)].min(k[(1, 1)]) } else { k[(0, 0)] * k[(1, 1)] / affine }
}

/// How far the intrinsic matrix stretches.
fn affine_stretch(camera: &Camera) -> f64 {
    let k = camera.intrinsics();
    // The Frobenius norm bounds the operator norm.
    let affine = (k[(0, 0)].powi(2) + k[(0, 1)].powi(2) + k[(1, 1)].powi(2)).sqrt();
    if k[(0, 1)] == 0.0 { k[(0, 0)].max(k[(1, 1)]) } else { affine }
}

/// The radius in normalised coordinates of everything the padded image shows.
fn reach(camera: &Camera, pad: u32) -> f64 {
    let pad = f64::from(pad) + 1.0;
    let (right, bottom) = (f64::from(camera.width()) + pad, f64::from(camera.height()) + pad);
    let corners = [(-pad, -pad), (right, -pad), (-pad, bottom), (right, bottom)];
    let reach = corners
        .iter()
        .map(|&(u, v)| camera.normalised(&Point2::new(u, v)).map_or(f64::INFINITY, |n| n.norm()))
        .fold(0.0, f64::max);
    reach.min(camera.lens().max_radius_squared().sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::plain_camera;
    use nalgebra::{Vector2, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn differences_over_the_image_keep_to_the_bounds(
            k1 in -0.35..0.3f64, k2 in -0.2..0.3f64, k3 in -0.1..0.1f64, p1 in -0.003..0.003f64,
            p2 in -0.003..0.003f64, u in 0.0..640.0f64, v in 0.0..480.0f64, angle in 0.0..6.3f64,
        ) {
            let camera = plain_camera([k1, k2, p1, p2, k3]);
            let bounds = Bounds::of(&camera, 3);
            let Some(at) = camera.normalised(&Point2::new(u, v)) else { return Ok(()) };
            let h = 0.01;
            let step = h * Vector2::new(libm::cos(angle), libm::sin(angle));
            let image = |steps: f64| {
                let place: Vector2<f64> = at + step * steps;
                camera.image_from_camera(&Vector3::new(place.x, place.y, 1.0))
            };
            let images: Option<Vec<_>> = [-1.5, -0.5, 0.5, 1.5].into_iter().map(image).collect();
            let Some(images) = images else { return Ok(()) };
            let [a, b, c, d] = [images[0].coords, images[1].coords, images[2].coords, images[3].coords];
            prop_assert!((c - b).norm() <= 1.001 * bounds.stretch * h);
            prop_assert!((c - b).norm() >= 0.999 * bounds.shrink * h);
            prop_assert!((a - b - c + d).norm() <= 2.0 * bounds.bend * h * h);
            prop_assert!((d - c * 3.0 + b * 3.0 - a).norm() <= bounds.twist * h.powi(3) + 1e-9);
        }
    }
}
