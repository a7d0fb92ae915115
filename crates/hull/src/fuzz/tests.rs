#[path = "../../../../tests/shared/corpora.rs"]
mod corpora;

use super::rig;
use crate::Rig;

const TEXT: &str = r#"# Two cameras, as Pose2Sim writes them.
[cam_9]
name = "zebra"
size = [ 640.0, 480.0 ]
matrix = [ [ 500.0, 0, 320.0 ], [ 0.0, 510.5, 240.0 ], [ 0.0, 0.0, 1.0 ] ]
distortions = [ -0.046, 0.139, -0.0004, -0.0004 ]
rotation = [ 0.90, 0.55, 1.02 ]
translation = [ 0.30, 0.95, 4.96 ]
fisheye = false
grid_convention = "opencv"

[cam_1]
name = "l\u00e4nge \"1\""
size = [ 1920, 1080 ]
matrix = [ [ 1681.0, 0.25, 969.0 ], [ 0.0, 1681.0, 540.0 ], [ 0.0, 0.0, 1.0 ] ]
distortions = [ ]
rotation = [ 0.0, 0.0, 3.141592653589793 ]
translation = [ 0.0, 0.0, 1.0 ]

[metadata]
adjusted = false
error = 0.0
"#;

#[test]
fn rigs() {
    let written = Rig::from_toml(TEXT).expect("a rig").to_toml();
    let wrong =
        ["fisheye = true", "rotation = [ nan, inf, -inf ]", "size = [ 16385, 0 ]", "name = 3", "[[cam_9]]"];
    let wrong = wrong.map(|line| TEXT.replacen("fisheye = false", line, 1).into_bytes());
    let seeds: Vec<Vec<u8>> = [TEXT.into(), written.into_bytes(), vec![]].into_iter().chain(wrong).collect();
    corpora::run("rig", rig, &seeds);
}
