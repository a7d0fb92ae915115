//! The pieces everything in the foreground is made of: round cones, squashed where a limb is flat, and
//! cuboids.

use nalgebra::{Matrix3, Vector3};

use crate::maths::across;

/// What a solid is made of; see [`crate::material`] for the looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Material {
    Skin,
    Face,
    Hair,
    Shirt,
    Sleeve,
    Yoke,
    Belted,
    Trousers,
    Shoe,
    Cardboard,
    Wood,
}

/// The form of a solid in its own frame, before squashing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Form {
    /// The convex hull of a ball of `start_m` radius at the origin and one of `end_m` at `length_m` up +Y.
    RoundCone { length_m: f64, start_m: f64, end_m: f64 },
    /// A box about the origin.
    Cuboid { half_m: Vector3<f64> },
}

/// One solid in the world: `world = frame · diag(squash) · local + origin`.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    pub form: Form,
    pub origin: Vector3<f64>,
    pub frame: Matrix3<f64>,
    /// Scale along the local axes; 1 along +Y.
    pub squash: Vector3<f64>,
    pub material: Material,
    pub casts_shadow: bool,
}

impl Solid {
    /// A round cone from `start` to `end`, as thick as `radii_m` along the part of `side` across it and
    /// `flat` times that along the third axis.
    pub fn limb(
        (start, end): (Vector3<f64>, Vector3<f64>),
        radii_m: (f64, f64),
        (side, flat): (Vector3<f64>, f64),
        material: Material,
    ) -> Solid {
        let offset = end - start;
        let length_m = offset.norm();
        let up = if length_m > 1e-9 { offset / length_m } else { Vector3::y() };
        let left = across(&up, &side);
        // A ball inside the other would make no cone.
        let end_m = radii_m.1.max(radii_m.0 - 0.95 * length_m).min(radii_m.0 + 0.95 * length_m);
        let form = Form::RoundCone { length_m, start_m: radii_m.0, end_m };
        let frame = Matrix3::from_columns(&[left, up, left.cross(&up)]);
        let squash = Vector3::new(1.0, 1.0, flat);
        Solid { form, origin: start, frame, squash, material, casts_shadow: true }
    }

    /// An ellipsoid with half axes `half_m` along the columns of `frame`.
    pub fn ellipsoid(
        centre: Vector3<f64>,
        frame: Matrix3<f64>,
        half_m: Vector3<f64>,
        material: Material,
    ) -> Solid {
        let form = Form::RoundCone { length_m: 0.0, start_m: half_m.y, end_m: half_m.y };
        let squash = Vector3::new(half_m.x / half_m.y, 1.0, half_m.z / half_m.y);
        Solid { form, origin: centre, frame, squash, material, casts_shadow: true }
    }

    /// A box with the half sides `half_m` along the columns of `frame`.
    pub fn cuboid(
        centre: Vector3<f64>,
        frame: Matrix3<f64>,
        half_m: Vector3<f64>,
        material: Material,
    ) -> Solid {
        let (form, squash) = (Form::Cuboid { half_m }, Vector3::repeat(1.0));
        Solid { form, origin: centre, frame, squash, material, casts_shadow: true }
    }

    /// The same without a shadow, for what is small.
    pub fn without_shadow(self) -> Solid {
        Solid { casts_shadow: false, ..self }
    }

    /// The corners of a box around its middle.
    pub fn corners(half_m: &Vector3<f64>) -> [Vector3<f64>; 8] {
        std::array::from_fn(|corner| {
            half_m.map_with_location(|axis, _, half| if corner >> axis & 1 == 0 { -half } else { half })
        })
    }

    /// Local coordinates of a direction of the world.
    pub fn local_direction(&self, direction_world: &Vector3<f64>) -> Vector3<f64> {
        self.frame.tr_mul(direction_world).component_div(&self.squash)
    }

    /// A point of the solid's frame in the world.
    pub fn world(&self, local: &Vector3<f64>) -> Vector3<f64> {
        self.frame * local.component_mul(&self.squash) + self.origin
    }

