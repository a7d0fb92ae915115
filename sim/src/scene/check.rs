//! From keys to a scene whose every value can be.

use super::file::{BodyFile, FloorFile, PlaceFile, SceneFile, ShapeFile};
use super::{Floor, Group, MAX_BODIES, MassSpec, Place, Scene, ValueError};
use crate::solid::{ConvexHull, MAX_EXTENT_M, MIN_EXTENT_M, Solid};
use core::fmt::Display;
use core::ops::RangeInclusive;
use hull::text::{MAX_QUOTED_CHARS, shortened};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Cardboard boxes with something in them, kg/m³.
const DEFAULT_DENSITY_KG_M3: f64 = 120.0;
/// Coulomb friction coefficients, of bodies, floor and hull alike.
pub const FRICTION: RangeInclusive<f64> = 0.0..=10.0;
/// Shares of the speed that a bounce returns.
pub const RESTITUTION: RangeInclusive<f64> = 0.0..=1.0;
const DEFAULT_FRICTION: f64 = 0.6;
const DEFAULT_RESTITUTION: f64 = 0.1;
/// No name in a file or a request is longer, bytes: a body's OSC messages fit into one datagram.
pub(crate) const MAX_NAME_BYTES: usize = 100;
/// Of several bodies of one name each has a number behind it: `_999`.
pub(crate) const MAX_NUMBERED_BYTES: usize = MAX_NAME_BYTES + 4;
/// No position, height or spacing is farther from the origin, metres: `f32` keeps a tenth of a
/// millimetre there.
pub(crate) const MAX_POSITION_M: f64 = 1000.0;
/// Components of the gravity are within ± this, m/s²: more than on any planet.
pub(crate) const MAX_GRAVITY_M_S2: f64 = 100.0;
/// At most so deep a sample may be missed, metres: deeper ones would be seen to collide.
const MAX_REUSE_M: f64 = 0.1;

/// Checks the file's values.
pub(super) fn scene(name: &str, text: &str, file: SceneFile) -> Result<Scene, ValueError> {
    let gravity_m_s2 = gravity(file.gravity.unwrap_or([0.0, -9.81, 0.0]))?;
    let floor = floor(&file.floor)?;
    within("hull.restitution", file.hull.restitution, RESTITUTION)?;
    within("hull.friction", file.hull.friction, FRICTION)?;
    within("hull.reuse_within_m", file.hull.reuse_within_m, 0.0..=MAX_REUSE_M)?;
    let groups = file.bodies.into_iter().map(group).collect::<Result<Vec<_>, _>>()?;
    names(&groups)?;
    let SceneFile { hull, stage, .. } = file;
    Ok(Scene { name: name.to_owned(), text: text.into(), gravity_m_s2, floor, hull, stage, groups })
}

/// Gravity in m/s².
pub(super) fn gravity(gravity_m_s2: [f64; 3]) -> Result<[f64; 3], ValueError> {
    all_within("gravity", &gravity_m_s2, -MAX_GRAVITY_M_S2..=MAX_GRAVITY_M_S2)?;
    Ok(gravity_m_s2)
}

fn floor(file: &FloorFile) -> Result<Option<Floor>, ValueError> {
    let floor = Floor {
        height_m: within("floor.height", file.height, -MAX_POSITION_M..=MAX_POSITION_M)?,
        friction: within("floor.friction", file.friction, FRICTION)?,
        restitution: within("floor.restitution", file.restitution, RESTITUTION)?,
    };
    Ok(file.enabled.then_some(floor))
}

fn group(file: BodyFile) -> Result<Group, ValueError> {
    let is_printable = !file.name.is_empty() && !file.name.chars().any(char::is_control);
    if !is_printable || file.name.len() > MAX_NAME_BYTES {
        let expected = format_args!("1 to {MAX_NAME_BYTES} bytes of printable characters");
        return Err(wrong("bodies.name", format_args!("{:?}", file.name), expected));
    }
    let key = |key: &str| key_of(&file.name, key);
    let count = file.count.unwrap_or(1);
    if !(1..=MAX_BODIES).contains(&count) {
        return Err(wrong(key("count"), count, format!("1 to {MAX_BODIES}")));
    }
    if let (PlaceFile::At(_), 2..) = (&file.place, count) {
        return Err(wrong(key("count"), count, "1 with place.at, or place.stack, .pile or .rain"));
    }
    all_within(&key("rotation_deg"), &file.rotation_deg.unwrap_or_default(), -360.0..=360.0)?;
    all_within(&key("color"), &file.color.unwrap_or_default(), 0.0..=1.0)?;
    Ok(Group {
        solid: solid(&file.name, file.shape)?,
        place: place(&file.name, &file.place)?,
        mass: mass(&file.name, file.mass, file.density)?,
        friction: friction(&file.name, file.friction)?,
        restitution: restitution(&file.name, file.restitution)?,
        count,
        rotation_deg: file.rotation_deg,
        fixed: file.fixed,
        color: file.color.map(|color| color.map(|c| c as f32)),
        name: file.name,
    })
}

