//! The hull drawn back into a real camera, against that camera's own silhouette.

use hull::camera::Pixel;
use hull::{Camera, Class, View};
use sim::ray::Ray;

use super::field::Outline;
use super::hull_ray::{HullTracer, Scratch};

/// For each view, in the order given: intersection over union of the hull of all, ray-marched from its
/// camera with its lens, with its own silhouette; over the pixels that are not ignored.
pub fn overlaps(views: &[View]) -> Vec<f64> {
    let tracer = HullTracer::new(views, Outline::Exact);
    views.iter().map(|view| overlap(&mask(&tracer, views, view.camera()), view)).collect()
}

/// Intersection over union of a mask of the view's camera and its foreground, over the pixels that are not
/// ignored; one if both are empty.
///
/// # Panics
/// If the mask is not of the camera's size.
pub(super) fn overlap(mask: &[u8], view: &View) -> f64 {
    let (width, height) = (view.camera().width() as usize, view.camera().height() as usize);
    assert_eq!(mask.len(), width * height, "a mask of the camera's size");
    let (mut both, mut either) = (0u64, 0u64);
    for (row, pixels) in mask.chunks_exact(width).enumerate() {
        for (column, &drawn) in pixels.iter().enumerate() {
            let class = view.class_at(Some(Pixel { column: column as i32, row: row as i32 }));
            if class != Class::Unknown {
                both += u64::from(drawn != 0 && class == Class::Inside);
                either += u64::from(drawn != 0 || class == Class::Inside);
            }
        }
    }
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// One byte per pixel, row by row: 255 where the viewing ray through the pixel's centre meets the hull of
/// `views`, whose tracer this is.
pub(super) fn mask(tracer: &HullTracer, views: &[View], camera: &Camera) -> Vec<u8> {
    let width = camera.width() as usize;
    let mut mask = vec![0; width * camera.height() as usize];
    // All of a viewing ray falls on its pixel: what the camera itself rejects need not be followed.
    let own = views.iter().find(|view| view.camera() == camera);
    let mut scratch = Scratch::default();
    for (row, pixels) in mask.chunks_exact_mut(width).enumerate() {
        for (column, drawn) in pixels.iter_mut().enumerate() {
            let pixel = Pixel { column: column as i32, row: row as i32 };
            if own.is_some_and(|own| own.class_at(Some(pixel)) == Class::Outside) {
                continue;
            }
            let Some(direction) = camera.ray_world(&pixel.centre()) else { continue };
            let ray = Ray { start: camera.centre_world(), direction };
            if tracer.first_inside(&ray, &mut scratch).is_some() {
                *drawn = 255;
            }
        }
    }
    mask
}
