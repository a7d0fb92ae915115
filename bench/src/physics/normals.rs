//! How far the normals of the hull's surface are off: on a person against those of far finer images, on a table
//! against the planes that its edges and the cameras' centres make.

use std::sync::Arc;

use hull::question::{Answer, Batch, Edge, Points, Question, QuestionKind};
use hull::view_set::Scratch;
use hull::{Camera, Observer, ProbeSettings, View, ViewSet};
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use setup::cli::{Failure, Outcome};
use stage::{ConvexForm, Motion, Prop, StageSettings, studio_rig, true_silhouette};

use super::film::FINEST;
use super::metric::{Limit, metric};
use super::rows::{Row, RowKind};
use crate::crews::each;
use crate::random::Random;

/// Its name among the scenes.
pub const NORMALS: &str = "normals";

/// When the person is looked at, seconds: an arm is up.
const TIME_S: f64 = 4.5;
/// Points that are compared, and how near the surface they are, metres.
const POINTS: usize = 20_000;
const NEAR_M: f32 = 0.01;
/// Points thrown at once, and how often.
const THROW: usize = 1 << 16;
const MAX_THROWS: usize = 200;
/// An edge pixel is no farther from the image of the edge that made it, pixels.
const SAME_EDGE_PIXELS: f64 = 3.0;

/// Measures normals at each size.
pub fn measure(sizes: &[(u32, u32)], cameras: usize, keep: &mut dyn FnMut(Vec<Row>) -> Outcome) -> Outcome {
    let person = StageSettings { motion: Motion::Wave, ..StageSettings::default() };
    let table = StageSettings { person: false, props: vec![Prop::Table], ..StageSettings::default() };
    let [person, table] = [person, table].map(|stage| Surface::of(stage, cameras));
    let (person, table) = (person?, table?);
    for &size in sizes {
        let most_deg = match size.0 {
            3840.. => Some(Limit::Most(1.5)),
            1280.. => Some(Limit::Most(3.0)),
            _ => None,
        };
        let kind =
            RowKind { scene: NORMALS.into(), response: "-".into(), size: Some(size), noise: 0.0, seeds: 1 };
        let on_person = person.off_deg(size, cameras, |_, place, _| {
            person.finest[place].map(|edge| Vector3::from(edge.normal_world.map(f64::from)))
        })?;
        let edges = edges_world(&table.stage);
        let on_table = table.off_deg(size, cameras, |camera, _, edge| exact_normal(camera, edge, &edges))?;
        let names = [
            [
                "person, disc, p50, deg",
                "person, disc, p95, deg",
                "person, square, p50, deg",
                "person, square, p95, deg",
            ],
            [
                "table, disc, p50, deg",
                "table, disc, p95, deg",
                "table, square, p50, deg",
                "table, square, p95, deg",
            ],
        ];
        for ([p50, p95, square_p50, square_p95], [disc, square]) in
            names.into_iter().zip([on_person, on_table])
        {
            keep(vec![
                kind.row(metric(p50, quantile(&disc, 0.5), most_deg)),
                kind.row(metric(p95, quantile(&disc, 0.95), None)),
                kind.row(metric(square_p50, quantile(&square, 0.5), None)),
                kind.row(metric(square_p95, quantile(&square, 0.95), None)),
            ])?;
        }
    }
    Ok(())
}

/// Points near the surface of a studio's hull, and the planes there as the finest images have them.
struct Surface {
    stage: StageSettings,
    points: Arc<[[f64; 3]]>,
    finest: Vec<Option<Edge>>,
}

