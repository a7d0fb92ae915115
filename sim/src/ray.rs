//! Where a ray enters a body: for those that draw it.

use hull::Pose;
use nalgebra::{Matrix3, Point3, Vector3};

use crate::solid::Solid;

/// Two faces of a polyhedron whose normals are closer than this are one face to the eye.
const SAME_FACE_COSINE: f64 = 0.99;

/// A ray of the world; the direction has unit length.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it begins, metres.
    pub start: Point3<f64>,
    /// Where it goes.
    pub direction: Vector3<f64>,
}

impl Ray {
    /// The point of the ray that is so many metres along it.
    pub fn at(&self, t_m: f64) -> Point3<f64> {
        self.start + self.direction * t_m
    }
}

/// A solid in the world, as rays see it.
pub struct SolidTracer {
    solid: Solid,
    centre_world: Point3<f64>,
    world_from_body: Matrix3<f64>,
    radius_m: f64,
    /// Outward unit normals and offsets of a polyhedron's faces, body frame.
    planes: Vec<(Vector3<f64>, f64)>,
}

/// Where a ray meets a solid.
#[derive(Clone, Copy, Debug)]
pub struct SolidHit {
    /// Metres along the ray.
    pub t_m: f64,
    /// Outward unit normal of the world.
    pub normal_world: Vector3<f64>,
    /// How near the next sharp edge is, metres; infinite where there is none.
    pub edge_m: f64,
}

/// A hit in the body frame.
type Local = (f64, Vector3<f64>, f64);

impl SolidTracer {
    /// The solid at a pose.
    pub fn new(solid: &Solid, pose: &Pose) -> SolidTracer {
        let planes = match solid {
            Solid::Box { size_m } => (0..6)
                .map(|side| {
                    let mut normal = Vector3::zeros();
                    normal[side / 2] = if side % 2 == 0 { 1.0 } else { -1.0 };
                    (normal, 0.5 * size_m[side / 2])
                })
                .collect(),
            Solid::Hull(hull) => hull
                .triangle_corners_m()
                .filter_map(|[a, b, c]| {
                    let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
                    Some((normal, normal.dot(&a)))
                })
                .collect(),
            _ => Vec::new(),
        };
        SolidTracer {
            solid: solid.clone(),
            centre_world: Point3::from(pose.position_m()),
            world_from_body: pose.rotation(),
            radius_m: solid.radius_m(),
            planes,
        }
    }

    /// Where the ray enters the solid, if it starts outside of it.
    pub fn hit(&self, ray: &Ray) -> Option<SolidHit> {
        let to_centre = self.centre_world - ray.start;
        let along = to_centre.dot(&ray.direction);
        if (to_centre - ray.direction * along).norm_squared() > self.radius_m * self.radius_m {
            return None;
        }
        let start = -self.world_from_body.tr_mul(&to_centre);
        let direction = self.world_from_body.tr_mul(&ray.direction);
        let (t_m, normal, edge_m) = self.hit_body(&start, &direction).filter(|hit| hit.0 > 1e-6)?;
        Some(SolidHit { t_m, normal_world: (self.world_from_body * normal).normalize(), edge_m })
    }