    /// Signed distance, metres, negative inside: of the right sign, and never farther from zero than the
    /// true distance (equal to it for boxes and limbs that are not squashed).
    pub fn signed_distance_m(&self, point_world: &Vector3<f64>) -> f64 {
        let local = self.local_direction(&(point_world - self.origin));
        match self.form {
            Form::Cuboid { half_m } => {
                let q = local.abs() - half_m;
                q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
            }
            Form::RoundCone { length_m, start_m, end_m } => {
                let across_m = (local.x * local.x + local.z * local.z).sqrt();
                let (slope, rest) = taper(length_m, start_m, end_m);
                let along_m = rest * local.y - slope * across_m;
                let distance = if along_m <= 0.0 {
                    local.norm() - start_m
                } else if along_m >= rest * length_m {
                    let y = local.y - length_m;
                    (across_m * across_m + y * y).sqrt() - end_m
                } else {
                    rest * across_m + slope * local.y - start_m
                };
                distance * self.squash.min()
            }
        }
    }

    /// The least and the greatest corner of the box around the solid, world, metres.
    pub fn bounds_world(&self) -> (Vector3<f64>, Vector3<f64>) {
        let scaled = self.frame * Matrix3::from_diagonal(&self.squash);
        match self.form {
            Form::Cuboid { half_m } => {
                let reach = scaled.abs() * half_m;
                (self.origin - reach, self.origin + reach)
            }
            Form::RoundCone { length_m, start_m, end_m } => {
                let reach = Vector3::from_fn(|axis, _| scaled.row(axis).norm());
                let end = self.world(&Vector3::new(0.0, length_m, 0.0));
                (
                    (self.origin - reach * start_m).inf(&(end - reach * end_m)),
                    (self.origin + reach * start_m).sup(&(end + reach * end_m)),
                )
            }
        }
    }
}

/// Sine and cosine of the angle between a round cone's axis and its side.
pub(crate) fn taper(length_m: f64, start_m: f64, end_m: f64) -> (f64, f64) {
    if length_m < 1e-9 {
        return (0.0, 1.0);
    }
    let slope = (start_m - end_m) / length_m;
    (slope, (1.0 - slope * slope).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limb_is_as_thick_as_said_and_flat_where_said() {
        let limb = Solid::limb(
            (Vector3::zeros(), Vector3::new(0.0, 1.0, 0.0)),
            (0.2, 0.2),
            (Vector3::x(), 0.5),
            Material::Skin,
        );
        let sign = |x: f64, y: f64, z: f64| limb.signed_distance_m(&Vector3::new(x, y, z)) < 0.0;
        assert!(sign(0.199, 0.5, 0.0) && !sign(0.201, 0.5, 0.0));
        assert!(sign(0.0, 0.5, 0.099) && !sign(0.0, 0.5, 0.101));
        assert!(sign(0.0, 1.199, 0.0) && !sign(0.0, 1.201, 0.0));
        assert!(sign(0.0, -0.199, 0.0) && !sign(0.0, -0.201, 0.0));
    }

    #[test]
    fn bounds_touch_the_solid() {
        let limb = Solid::limb(
            (Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.5, 0.1, -0.2)),
            (0.1, 0.05),
            (Vector3::y(), 0.6),
            Material::Skin,
        );
        let (low, high) = limb.bounds_world();
        for axis in 0..3 {
            // A plane at the bound misses the solid, one a millimetre further in does not.
            for (bound, inward) in [(low[axis], 0.001), (high[axis], -0.001)] {
                let least = |at: f64| {
                    let mut least = f64::INFINITY;
                    for i in 0..100 {
                        for j in 0..100 {
                            let share = |k: i32| f64::from(k) / 99.0;
                            let mut point = Vector3::new(share(i), share(j), share(j));
                            point[(axis + 1) % 3] = share(i);
                            point[(axis + 2) % 3] = share(j);
                            point = low + (high - low).component_mul(&point);
                            point[axis] = at;
                            least = least.min(limb.signed_distance_m(&point));
                        }
                    }
                    least
                };
                assert!(least(bound - inward) > 0.0);
                assert!(least(bound + 2.0 * inward) < 0.0);
            }
        }
    }
}