pub(super) fn solid(body: &str, file: ShapeFile) -> Result<Solid, ValueError> {
    let extent = |key: &str, value: f64, least_m: f64| {
        within(&key_of(body, format_args!("shape.{key}")), value, least_m..=MAX_EXTENT_M)
    };
    // A radius is half an extent.
    let radius = |key: &str, value: f64| extent(key, value, 0.5 * MIN_EXTENT_M);
    Ok(match file {
        ShapeFile::Box { size } => {
            all_within(&key_of(body, "shape.box.size"), &size, MIN_EXTENT_M..=MAX_EXTENT_M)?;
            Solid::Box { size_m: size }
        }
        ShapeFile::Ball { radius: r } => Solid::Ball { radius_m: radius("ball.radius", r)? },
        ShapeFile::Capsule { radius: r, length } => Solid::Capsule {
            radius_m: radius("capsule.radius", r)?,
            length_m: extent("capsule.length", length, MIN_EXTENT_M)?,
        },
        ShapeFile::Cylinder { radius: r, height } => Solid::Cylinder {
            radius_m: radius("cylinder.radius", r)?,
            height_m: extent("cylinder.height", height, MIN_EXTENT_M)?,
        },
        ShapeFile::Cone { radius: r, height } => Solid::Cone {
            radius_m: radius("cone.radius", r)?,
            height_m: extent("cone.height", height, MIN_EXTENT_M)?,
        },
        ShapeFile::Hull { points } => {
            let key = || key_of(body, "shape.hull.points");
            let hull = ConvexHull::new(&points);
            Solid::Hull(Arc::new(hull.map_err(|problem| ValueError::Hull { key: key(), problem })?))
        }
    })
}

fn place(body: &str, file: &PlaceFile) -> Result<Place, ValueError> {
    let number = |key: &str, value: f64, low: f64| {
        within(&key_of(body, format_args!("place.{key}")), value, low..=MAX_POSITION_M)
    };
    let point = |key: &str, point_m: [f64; 3]| {
        point_m.iter().try_for_each(|&number_m| number(key, number_m, -MAX_POSITION_M).map(drop))?;
        Ok(point_m)
    };
    Ok(match *file {
        PlaceFile::At(origin) => Place::At { origin_m: point("at", origin)? },
        PlaceFile::Stack { foot, gap } => {
            Place::Stack { foot_m: point("stack.foot", foot)?, gap_m: number("stack.gap", gap, 0.0)? }
        }
        PlaceFile::Pile { foot, radius } => Place::Column {
            foot_m: point("pile.foot", foot)?,
            radius_m: number("pile.radius", radius, 0.0)?,
            spacing_m: 0.0,
        },
        PlaceFile::Rain { foot, radius, spacing } => Place::Column {
            foot_m: point("rain.foot", foot)?,
            radius_m: number("rain.radius", radius, 0.0)?,
            spacing_m: number("rain.spacing", spacing, 0.0)?,
        },
    })
}

pub(super) fn mass(body: &str, mass: Option<f64>, density: Option<f64>) -> Result<MassSpec, ValueError> {
    let key = |key: &str| key_of(body, key);
    match (mass, density) {
        (Some(mass), None) => Ok(MassSpec::MassKg(within(&key("mass"), mass, 1e-3..=1e4)?)),
        (None, density) => {
            let density = density.unwrap_or(DEFAULT_DENSITY_KG_M3);
            Ok(MassSpec::DensityKgM3(within(&key("density"), density, 1.0..=3e4)?))
        }
        (Some(_), Some(_)) => Err(wrong(key("mass"), "mass and density", "one of the two")),
    }
}

/// All bodies together: not too many, and no name twice.
fn names(groups: &[Group]) -> Result<(), ValueError> {
    let total: usize = groups.iter().map(|group| group.count).sum();
    if total > MAX_BODIES {
        return Err(wrong("bodies", format!("{total} bodies"), format!("at most {MAX_BODIES}")));
    }
    let mut seen = BTreeSet::new();
    for name in groups.iter().flat_map(Group::names) {
        if let Some(twice) = seen.replace(name) {
            return Err(wrong("bodies.name", format!("`{twice}` twice"), "every name once"));
        }
    }
    Ok(())
}

