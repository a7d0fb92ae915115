//! A piece of the hull's surface as rapier sees it: a plane that touches one body at a few of its samples.
//!
//! Rapier accepts a contact manifold that other code computes: the collider of a piece is a shape of our own, and
//! [`Dispatcher`] writes the manifold between it and its body from the samples and the plane. Everything else goes to
//! rapier's own dispatcher.

use std::sync::Arc;

use rapier3d::geometry::{ContactData, ContactManifold, ContactManifoldData};
use rapier3d::math::{Pose, Real};
use rapier3d::parry::bounding_volume::{Aabb, BoundingSphere};
use rapier3d::parry::mass_properties::MassProperties;
use rapier3d::parry::query::details::{NormalConstraints, ShapeCastOptions};
use rapier3d::parry::query::{
    ClosestPoints, Contact, ContactManifoldsWorkspace, DefaultQueryDispatcher, NonlinearRigidMotion,
    PersistentQueryDispatcher, PointProjection, PointQuery, QueryDispatcher, Ray, RayCast, RayIntersection,
    ShapeCastHit, ShapeDistance, ShapeIntersection, TrackedContact, Unsupported,
};
use rapier3d::parry::shape::{FeatureId, PackedFeatureId, Shape, ShapeType, TypedShape};
use rapier3d::prelude::{ColliderHandle, PairFilterContext, PhysicsHooks, SharedShape, SolverFlags, Vector};

/// A sample that touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::solver) struct PatchPoint {
    /// Its index in its body.
    pub sample: u32,
    /// Body frame, metres.
    pub point_body: Vector,
    /// The surface's point nearest to it, frame of the patch, metres.
    pub surface: Vector,
}

/// A plane and the samples that touch it, at most four; its frame is turned as the world's.
#[derive(Clone, Debug)]
pub(super) struct PatchShape {
    pub normal: Vector,
    pub points: Vec<PatchPoint>,
    /// The body is never farther than this from the patch's origin while it touches, metres.
    pub reach_m: f32,
}

impl PatchShape {
    pub fn shared(self) -> SharedShape {
        SharedShape(Arc::new(self))
    }

    /// Writes the contacts of the body; `body_in_patch` is its pose. The patch is the first of the pair, or the second.
    fn write(&self, body_in_patch: Pose, is_first: bool, prediction_m: Real, manifold: &mut Manifold) {
        let normal_body = body_in_patch.rotation.inverse() * self.normal;
        (manifold.local_n1, manifold.local_n2) =
            if is_first { (self.normal, -normal_body) } else { (-normal_body, self.normal) };
        let before = std::mem::take(&mut manifold.points);
        for point in &self.points {
            let at = body_in_patch * point.point_body;
            let dist = (at - point.surface).dot(self.normal);
            if dist > prediction_m {
                continue;
            }
            // The surface's point below the sample goes with it along the plane.
            let on_surface = at - self.normal * dist;
            let feature = PackedFeatureId::vertex(point.sample);
            let (first, second) =
                if is_first { (on_surface, point.point_body) } else { (point.point_body, on_surface) };
            manifold.points.push(TrackedContact::new(first, second, feature, feature, dist));
        }
        manifold.match_contacts(&before);
    }
}

impl RayCast for PatchShape {
    fn cast_local_ray_and_get_normal(&self, _: &Ray, _: Real, _: bool) -> Option<RayIntersection> {
        None
    }
}

impl PointQuery for PatchShape {
    fn project_local_point(&self, point: Vector, _: bool) -> PointProjection {
        PointProjection::new(false, point)
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        (PointProjection::new(false, point), FeatureId::Unknown)
    }
}

impl Shape for PatchShape {
    fn compute_local_aabb(&self) -> Aabb {
        Aabb::new(Vector::splat(-self.reach_m), Vector::splat(self.reach_m))
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        BoundingSphere::new(Vector::ZERO, self.reach_m * 3.0_f32.sqrt())
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, _: Vector, _: u32) -> Option<Box<dyn Shape>> {
        None
    }

