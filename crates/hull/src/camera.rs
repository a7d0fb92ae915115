//! One calibrated camera: world to pixel, and back to a ray.

use nalgebra::{Matrix2x3, Matrix3, Point2, Point3, Vector2, Vector3};
use thiserror::Error;

use crate::lens::Lens;
use crate::rotation::{matrix_from_rodrigues, rodrigues_from_matrix, rotation_defect};

/// The largest side of an image, pixels. Runs store columns in 16 bits; no camera comes near.
pub const MAX_SIDE_PIXELS: u32 = 16_384;
/// A rotation vector is at most so long, radians: OpenCV writes up to π, optimisers some more.
const MAX_ROTATION_RAD: f64 = core::f64::consts::TAU;
/// A focal length is at least this share of an image's side: the whole side is 157 degrees then.
const MIN_FOCAL_SHARE: f64 = 0.1;

/// A pixel by column (to the right) and row (down); may lie off the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pixel {
    /// Pixels to the right of the leftmost column.
    pub column: i32,
    /// Pixels below the top row.
    pub row: i32,
}

impl Pixel {
    /// The pixel that holds image coordinates `(u, v)`; far-away values saturate.
    #[inline]
    pub fn holding(u: f64, v: f64) -> Pixel {
        Pixel { column: floor(u + 0.5), row: floor(v + 0.5) }
    }

    /// The image coordinates of the pixel's centre.
    pub fn centre(self) -> Point2<f64> {
        Point2::new(f64::from(self.column), f64::from(self.row))
    }
}

/// The floor of a number as an integer. Numbers beyond [`FAR_PIXELS`], and those that are none, become
/// that or its negative. Done with sums and comparisons alone, so that loops around it vectorise on every
/// processor.
#[inline(always)]
pub(crate) fn floor(value: f64) -> i32 {
    /// In doubles of this size the last binary digit is one.
    const UNIT: f64 = 6_755_399_441_055_744.0;
    let value = if value > -FAR_PIXELS { value } else { -FAR_PIXELS };
    let value = if value < FAR_PIXELS { value } else { FAR_PIXELS };
    let sum = value + UNIT;
    let nearest = sum.to_bits() as i32;
    nearest - i32::from(sum - UNIT > value)
}

/// Farther away than any image is wide.
const FAR_PIXELS: f64 = (1 << 30) as f64;

/// What is wrong with a camera's numbers.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CameraError {
    /// A side is zero or too large.
    #[error("size is {width} x {height}, expected 1 to {MAX_SIDE_PIXELS} pixels a side")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// A number is NaN or infinite.
    #[error("{key} holds {value}, expected finite numbers")]
    NotFinite {
        /// Which of the camera's keys.
        key: &'static str,
        /// The offending number.
        value: f64,
    },
    /// The intrinsic matrix has the wrong form.
    #[error("matrix {found}, expected [fx s cx; 0 fy cy; 0 0 1] with fx and fy above zero")]
    Matrix {
        /// What about it.
        found: String,
    },
    /// The rotation vector is longer than any program writes in radians.
    #[error("rotation is a vector of {length:.1} rad, expected at most 2 π: are these degrees?")]
    Turns {
        /// Its length.
        length: f64,
    },
    /// The intrinsics belong to another image.
    #[error(
        "matrix has {found} for an image of {width} x {height}, expected {expected}: is it in pixels of this size?"
    )]
    OtherImage {
        /// What about it.
        found: String,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// What would do.
        expected: &'static str,
    },
    /// The rotation is not one.
    #[error("rotation is off by {defect:.2e} from R Rᵀ = 1, expected a rotation (within 1e-6)")]
    Rotation {
        /// The largest entry of `R Rᵀ − I`, 2 if mirrored.
        defect: f64,
    },
}

/// A calibrated camera. `x_camera = rotation · x_world + translation_m`, then the pinhole, then the
/// lens, then the intrinsic matrix. A value that exists is valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    name: String,
    width: u32,
    height: u32,
    intrinsics: Matrix3<f64>,
    lens: Lens,
    rotation_rad: Vector3<f64>,
    rotation: Matrix3<f64>,
    translation_m: Vector3<f64>,
    centre_world: Point3<f64>,
}