pub(super) fn friction(body: &str, given: Option<f64>) -> Result<f64, ValueError> {
    within(&key_of(body, "friction"), given.unwrap_or(DEFAULT_FRICTION), FRICTION)
}

pub(super) fn restitution(body: &str, given: Option<f64>) -> Result<f64, ValueError> {
    within(&key_of(body, "restitution"), given.unwrap_or(DEFAULT_RESTITUTION), RESTITUTION)
}

/// Checks every one of some numbers.
pub(crate) fn all_within(key: &str, found: &[f64], allowed: RangeInclusive<f64>) -> Result<(), ValueError> {
    found.iter().try_for_each(|&number| within(key, number, allowed.clone()).map(drop))
}

/// Checks one number.
pub(crate) fn within(key: &str, found: f64, allowed: RangeInclusive<f64>) -> Result<f64, ValueError> {
    if allowed.contains(&found) {
        Ok(found)
    } else {
        let (low, high) = allowed.into_inner();
        Err(wrong(key, found, format!("a number from {low} to {high}")))
    }
}

pub(crate) fn wrong(key: impl Display, found: impl Display, expected: impl Display) -> ValueError {
    ValueError::Value {
        key: key.to_string(),
        found: shortened(&found.to_string(), MAX_QUOTED_CHARS),
        expected: expected.to_string(),
    }
}

/// A key of a body; one without a name stands alone.
fn key_of(body: &str, key: impl Display) -> String {
    if body.is_empty() {
        key.to_string()
    } else {
        format!("body `{}`, {key}", shortened(body, MAX_QUOTED_CHARS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> String {
        let error = Scene::from_toml("test", text).expect_err(text).to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    }

    fn body(keys: &str) -> String {
        format!("[[bodies]]\nname = \"b\"\n{keys}\n")
    }

    #[test]
    fn bad_keys_and_types_give_one_line_with_key_found_and_expected() {
        for (text, parts) in [
            ("gravty = [0, 0, 0]", &["line 1", "unknown field `gravty`", "`gravity`"][..]),
            ("gravity = [0.0, 1.0]", &["line 1", "gravity", "length 2", "3"]),
            (&body("shape.ball.radius = \"big\"\nplace.at = [0, 1, 0]"), &["line 3", "\"big\"", "f64"]),
            (&body("shape.bal.radius = 0.1\nplace.at = [0, 1, 0]"), &["line 3", "`bal`", "`ball`"]),
            (&body("shape.ball.radius = 0.1"), &["line 1", "bodies", "missing field `place`"]),
            (
                &body("shape.ball = { radius = 0.1, size = 1 }\nplace.at = [0, 1, 0]"),
                &["keys in table: size", "available keys: radius"],
            ),
            ("[[bodies\n", &["line 1", "[[bodies"]),
        ] {
            let error = error_of(text);
            for part in parts {
                assert!(error.contains(part), "{error} lacks {part}");
            }
        }
    }

    #[test]
    fn values_that_cannot_be_are_named() {
        let ball = "shape.ball.radius = 0.1";
        let at = "place.at = [0, 1, 0]";
        for (text, expected) in [
            (
                body(&format!("shape.ball.radius = -0.1\n{at}")),
                "scene test, body `b`, shape.ball.radius: -0.1, expected a number from 0.005 to 5",
            ),
            (
                body(&format!("{ball}\nplace.at = [0, nan, 0]")),
                "scene test, body `b`, place.at: NaN, expected a number from -1000 to 1000",
            ),
            (
                body(&format!("{ball}\n{at}\nmass = 1.0\ndensity = 100.0")),
                "scene test, body `b`, mass: mass and density, expected one of the two",
            ),
            (
                body(&format!("{ball}\n{at}\ncount = 3")),
                "scene test, body `b`, count: 3, expected 1 with place.at, or place.stack, .pile or .rain",
            ),
            (
                body(&format!("{ball}\n{at}")).repeat(2),
                "scene test, bodies.name: `b` twice, expected every name once",
            ),
            (
                body(&format!("shape.hull.points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\n{at}")),
                "scene test, body `b`, shape.hull.points: 3 points, expected 4 to 256",
            ),
        ] {
            assert_eq!(error_of(&text), expected);
        }
    }
}