    fn hit_body(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Option<Local> {
        match &self.solid {
            Solid::Box { .. } | Solid::Hull(_) => self.hit_planes(o, d),
            Solid::Ball { radius_m } => ball(o, d, 0.0, *radius_m),
            Solid::Capsule { radius_m, length_m } => {
                let half = 0.5 * length_m;
                let side = wall(o, d, *radius_m, 0.0)
                    .filter(|hit| (o.y + d.y * hit.0).abs() <= half)
                    .map(|(t, normal)| (t, normal, f64::INFINITY));
                let ends = [half, -half].map(|y| ball(o, d, y, *radius_m));
                nearest([side, ends[0], ends[1]])
            }
            Solid::Cylinder { radius_m, height_m } => {
                let half = 0.5 * height_m;
                let side = wall(o, d, *radius_m, 0.0).and_then(|(t, normal)| {
                    let room = half - (o.y + d.y * t).abs();
                    (room >= 0.0).then_some((t, normal, room))
                });
                nearest([side, disc(o, d, half, *radius_m), disc(o, d, -half, *radius_m)])
            }
            Solid::Cone { radius_m, height_m } => {
                let half = 0.5 * height_m;
                let slope = radius_m / height_m;
                // In the tip's frame the wall's radius grows with the depth below it.
                let side = wall(&(o - Vector3::y() * half), d, 0.0, slope).and_then(|(t, normal)| {
                    let y = o.y + d.y * t;
                    (y.abs() <= half).then_some((t, normal, y + half))
                });
                nearest([side, disc(o, d, -half, *radius_m), None])
            }
        }
    }

    /// The ray enters a convex polyhedron at the last of the planes that it crosses inwards.
    fn hit_planes(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Option<Local> {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut face = Vector3::zeros();
        for (normal, offset) in &self.planes {
            let (room, slope) = (offset - normal.dot(o), normal.dot(d));
            if slope < 0.0 {
                if room / slope > enter {
                    (enter, face) = (room / slope, *normal);
                }
            } else if slope > 0.0 {
                leave = leave.min(room / slope);
            } else if room < 0.0 {
                return None;
            }
        }
        if !(enter <= leave && enter.is_finite()) {
            return None;
        }
        let point = o + d * enter;
        let others = self.planes.iter().filter(|(normal, _)| normal.dot(&face) < SAME_FACE_COSINE);
        let edge_m = others
            .map(|(normal, offset)| {
                // Along the face, not along the other face's normal.
                let cosine = normal.dot(&face);
                (offset - normal.dot(&point)) / (1.0 - cosine * cosine).max(1e-6).sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        Some((enter, face, edge_m))
    }
}

fn nearest(hits: [Option<Local>; 3]) -> Option<Local> {
    hits.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The lesser root of `a t² + 2 b t + c`.
fn lesser_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    (discriminant >= 0.0 && a > 0.0).then(|| (-b - discriminant.sqrt()) / a)
}

fn ball(o: &Vector3<f64>, d: &Vector3<f64>, y: f64, radius_m: f64) -> Option<Local> {
    let start = o - Vector3::y() * y;
    let t = lesser_root(1.0, start.dot(d), start.norm_squared() - radius_m * radius_m)?;
    Some((t, start + d * t, f64::INFINITY))
}

/// The wall around the y axis whose radius is `radius_m − slope · y`, where that is not below zero.
fn wall(o: &Vector3<f64>, d: &Vector3<f64>, radius_m: f64, slope: f64) -> Option<(f64, Vector3<f64>)> {
    let (r, growth) = (radius_m - slope * o.y, -slope * d.y);
    let a = d.x * d.x + d.z * d.z - growth * growth;
    let b = o.x * d.x + o.z * d.z - r * growth;
    let c = o.x * o.x + o.z * o.z - r * r;
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || a.abs() < 1e-15 {
        return None;
    }
    let root = discriminant.sqrt();
    let (first, second) = ((-b - root) / a, (-b + root) / a);
    [first.min(second), first.max(second)].into_iter().find_map(|t| {
        let p = o + d * t;
        let radius_m = radius_m - slope * p.y;
        let normal = Vector3::new(p.x, slope * radius_m, p.z);
        (radius_m >= 0.0 && normal.dot(d) < 0.0).then_some((t, normal))
    })
}

fn disc(o: &Vector3<f64>, d: &Vector3<f64>, y: f64, radius_m: f64) -> Option<Local> {
    if d.y * y >= 0.0 {
        return None;
    }
    let t = (y - o.y) / d.y;
    let (x, z) = (o.x + d.x * t, o.z + d.z * t);
    let room = radius_m - (x * x + z * z).sqrt();
    (room >= 0.0).then(|| (t, Vector3::y() * y, room))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::ConvexHull;
    use std::sync::Arc;

    /// Numbers in −1..1, ever the same.
    fn shares() -> impl FnMut() -> f64 {
        let mut state = 7u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    #[track_caller]
    fn check(solid: &Solid) {
        let pose = Pose::new([0.3, -0.2, 0.5], [0.36, 0.48, 0.64, 0.48]).expect("a pose");
        let tracer = SolidTracer::new(solid, &pose);
        let centre = Point3::from(pose.position_m());
        let mut share = shares();
        for _ in 0..2000 {
            let aim = centre + Vector3::new(share(), share(), share()) * 0.02;
            let Some(away) = Vector3::new(share(), share(), share()).try_normalize(0.1) else { continue };
            let ray = Ray { start: aim + away * 3.0, direction: -away };
            let hit = tracer.hit(&ray).expect("aimed at the middle");
            assert!(hit.normal_world.dot(&away) > 0.0 && hit.edge_m >= -1e-9, "{hit:?}");
            // A convex solid lies behind the plane through each point of its surface.
            let rotation = pose.rotation();
            let normal_body = rotation.tr_mul(&hit.normal_world);
            let point_body = rotation.tr_mul(&(ray.at(hit.t_m) - centre));
            let reach_m = solid.reach_m(normal_body);
            assert!((normal_body.dot(&point_body) - reach_m).abs() < 1e-6, "{solid:?} {hit:?}");
        }
        let past = Ray { start: centre + Vector3::new(3.0, 1.0, 0.0), direction: -Vector3::x() };
        assert!(tracer.hit(&past).is_none());
        let behind = Ray { start: centre + Vector3::new(3.0, 0.0, 0.0), direction: Vector3::x() };
        assert!(tracer.hit(&behind).is_none());
    }

    #[test]
    fn rays_meet_the_surface_of_every_solid() {
        check(&Solid::Box { size_m: [0.2, 0.3, 0.4] });
        check(&Solid::Ball { radius_m: 0.1 });
        check(&Solid::Capsule { radius_m: 0.1, length_m: 0.3 });
        check(&Solid::Cylinder { radius_m: 0.1, height_m: 0.3 });
        check(&Solid::Cone { radius_m: 0.15, height_m: 0.3 });
        let corners = [[0.2, -0.1, 0.0], [-0.1, -0.1, 0.15], [-0.1, -0.1, -0.15], [0.0, 0.3, 0.0]];
        check(&Solid::Hull(Arc::new(ConvexHull::new(&corners).expect("a tetrahedron"))));
    }
}