impl Surface {
    fn of(stage: StageSettings, cameras: usize) -> Outcome<Surface> {
        let views = views(&stage, cameras, FINEST)?;
        let (low, high) = stage.bounds_world(TIME_S).ok_or_else(|| Failure::run("the stage is empty"))?;
        let mut random = Random::new(4);
        let (mut points, mut finest) = (Vec::new(), Vec::new());
        for _ in 0..MAX_THROWS {
            let mut thrown = || -> [f64; 3] {
                std::array::from_fn(|axis| low[axis] + (high[axis] - low[axis]) * random.share())
            };
            let thrown: Arc<[[f64; 3]]> = (0..THROW).map(|_| thrown()).collect();
            let classes = answer(&views, QuestionKind::Classes, &thrown).standings;
            let inside = thrown.iter().zip(classes).filter(|(_, class)| class.inside_count().is_some());
            let inside: Arc<[[f64; 3]]> = inside.map(|(&point, _)| point).collect();
            let planes = answer(&views, QuestionKind::Planes, &inside).edges;
            for (&point, plane) in inside.iter().zip(planes) {
                if plane.is_some_and(|plane| plane.distance_m < NEAR_M) {
                    points.push(point);
                    finest.push(plane);
                }
            }
            if points.len() >= POINTS {
                points.truncate(POINTS);
                return Ok(Surface { stage, points: points.into(), finest });
            }
        }
        Err(Failure::run(format_args!(
            "found {} points near the hull's surface, expected {POINTS}",
            points.len()
        )))
    }

    /// How far the normals at a size are off, by disc and by square, degrees, ascending. `exact` is given the camera
    /// whose edge is found, the point's place and the edge.
    fn off_deg(
        &self,
        size: (u32, u32),
        cameras: usize,
        exact: impl Fn(&Camera, usize, &Edge) -> Option<Vector3<f64>>,
    ) -> Outcome<[Vec<f64>; 2]> {
        let views = views(&self.stage, cameras, size)?;
        let both =
            [QuestionKind::Planes, QuestionKind::Edges].map(|kind| answer(&views, kind, &self.points).edges);
        let camera = |edge: &Edge| views.views()[usize::from(edge.camera)].camera();
        let [disc, square] = &both;
        let off = |found: &[Option<Edge>]| {
            let known = (0..found.len()).filter_map(|place| {
                // The same points for both.
                let ((Some(_), Some(_)), edge) = ((disc[place], square[place]), found[place]?) else {
                    return None;
                };
                let exact = exact(camera(&edge), place, &edge)?;
                Some(Vector3::from(edge.normal_world.map(f64::from)).angle(&exact).to_degrees())
            });
            let mut known: Vec<f64> = known.collect();
            known.sort_by(f64::total_cmp);
            known
        };
        Ok([off(disc), off(square)])
    }
}

fn quantile(ascending: &[f64], share: f64) -> f64 {
    let at = ascending.len().saturating_sub(1) as f64 * share;
    ascending.get(at.round() as usize).copied().unwrap_or(f64::NAN)
}

fn views(stage: &StageSettings, cameras: usize, size: (u32, u32)) -> Outcome<ViewSet> {
    let rig = studio_rig(cameras, size).map_err(|error| Failure::input(format_args!("--size: {error}")))?;
    let look = |index: usize| {
        let camera = &rig.cameras()[index];
        let silhouette = true_silhouette(stage, camera, TIME_S).map_err(Failure::run)?;
        let observer = Observer::new(camera.clone(), index as u16, ProbeSettings::default(), None);
        Ok(Some(View::new(Arc::new(observer), &silhouette)))
    };
    Ok(ViewSet::new(each(cameras, look)?.into_iter().flatten().collect()))
}

fn answer(views: &ViewSet, kind: QuestionKind, points: &Arc<[[f64; 3]]>) -> Answer {
    let batches = vec![Batch::all(Points::World(Arc::clone(points)))];
    let question = Question { kind, batches, ..Question::default() };
    let mut answer = Answer::default();
    views.answer(&question, &mut Scratch::default(), &mut answer);
    answer
}

/// An edge of a box: its ends, the normals of its two faces, and the middle of the box, world, metres.
struct BoxEdge {
    ends: [Point3<f64>; 2],
    faces: [Vector3<f64>; 2],
    middle: Point3<f64>,
}

