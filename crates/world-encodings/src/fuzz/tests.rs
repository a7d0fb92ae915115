#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use sim::{Scene, World, WorldSettings};

use super::world;
use crate::world_to_bytes;

#[test]
fn worlds() {
    let one = "[[bodies]]\nname = \"rock\"\nshape.hull.points = [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]]\n\
               place.at = [0, 1, 0]\n[[bodies]]\nname = \"can\"\nshape.cylinder = { radius = 0.1, height = 0.3 }\n\
               place.at = [0, 2, 0]\nmass = 3\n";
    let scenes = [Scene::from_toml("one", one), Scene::from_toml("empty", ""), Scene::named("topple")];
    let seed = |scene: Result<Scene, _>| {
        let mut begun = World::new(&scene.expect("a scene"), WorldSettings::default()).expect("a world");
        sim::fuzz::steps(&mut begun);
        world_to_bytes(&begun.snapshot())
    };
    corpora::run("world", world, &scenes.map(seed));
}