impl Camera {
    /// A camera from its calibration: `intrinsics` in pixels, distortion `k1 k2 p1 p2 k3`, the
    /// Rodrigues vector and translation that take world points into the camera frame.
    pub fn new(
        name: impl Into<String>,
        (width, height): (u32, u32),
        intrinsics: Matrix3<f64>,
        distortion: [f64; 5],
        rotation_rad: Vector3<f64>,
        translation_m: Vector3<f64>,
    ) -> Result<Camera, CameraError> {
        if !(1..=MAX_SIDE_PIXELS).contains(&width) || !(1..=MAX_SIDE_PIXELS).contains(&height) {
            return Err(CameraError::Size { width, height });
        }
        let named: [(&'static str, &[f64]); 4] = [
            ("matrix", intrinsics.as_slice()),
            ("distortions", &distortion),
            ("rotation", rotation_rad.as_slice()),
            ("translation", translation_m.as_slice()),
        ];
        for (key, values) in named {
            if let Some(&value) = values.iter().find(|value| !value.is_finite()) {
                return Err(CameraError::NotFinite { key, value });
            }
        }
        let k = &intrinsics;
        if k[(1, 0)] != 0.0 || k[(2, 0)] != 0.0 || k[(2, 1)] != 0.0 || k[(2, 2)] != 1.0 {
            return Err(CameraError::Matrix { found: format!("has last row or lower part {:?}", lower(k)) });
        }
        if k[(0, 0)] <= 0.0 || k[(1, 1)] <= 0.0 {
            return Err(CameraError::Matrix { found: format!("has fx = {}, fy = {}", k[(0, 0)], k[(1, 1)]) });
        }
        let length = rotation_rad.norm();
        if length > MAX_ROTATION_RAD {
            return Err(CameraError::Turns { length });
        }
        let rotation = matrix_from_rodrigues(&rotation_rad);
        let centre_world = Point3::from(-(rotation.transpose() * translation_m));
        Ok(Camera {
            name: name.into(),
            width,
            height,
            intrinsics,
            lens: Lens::new(distortion),
            rotation_rad,
            rotation,
            translation_m,
            centre_world,
        })
    }

    /// The same with a rotation matrix, as most other formats have it; it must be one within 1e-6.
    pub fn from_matrices(
        name: impl Into<String>,
        size: (u32, u32),
        intrinsics: Matrix3<f64>,
        distortion: [f64; 5],
        rotation: &Matrix3<f64>,
        translation_m: Vector3<f64>,
    ) -> Result<Camera, CameraError> {
        if let Some(&value) = rotation.iter().find(|value| !value.is_finite()) {
            return Err(CameraError::NotFinite { key: "rotation", value });
        }
        let defect = rotation_defect(rotation);
        if defect > 1e-6 {
            return Err(CameraError::Rotation { defect });
        }
        Camera::new(name, size, intrinsics, distortion, rodrigues_from_matrix(rotation), translation_m)
    }

    /// An error if the intrinsics cannot be those of this camera's image in pixels: they are normalised, in another unit, or
    /// of another size. For files, whose numbers are not proven yet.
    pub fn check_image(&self) -> Result<(), CameraError> {
        let (width, height) = (self.width, self.height);
        let (sides, k) = ([f64::from(width), f64::from(height)], &self.intrinsics);
        let wrong = |found, expected| Err(CameraError::OtherImage { found, width, height, expected });
        let focal = [k[(0, 0)], k[(1, 1)]];
        if (0..2).any(|axis| focal[axis] < MIN_FOCAL_SHARE * sides[axis]) {
            let found = format!("focal lengths of {:.4} and {:.4} pixels", focal[0], focal[1]);
            return wrong(found, "a tenth of the image's side or more");
        }
        let centre = [k[(0, 2)], k[(1, 2)]];
        if (0..2).any(|axis| !(0.0..sides[axis]).contains(&centre[axis])) {
            let found = format!("its principal point at {:.1}, {:.1}", centre[0], centre[1]);
            return wrong(found, "a point in the image");
        }
        Ok(())
    }

    /// The camera's name, unique within its rig.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The intrinsic matrix `[fx s cx; 0 fy cy; 0 0 1]`, pixels.
    pub fn intrinsics(&self) -> &Matrix3<f64> {
        &self.intrinsics
    }

    /// The lens.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// World-to-camera rotation as a Rodrigues vector, radians.
    pub fn rotation_rad(&self) -> &Vector3<f64> {
        &self.rotation_rad
    }

    /// World-to-camera rotation.
    pub fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// World-to-camera translation, metres.
    pub fn translation_m(&self) -> &Vector3<f64> {
        &self.translation_m
    }

    /// The centre of projection in the world, metres.
    pub fn centre_world(&self) -> Point3<f64> {
        self.centre_world
    }

    /// The same camera under another name.
    pub fn renamed(mut self, name: impl Into<String>) -> Camera {
        self.name = name.into();
        self
    }

    /// A world point in the camera frame, metres.
    #[inline]
    pub fn camera_from_world(&self, point_world: &Point3<f64>) -> Vector3<f64> {
        let (r, t, p) = (&self.rotation, &self.translation_m, point_world);
        Vector3::new(
            r[(0, 0)] * p.x + r[(0, 1)] * p.y + r[(0, 2)] * p.z + t.x,
            r[(1, 0)] * p.x + r[(1, 1)] * p.y + r[(1, 2)] * p.z + t.y,
            r[(2, 0)] * p.x + r[(2, 1)] * p.y + r[(2, 2)] * p.z + t.z,
        )
    }

    /// A direction of the world in the camera frame.
    #[inline]
    pub fn camera_direction(&self, direction_world: &Vector3<f64>) -> Vector3<f64> {
        let (r, d) = (&self.rotation, direction_world);
        Vector3::new(
            r[(0, 0)] * d.x + r[(0, 1)] * d.y + r[(0, 2)] * d.z,
            r[(1, 0)] * d.x + r[(1, 1)] * d.y + r[(1, 2)] * d.z,
            r[(2, 0)] * d.x + r[(2, 1)] * d.y + r[(2, 2)] * d.z,
        )
    }

    /// Image coordinates `(u, v)` of a point in the camera frame; `None` behind the camera or beyond
    /// the lens's first stationary radius. The result may lie off the image.
    #[inline]
    pub fn image_from_camera(&self, point_camera: &Vector3<f64>) -> Option<Point2<f64>> {
        if point_camera.z <= 0.0 {
            return None;
        }
        let inverse_depth = 1.0 / point_camera.z;
        let (x, y) = (point_camera.x * inverse_depth, point_camera.y * inverse_depth);
        if !self.lens.is_straight() && x * x + y * y >= self.lens.max_radius_squared() {
            return None;
        }
        let (xd, yd) = self.lens.distort(x, y);
        let k = &self.intrinsics;
        Some(Point2::new(k[(0, 0)] * xd + k[(0, 1)] * yd + k[(0, 2)], k[(1, 1)] * yd + k[(1, 2)]))
    }

    /// Image coordinates of a world point; see [`Self::image_from_camera`].
    #[inline]
    pub fn project(&self, point_world: &Point3<f64>) -> Option<Point2<f64>> {
        self.image_from_camera(&self.camera_from_world(point_world))
    }

    /// The pixel that a world point falls on, if it is on the image.
    #[inline(always)]
    pub fn pixel(&self, point_world: &Point3<f64>) -> Option<Pixel> {
        let image = self.project(point_world)?;
        let pixel = Pixel::holding(image.x, image.y);
        self.holds(pixel).then_some(pixel)
    }

    /// True if the pixel is on the image.
    #[inline]
    pub fn holds(&self, pixel: Pixel) -> bool {
        (pixel.column as u32) < self.width && (pixel.row as u32) < self.height
    }

    /// Undistorted normalised coordinates `(x / z, y / z)` of image coordinates; `None` where the lens
    /// sees nothing.
    #[inline(always)]
    pub fn normalised(&self, image: &Point2<f64>) -> Option<Vector2<f64>> {
        let k = &self.intrinsics;
        let yd = (image.y - k[(1, 2)]) / k[(1, 1)];
        let xd = (image.x - k[(0, 2)] - k[(0, 1)] * yd) / k[(0, 0)];
        self.lens.undistort(xd, yd).map(|(x, y)| Vector2::new(x, y))
    }

    /// The unit direction, in the camera frame, of the viewing ray through image coordinates.
    pub fn ray_camera(&self, image: &Point2<f64>) -> Option<Vector3<f64>> {
        self.normalised(image).map(|n| Vector3::new(n.x, n.y, 1.0).normalize())
    }

    /// The unit direction, in the world, of the viewing ray through image coordinates.
    pub fn ray_world(&self, image: &Point2<f64>) -> Option<Vector3<f64>> {
        self.ray_camera(image).map(|ray| self.rotation.tr_mul(&ray))
    }

    /// `∂(u, v) / ∂x_camera` at the point `(x, y, 1)` of the camera frame, per metre at depth 1.
    pub fn image_jacobian(&self, normalised: &Vector2<f64>) -> Matrix2x3<f64> {
        let k = &self.intrinsics;
        let bend = self.lens.jacobian(normalised.x, normalised.y);
        let pinhole = Matrix2x3::new(1.0, 0.0, -normalised.x, 0.0, 1.0, -normalised.y);
        let affine = nalgebra::Matrix2::new(k[(0, 0)], k[(0, 1)], 0.0, k[(1, 1)]);
        affine * bend * pinhole
    }

    /// The image of a place in normalised coordinates within the lens, and how it moves with the place.
    #[inline(always)]
    pub(crate) fn image_along(
        &self,
        normalised: &Vector2<f64>,
        motion: &Vector2<f64>,
    ) -> (Vector2<f64>, Vector2<f64>) {
        let k = &self.intrinsics;
        let (x, y) = self.lens.distort(normalised.x, normalised.y);
        let bent = self.lens.jacobian(normalised.x, normalised.y) * motion;
        (
            Vector2::new(k[(0, 0)] * x + k[(0, 1)] * y + k[(0, 2)], k[(1, 1)] * y + k[(1, 2)]),
            Vector2::new(k[(0, 0)] * bent.x + k[(0, 1)] * bent.y, k[(1, 1)] * bent.y),
        )
    }

    /// The visual hull's unit normal, in the world, where the silhouette's edge at `normalised` has the
    /// 2D normal `m` (pixels): `Rᵀ Jᵀ m` (paper §4.2, the 2D normal back-projected). It is perpendicular
    /// to the viewing ray. `None` if `m` vanishes.
    #[inline]
    pub fn hull_normal_world(&self, normalised: &Vector2<f64>, m: &Vector2<f64>) -> Option<Vector3<f64>> {
        let normal = self.rotation.tr_mul(&self.image_jacobian(normalised).tr_mul(m));
        let length = normal.norm();
        (length > 0.0).then(|| normal / length)
    }

    /// A digest of all numbers that change an answer (not the name): size, intrinsics, lens, pose.
    pub fn digest(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"hulltouch camera 1");
        hasher.update(&self.width.to_le_bytes());
        hasher.update(&self.height.to_le_bytes());
        let numbers = self
            .intrinsics
            .iter()
            .chain(self.lens.coefficients().iter())
            .copied()
            .chain(self.rotation_rad.iter().copied())
            .chain(self.translation_m.iter().copied())
            .collect::<Vec<f64>>();
        for number in numbers {
            // −0 and 0 calibrate the same camera.
            hasher.update(&(number + 0.0).to_bits().to_le_bytes());
        }
        *hasher.finalize().as_bytes()
    }
}

