#[path = "../../../tests/shared/corpora.rs"]
mod corpora;

use super::scene;
use crate::Scene;

const EVERY_KEY: &str = r#"gravity = [0.0, 0.0, -9.81]
floor = { enabled = true, height = 0.5, friction = 0.8, restitution = 0.1 }
hull = { restitution = 1.0, friction = 0, reuse_within_m = 0.01 }
stage = { motion = "punch", props = ["table"], person = false }
[[bodies]]
name = "box"
shape.box.size = [0.28, 0.3, 0.2]
count = 4
place.stack = { foot = [-0.5, 0.0, 0.5], gap = 0.01 }
rotation_deg = [0.0, 30.0, 0.0]
density = 120.0
color = [0.8, 0.3, 0.2]
[[bodies]]
name = "ball"
shape.ball.radius = 0.1
count = 3
place.rain = { foot = [0, 2, 0], radius = 0.4, spacing = 0.05 }
mass = 2
[[bodies]]
name = "rock"
shape.hull.points = [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]]
place.at = [0, 1, 0]
fixed = true
"#;

#[test]
fn scenes() {
    let body = |shape: &str, place: &str| format!("[[bodies]]\nname = \"b\"\nshape.{shape}\nplace.{place}\n");
    let mut seeds: Vec<String> =
        Scene::names().map(|name| Scene::named(name).expect("shipped").text().to_owned()).collect();
    seeds.extend([EVERY_KEY.into(), String::new()]);
    seeds.push(body("capsule = { radius = 0.1, length = 0.3 }", "pile = { foot = [0, 1, 0], radius = 0 }"));
    seeds.push(body("cylinder = { radius = 0.1, height = 0.3 }", "stack.foot = [0, 0, 0]"));
    seeds.push(body("cone = { radius = 5, height = 0.01 }", "at = [1000, -1000, nan]"));
    let seeds: Vec<Vec<u8>> = seeds.into_iter().map(String::into_bytes).collect();
    corpora::run("scene", scene, &seeds);
}
