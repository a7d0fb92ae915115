//! The texts of a sample: cluster file, scene, and what to try.

use sim::Scene;

use super::plan::Plan;

/// The calibration.
pub const RIG: &str = "rig.toml";
/// The virtual bodies.
pub const SCENE: &str = "room.scene.toml";
/// The whole room.
pub const CLUSTER: &str = "room.cluster.toml";
/// Commands to try.
pub const README: &str = "README.txt";
/// The folder of the cameras' films, each NAME.y4m.
pub const FILMS: &str = "films";
/// The folder of the empty rooms, likewise.
pub const EMPTY: &str = "empty";
/// What [`README`] begins with: by it a sample is known.
pub const TITLE: &str = "A rehearsal for Hulltouch: ";

/// The shipped scene that is copied.
const SHIPPED: &str = "topple";
/// The nodes, each with half of the cameras, and their addresses.
const NODES: [(&str, &str); 2] = [("left", "127.0.0.1:7001"), ("right", "127.0.0.1:7002")];

/// The scene, to be edited.
pub fn scene() -> String {
    let shipped = Scene::named(SHIPPED).expect("it comes with the program");
    format!(
        "# The virtual bodies of this room: a copy of the scene `{SHIPPED}` that comes with the program. Change what you\n\
         # like and play the room again. docs/scenes.md lists every key. Try `count = 8` of \"right\", or its `density`.\n\
         # `[stage]` is for the studio that is rendered live: the films of this room show the person as filmed.\n\
         #\n{}",
        shipped.text()
    )
}

/// The cluster file.
pub fn cluster(plan: &Plan) -> String {
    let (fps, seed) = (plan.numbers.fps, plan.numbers.seed);
    let mut text = format!(
        "# A room in files: {}. docs/cluster-file.md lists every key.\n\
         # Paths begin at the folder of this file.\n\
         name = \"rehearsal\"\n\
         rig = {RIG:?}\n\
         scene = \"./{SCENE}\"\n\
         fps = {fps}\n\
         seed = {seed}\n\n\
         # Two nodes on this machine. In a room of several PCs each has the name of its PC, and that PC's address or none.\n",
        plan.title()
    );
    for (name, address) in NODES {
        text += &format!("[[node]]\nname = {name:?}\naddress = {address:?}\n\n");
    }
    text += "# Each camera: its film, and the empty room from which it learns what is background. For a camera that\n\
             # films live, `source` is a command: { kind = \"pipe\", live = true, command = [\"ffmpeg\", …] }.\n";
    for (index, camera) in plan.rig.cameras().iter().enumerate() {
        let name = camera.name();
        let (node, _) = NODES[index * NODES.len() / plan.rig.cameras().len()];
        text += &format!(
            "[[camera]]\nname = {name:?}\nnode = {node:?}\n\
             source = {{ kind = \"video\", path = \"{FILMS}/{name}.y4m\" }}\n\
             background = {{ kind = \"video\", path = \"{EMPTY}/{name}.y4m\" }}\n\n"
        );
    }
    text.truncate(text.trim_end().len() + 1);
    text
}

/// What lies in the folder, and commands to try there.
pub fn readme(plan: &Plan) -> String {
    let [(left, _), (right, _)] = NODES;
    let (films, empty) = (format!("{FILMS}/"), format!("{EMPTY}/"));
    format!(
        "{TITLE}{}.\n\
         `hulltouch sample` wrote it, version {version}. A person of the synthetic studio sweeps the arms apart.\n\n\
         {RIG:<20}the calibration: where each camera stands, and its lens\n\
         {films:<20}the film of each camera, cam_0.y4m and on: YUV4MPEG2, which ffplay shows\n\
         {empty:<20}each camera's film of the empty room\n\
         {SCENE:<20}the virtual bodies; edit it\n\
         {CLUSTER:<20}the room: cameras, films, nodes and scene\n\n\
         Commands to try in this folder, in this order. Each ends by itself, but for the two nodes: Ctrl-C ends them.\n\n\
         1. Play the room on this machine. --open shows its page in your browser; the run ends with the film.\n\n    \
         hulltouch demo --recording {CLUSTER} --open\n\n\
         2. Play it as fast as this machine can, and write figures and a recording.\n\n    \
         hulltouch demo --recording {CLUSTER} --unpaced --headless --json run.json --record run.mcap --force\n\n\
         3. Make the recorded run again, bit for bit.\n\n    \
         hulltouch replay run.mcap --unpaced --headless\n\n\
         4. Check what a node needs, then start both nodes, each in a terminal of its own.\n\n    \
         hulltouch doctor {CLUSTER} --host {left}\n    \
         hulltouch node {CLUSTER} --host {left}\n    \
         hulltouch node {CLUSTER} --host {right}\n\n\
         5. In a third terminal, run the world over these nodes, as in a room of several PCs.\n\n    \
         hulltouch coordinator {CLUSTER} --open\n\n\
         Films are {seconds} s long; --seconds of `hulltouch sample` makes longer ones.\n\
         `hulltouch` is the program in target/release of the project. docs/sample.md says what else can be rehearsed.\n",
        plan.title(),
        version = env!("CARGO_PKG_VERSION"),
        seconds = plan.numbers.seconds,
    )
}

#[cfg(test)]
mod tests {
    use setup::ClusterFile;

    use super::super::plan::{MOTION, SampleNumbers};
    use super::*;

    fn plan(cameras: usize) -> Plan {
        let numbers = SampleNumbers { cameras, size: (320, 240), seconds: 2.0, fps: 30, seed: 7 };
        Plan::checked(numbers).expect("in range")
    }

    #[test]
    fn the_cluster_file_is_read_with_half_of_the_cameras_at_each_node() {
        for (cameras, of_left) in [(2, 1), (4, 2), (5, 3), (64, 32)] {
            let (folder, plan) = (tempfile::tempdir().expect("a folder"), plan(cameras));
            for (name, text) in [
                (RIG, plan.rig.to_toml()),
                (SCENE, scene()),
                (CLUSTER, cluster(&plan)),
                (README, readme(&plan)),
            ] {
                std::fs::write(folder.path().join(name), text).expect("written");
            }
            let file = ClusterFile::open(&folder.path().join(CLUSTER)).expect("a cluster file");
            assert_eq!((file.fps, file.seed, file.cameras.len()), (30.0, Some(7), cameras));
            let nodes = file.nodes.iter().map(|node| (node.name.as_deref(), node.cameras.len()));
            let expected = [(Some("left"), of_left), (Some("right"), cameras - of_left)];
            assert_eq!(nodes.collect::<Vec<_>>(), expected);
            assert!(file.is_deployed() && file.cameras.iter().all(|camera| camera.background.is_some()));
            assert!(file.load_scene().expect("a scene").bodies(7).len() > 8);
        }
    }

    #[test]
    fn the_person_does_what_the_scene_is_made_for() {
        let scene = Scene::named(SHIPPED).expect("shipped");
        assert_eq!(scene.stage().map(|stage| &stage.motion[..]), Some(MOTION.name()));
    }

    #[test]
    fn the_readme_names_every_entry_and_commands_of_this_folder() {
        let text = readme(&plan(4));
        assert!(text.starts_with(TITLE));
        for entry in [RIG, SCENE, CLUSTER, FILMS, EMPTY] {
            assert!(text.contains(&format!("\n{entry}")), "{entry} in {text}");
        }
        let commands: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("    ")).collect();
        assert_eq!(commands.len(), 7, "{text}");
        assert!(commands.iter().all(|command| command.starts_with("hulltouch ")), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
    }
}