fn lower(k: &Matrix3<f64>) -> [f64; 4] {
    [k[(1, 0)], k[(2, 0)], k[(2, 1)], k[(2, 2)]]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A 640 x 480 camera at (0, 0, −3) that looks along +z of a world whose y points down.
    pub(crate) fn plain_camera(distortion: [f64; 5]) -> Camera {
        let k = Matrix3::new(500.0, 0.5, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0);
        Camera::new("plain", (640, 480), k, distortion, Vector3::zeros(), Vector3::new(0.0, 0.0, 3.0))
            .expect("valid")
    }

    #[test]
    fn a_point_worked_by_hand_lands_where_the_sum_says() {
        let camera = plain_camera([0.0; 5]);
        // Camera frame (0.3, 0.6, 4): x/z = 0.075, y/z = 0.15.
        let image = camera.project(&Point3::new(0.3, 0.6, 1.0)).expect("in front");
        assert!((image.x - (500.0 * 0.075 + 0.5 * 0.15 + 320.0)).abs() < 1e-12);
        assert!((image.y - (510.0 * 0.15 + 240.0)).abs() < 1e-12);
        assert_eq!(camera.pixel(&Point3::new(0.3, 0.6, 1.0)), Some(Pixel { column: 358, row: 317 }));
        assert_eq!(camera.centre_world(), Point3::new(0.0, 0.0, -3.0));
    }

    #[test]
    fn nothing_behind_the_camera_or_beyond_the_fold_projects() {
        let camera = plain_camera([-0.3, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(camera.project(&Point3::new(0.0, 0.0, -4.0)), None);
        assert_eq!(camera.project(&Point3::new(40.0, 0.0, 1.0)), None);
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let k = Matrix3::new(500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0);
        let zero = Vector3::zeros();
        let new =
            |size, k, d: [f64; 5], t| Camera::new("c", size, k, d, zero, t).map(|_| ()).expect_err("refused");
        assert!(matches!(new((0, 480), k, [0.0; 5], zero), CameraError::Size { .. }));
        let nan = Vector3::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(
            new((640, 480), k, [0.0; 5], nan),
            CameraError::NotFinite { key: "translation", .. }
        ));
        assert!(matches!(new((640, 480), -k, [0.0; 5], zero), CameraError::Matrix { .. }));
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let error = Camera::from_matrices("c", (640, 480), k, [0.0; 5], &mirror, zero).expect_err("refused");
        assert!(matches!(error, CameraError::Rotation { .. }));
    }

    proptest! {
        #[test]
        fn a_ray_through_a_pixel_projects_back_onto_it(
            u in 1.0..638.0f64, v in 1.0..478.0f64, depth in 0.3..9.0f64, bent in any::<bool>(),
        ) {
            let camera = plain_camera(if bent { [-0.25, 0.1, 0.001, -0.002, 0.01] } else { [0.0; 5] });
            let ray = camera.ray_world(&Point2::new(u, v)).expect("this lens sees all pixels");
            let back = camera.project(&(camera.centre_world() + ray * depth)).expect("in front");
            prop_assert!((back - Point2::new(u, v)).amax() < 1e-8);
        }

        #[test]
        fn the_hull_normal_is_perpendicular_to_the_ray_and_points_along_m(
            u in 1.0..638.0f64, v in 1.0..478.0f64, angle in 0.0..6.2f64,
        ) {
            let camera = plain_camera([-0.25, 0.1, 0.001, -0.002, 0.01]);
            let image = Point2::new(u, v);
            let m = Vector2::new(libm::cos(angle), libm::sin(angle));
            let normalised = camera.normalised(&image).expect("seen");
            let normal = camera.hull_normal_world(&normalised, &m).expect("m is not zero");
            let ray = camera.ray_world(&image).expect("seen");
            prop_assert!(normal.dot(&ray).abs() < 1e-12);
            let point = camera.centre_world() + ray * 2.0;
            let moved = camera.project(&(point + normal * 1e-5)).expect("in front") - image;
            prop_assert!(moved.normalize().dot(&m) > 0.5, "{moved} against {m}");
        }
    }
}