/// The edges of all boxes of a studio.
fn edges_world(stage: &StageSettings) -> Vec<BoxEdge> {
    let mut edges = Vec::new();
    for solid in stage.convex_solids(TIME_S) {
        let ConvexForm::Cuboid { size_m } = solid.form else { continue };
        edges.extend(box_edges(&solid.world, 0.5 * Vector3::from(size_m)));
    }
    edges
}

fn box_edges(world: &Isometry3<f64>, half_m: Vector3<f64>) -> Vec<BoxEdge> {
    let mut edges = Vec::with_capacity(12);
    for axis in 0..3 {
        for (first, second) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (mut one, mut other) = (Vector3::zeros(), Vector3::zeros());
            (one[(axis + 1) % 3], other[(axis + 2) % 3]) = (first, second);
            let mut along = Vector3::zeros();
            along[axis] = 1.0;
            let end = |sign: f64| world * Point3::from((one + other + along * sign).component_mul(&half_m));
            edges.push(BoxEdge {
                ends: [end(-1.0), end(1.0)],
                faces: [world * one, world * other],
                middle: world * Point3::origin(),
            });
        }
    }
    edges
}

/// The outward normal of the plane through a camera's centre and the edge of a box whose image is at an edge pixel.
fn exact_normal(camera: &Camera, found: &Edge, edges: &[BoxEdge]) -> Option<Vector3<f64>> {
    let (centre, pixel) = (camera.centre_world(), found.pixel.centre());
    let outline = edges.iter().filter(|edge| {
        let [one, other] = edge.faces.map(|face| face.dot(&(centre - edge.ends[0])) > 0.0);
        one != other
    });
    let distances = outline.filter_map(|edge| {
        let [a, b] = edge.ends.map(|end| camera.project(&end));
        Some((from_segment(&pixel, &a?, &b?), edge))
    });
    let (distance, edge) = distances.min_by(|a, b| a.0.total_cmp(&b.0))?;
    if distance > SAME_EDGE_PIXELS {
        return None;
    }
    let normal = (edge.ends[0] - centre).cross(&(edge.ends[1] - centre)).normalize();
    Some(if normal.dot(&(edge.middle - centre)) > 0.0 { -normal } else { normal })
}

fn from_segment(point: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let way = b - a;
    let share = ((point - a).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    (point - (a + way * share)).norm()
}

#[cfg(test)]
mod tests {
    use hull::camera::Pixel;

    use super::*;

    #[test]
    fn a_box_has_twelve_edges_each_between_two_faces() {
        let edges = box_edges(&Isometry3::translation(0.0, 1.0, 0.0), Vector3::new(0.3, 0.2, 0.1));
        assert_eq!(edges.len(), 12);
        for edge in &edges {
            assert!(edge.faces[0].dot(&edge.faces[1]).abs() < 1e-12);
            for (end, face) in edge.ends.iter().flat_map(|end| edge.faces.iter().map(move |face| (end, face)))
            {
                let half_m = face.abs().dot(&Vector3::new(0.3, 0.2, 0.1));
                assert!((face.dot(&(end - edge.middle)) - half_m).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_normal_at_an_outline_is_of_the_plane_through_it() {
        // High enough to see the top.
        let camera = studio_rig(8, (1280, 720)).expect("a rig").cameras()[3].clone();
        let edges = box_edges(&Isometry3::translation(0.0, 1.0, 0.0), Vector3::repeat(0.2));
        let mut found = 0;
        for edge in &edges {
            let at = nalgebra::center(&edge.ends[0], &edge.ends[1]);
            let image = camera.project(&at).expect("seen");
            let pixel = Pixel::holding(image.x, image.y);
            let edge = Edge { distance_m: 0.0, camera: 0, pixel, normal_world: [0.0; 3], moved_m: None };
            if let Some(normal) = exact_normal(&camera, &edge, &edges) {
                assert!(
                    normal.dot(&(at - camera.centre_world())).abs() < 1e-9
                        && normal.dot(&(at - Point3::new(0.0, 1.0, 0.0))) > 0.0
                );
                found += 1;
            }
        }
        assert_eq!(found, 6, "a box has an outline of six edges");
    }
}