    fn mass_properties(&self, _: Real) -> MassProperties {
        MassProperties::new(Vector::ZERO, 0.0, Vector::ZERO)
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
    }

    fn ccd_thickness(&self) -> Real {
        0.0
    }

    fn ccd_angular_thickness(&self) -> Real {
        0.0
    }
}

type Manifold = ContactManifold;

/// Rapier's dispatcher, and the manifolds of patches.
pub(in crate::solver) struct Dispatcher;

impl PersistentQueryDispatcher<ContactManifoldData, ContactData> for Dispatcher {
    fn contact_manifolds(
        &self,
        second_in_first: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        prediction_m: Real,
        manifolds: &mut Vec<Manifold>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        let (patch, is_first) = match (first.as_shape::<PatchShape>(), second.as_shape::<PatchShape>()) {
            (Some(_), Some(_)) => return Ok(()),
            (Some(patch), None) => (patch, true),
            (None, Some(patch)) => (patch, false),
            (None, None) => {
                let rapiers = DefaultQueryDispatcher;
                return rapiers.contact_manifolds(
                    second_in_first,
                    first,
                    second,
                    prediction_m,
                    manifolds,
                    workspace,
                );
            }
        };
        if manifolds.is_empty() {
            manifolds.push(Manifold::new());
        }
        let body_in_patch = if is_first { *second_in_first } else { second_in_first.inverse() };
        patch.write(body_in_patch, is_first, prediction_m, &mut manifolds[0]);
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        second_in_first: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        first_normals: Option<&dyn NormalConstraints>,
        second_normals: Option<&dyn NormalConstraints>,
        prediction_m: Real,
        manifold: &mut Manifold,
    ) -> Result<(), Unsupported> {
        DefaultQueryDispatcher.contact_manifold_convex_convex(
            second_in_first,
            first,
            second,
            first_normals,
            second_normals,
            prediction_m,
            manifold,
        )
    }
}

impl QueryDispatcher for Dispatcher {
    fn intersection_test(
        &self,
        pose: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
    ) -> Result<ShapeIntersection, Unsupported> {
        DefaultQueryDispatcher.intersection_test(pose, first, second)
    }

    fn distance(
        &self,
        pose: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
    ) -> Result<ShapeDistance, Unsupported> {
        DefaultQueryDispatcher.distance(pose, first, second)
    }

    fn contact(
        &self,
        pose: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        prediction: Real,
    ) -> Result<Option<Contact>, Unsupported> {
        DefaultQueryDispatcher.contact(pose, first, second, prediction)
    }

    fn closest_points(
        &self,
        pose: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        most: Real,
    ) -> Result<ClosestPoints, Unsupported> {
        DefaultQueryDispatcher.closest_points(pose, first, second, most)
    }

    fn cast_shapes(
        &self,
        pose: &Pose,
        velocity: Vector,
        first: &dyn Shape,
        second: &dyn Shape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes(pose, velocity, first, second, options)
    }

    fn cast_shapes_nonlinear(
        &self,
        first_motion: &NonlinearRigidMotion,
        first: &dyn Shape,
        second_motion: &NonlinearRigidMotion,
        second: &dyn Shape,
        start: Real,
        end: Real,
        stop_at_penetration: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes_nonlinear(
            first_motion,
            first,
            second_motion,
            second,
            start,
            end,
            stop_at_penetration,
        )
    }
}

/// A patch meets its own body alone: both carry the body's mark.
pub(in crate::solver) struct OwnBody;

impl PhysicsHooks for OwnBody {
    fn filter_contact_pair(&self, context: &PairFilterContext) -> Option<SolverFlags> {
        let mark = |collider: ColliderHandle| context.colliders[collider].user_data;
        (mark(context.collider1) == mark(context.collider2)).then_some(SolverFlags::COMPUTE_RIGID_IMPULSES)
    }
}
