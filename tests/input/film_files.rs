//! Masks and numbered images from other programs: every command reads a file alike, or refuses it in one line.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Output, Stdio};

use image::{DynamicImage, GrayImage, ImageBuffer, Luma, LumaA, Rgb, RgbImage, Rgba};
use stage::{StageSettings, studio_rig, true_silhouette};
use testkit::Running;

const SIZE: (u32, u32) = (96, 72);
const FRAMES: u64 = 8;

/// A pixel's mask, as a program writes it: from whether it is foreground, and its column.
type Form = fn(&GrayImage) -> DynamicImage;

/// A folder with a rig of three cameras, points, a cluster file, and the masks of a person.
struct Room(tempfile::TempDir);

impl Room {
    /// `name` names the file of a camera (by its place) and a frame.
    fn new(form: Form, name: impl Fn(usize, u64) -> String) -> Room {
        let room = Room(tempfile::tempdir().expect("a folder"));
        let rig = studio_rig(3, SIZE).expect("a rig");
        let mut text = "rig = \"rig.toml\"\nscene = \"topple\"\nfps = 30\nhold_s = 0.0\n".to_owned();
        for (index, camera) in rig.cameras().iter().enumerate() {
            let camera_name = camera.name();
            let masks = room.path().join("masks").join(camera_name);
            fs::create_dir_all(&masks).expect("a folder");
            for frame in 0..FRAMES {
                let time_s = 1.0 + frame as f64 / 30.0;
                let silhouette = true_silhouette(&StageSettings::default(), camera, time_s).expect("a size");
                let mask = GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                    Luma([u8::from(silhouette.contains(x as i32, y as i32))])
                });
                form(&mask).save(masks.join(name(index, frame))).expect("written");
            }
            text += &format!(
                "[[camera]]\nname = {camera_name:?}\nnode = \"unix:room.sock\"\n\
                 source = {{ kind = \"masks\", path = \"masks/{camera_name}\" }}\n"
            );
        }
        fs::write(room.path().join("room.cluster.toml"), text).expect("written");
        fs::write(room.path().join("rig.toml"), rig.to_toml()).expect("written");
        let points: String = (0..120)
            .map(|at| format!("{:.2},{:.2},0.1\n", f64::from(at % 12) * 0.1 - 0.6, f64::from(at / 12) * 0.18))
            .collect();
        fs::write(room.path().join("points.csv"), format!("x,y,z\n{points}")).expect("written");
        room
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
        command.current_dir(self.path()).args(arguments).env_remove("RUST_LOG").output().expect("runs")
    }

    /// What a command that succeeds says on standard error.
    #[track_caller]
    fn warned(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let said = said(&output);
        assert!(output.status.success(), "{arguments:?} said {said}");
        said
    }

    /// Refused as bad input, in one line that holds all of `words`.
    #[track_caller]
    fn refused(&self, arguments: &[&str], words: &[&str]) {
        let output = self.run(arguments);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?} said {said}");
        let lines: Vec<&str> = said.lines().filter(|line| line.starts_with("hulltouch: ")).collect();
        assert_eq!(lines.len(), 1, "{arguments:?} said {said}");
        for word in words {
            assert!(lines[0].contains(word), "{word:?} in {:?} of {arguments:?}", lines[0]);
        }
    }

    fn edit_cluster(&self, from: &str, to: &str) {
        let path = self.path().join("room.cluster.toml");
        let text = fs::read_to_string(&path).expect("written");
        assert!(text.contains(from), "{from} in {text}");
        fs::write(path, text.replace(from, to)).expect("written");
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

const DEMO: [&str; 7] =
    ["demo", "--recording", "room.cluster.toml", "--unpaced", "--headless", "--transport", "inprocess"];
const QUERY: [&str; 11] = [
    "query",
    "--rig",
    "rig.toml",
    "--silhouettes",
    "masks",
    "--frame",
    "3",
    "--points",
    "points.csv",
    "--json",
    "answers.json",
];
const RIG_CHECK: [&str; 6] = ["rig", "check", "--rig", "rig.toml", "--silhouettes", "masks"];
const SYNC_CHECK: [&str; 8] = ["sync", "check", "--rig", "rig.toml", "--silhouettes", "masks", "--fps", "30"];

fn by_frame(_: usize, frame: u64) -> String {
    format!("{frame:06}.png")
}

fn greys(value: impl Fn(u32, u32, u8) -> u8) -> impl Fn(&GrayImage) -> DynamicImage {
    move |mask| GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| Luma([value(x, y, mask.get_pixel(x, y)[0])])).into()
}

fn colours(value: impl Fn(u32, u8) -> [u8; 4]) -> impl Fn(&GrayImage) -> DynamicImage {
    move |mask| {
        image::RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| Rgba(value(x, mask.get_pixel(x, y)[0]))).into()
    }
}

fn usual(mask: &GrayImage) -> DynamicImage {
    greys(|_, _, inside| 255 * inside)(mask)
}

/// The answers of a query, the output of `rig check` and the figures of a run.
fn results(room: &Room) -> [String; 3] {
    room.warned(&QUERY);
    let answers = fs::read_to_string(room.path().join("answers.json")).expect("answers");
    let checked = String::from_utf8_lossy(&room.run(&RIG_CHECK).stdout).into_owned();
    room.warned(&[&DEMO[..], &["--json", "run.json"]].concat());
    let run = fs::read_to_string(room.path().join("run.json")).expect("figures");
    let run: serde_json::Value = serde_json::from_str(&run).expect("JSON");
    [answers, checked, run["trajectory_digest"].to_string()]
}

#[test]
fn each_form_of_a_mask_is_the_same_silhouette_to_every_command() {
    let forms: [(&str, Form); 6] = [
        ("labels of 0 and 1", |mask| mask.clone().into()),
        ("16 bits", |mask| {
            ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| Luma([u16::from(mask.get_pixel(x, y)[0])])).into()
        }),
        ("a colour on black", |mask| {
            let red = |x, y| Rgb([128 * mask.get_pixel(x, y)[0], 0, 0]);
            RgbImage::from_fn(SIZE.0, SIZE.1, red).into()
        }),
        ("a dark cut-out", |mask| colours(|x, inside| [(x % 30) as u8, 9, 9, 255 * inside])(mask)),
        ("white with the mask in alpha", |mask| {
            let white = |x, y| LumaA([255, 255 * mask.get_pixel(x, y)[0]]);
            DynamicImage::ImageLumaA8(ImageBuffer::from_fn(SIZE.0, SIZE.1, white))
        }),
        ("limited range", |mask| greys(|_, _, inside| if inside > 0 { 235 } else { 16 })(mask)),
    ];
    let expected = results(&Room::new(usual, by_frame));
    assert_ne!(expected[2], "null", "a run has a digest");
    for (name, form) in forms {
        assert_eq!(results(&Room::new(form, by_frame)), expected, "{name}");
    }
}

#[test]
fn what_has_two_readings_is_refused_alike_by_every_command() {
    let forms: [(Form, &str); 4] = [
        (
            |mask| greys(|_, y, inside| inside * (1 + (y / 4 % 2) as u8))(mask),
            "found the grey values 0, 1, 2",
        ),
        (
            |mask| greys(|_, y, inside| if y < 12 { 255 } else { 15 * inside })(mask),
            "found flat regions of more than two grey values (0, 15, 255)",
        ),
        (
            |mask| {
                let shirt =
                    |x, y| Rgb([90, 60 * (y / 4 % 2) as u8, 255].map(|c| c * mask.get_pixel(x, y)[0]));
                RgbImage::from_fn(SIZE.0, SIZE.1, shirt).into()
            },
            "found the colours #000000, ",
        ),
        (
            |mask| greys(|x, y, inside| 100 + 30 * inside + ((x * 7 + y * 13) % 60) as u8)(mask),
            "found a picture",
        ),
    ];
    for (form, words) in forms {
        let room = Room::new(form, by_frame);
        let words = [".png: ", words];
        room.refused(&QUERY, &words);
        assert!(!room.path().join("answers.json").exists());
        room.refused(&RIG_CHECK, &words);
        room.refused(&SYNC_CHECK, &words);
        room.refused(&DEMO, &words);
        let masked = Room::new(usual, by_frame);
        fs::copy(room.path().join("masks/cam_1/000003.png"), masked.path().join("pillar.png"))
            .expect("copied");
        masked.edit_cluster("name = \"cam_1\"", "name = \"cam_1\"\nignore_mask = \"pillar.png\"");
        masked.refused(&DEMO, &["camera \"cam_1\", ignore_mask: ", "pillar.png: ", words[1]]);
    }
}

#[test]
fn an_ignore_mask_that_ignores_nothing_or_all_is_refused() {
    for (value, found) in [(0, "found no foreground"), (255, "found foreground alone")] {
        let room = Room::new(usual, by_frame);
        let pillar = GrayImage::from_pixel(SIZE.0, SIZE.1, Luma([value]));
        pillar.save(room.path().join("pillar.png")).expect("written");
        room.edit_cluster("name = \"cam_1\"", "name = \"cam_1\"\nignore_mask = \"pillar.png\"");
        room.refused(
            &DEMO,
            &["camera \"cam_1\", ignore_mask: ", &format!("pillar.png: {found}, expected white only")],
        );
    }
}

#[test]
fn masks_of_one_side_alone_are_warned_of_by_camera() {
    for (value, side) in [(0, "background"), (255, "foreground")] {
        let room = Room::new(usual, by_frame);
        for frame in 0..FRAMES {
            let file = room.path().join("masks/cam_1").join(by_frame(1, frame));
            GrayImage::from_pixel(SIZE.0, SIZE.1, Luma([value])).save(file).expect("written");
        }
        for (command, count) in [(&QUERY[..], "its silhouette is"), (&DEMO[..], "masks of its film are")] {
            let said = room.warned(command);
            let is_named = said
                .lines()
                .any(|line| line.contains("\"cam_1\"") && line.contains(&format!("{count} entirely {side}")));
            assert!(is_named && !said.contains("\"cam_0\""), "{command:?} said {said}");
        }
        // It refuses cameras without foreground.
        if side == "foreground" {
            let said = room.warned(&RIG_CHECK);
            let expected = "\"cam_1\": masks: all of its silhouettes are entirely foreground";
            assert!(said.contains(expected), "{said}");
        }
    }
}

#[test]
fn images_named_by_other_numbers_are_refused_at_once_with_the_key_to_set() {
    let nanoseconds =
        |_: usize, frame: u64| format!("{}.png", 1_403_636_579_763_555_584 + frame * 33_333_333 + frame % 3);
    let room = Room::new(usual, nanoseconds);
    let words = [
        "camera \"cam_0\": ",
        "masks/cam_0: image numbers start at 1403636579763555584",
        "rename the images",
    ];
    room.refused(&DEMO, &words);
    room.refused(&["demo", "--recording", "room.cluster.toml", "--headless"], &words);
    room.refused(&SYNC_CHECK, &["masks/cam_0: image numbers are usually 3333333", "--fps 1000"]);

    let room = Room::new(usual, |_, frame| format!("{}.png", 1000 + frame));
    room.refused(&DEMO, &["image numbers start at 1000", "33.3 s", "set start_frame = 1000"]);
    room.edit_cluster("kind = \"masks\"", "kind = \"masks\", start_frame = 1000");
    room.warned(&DEMO);
    room.warned(&RIG_CHECK);

    let room = Room::new(usual, |camera, frame| format!("{}.png", frame + if camera == 2 { 200 } else { 0 }));
    room.refused(&DEMO, &["camera \"cam_2\": ", "image numbers start at 200"]);
    let room = Room::new(usual, |camera, frame| format!("{}.png", 2 * frame + u64::from(camera == 2)));
    room.refused(&DEMO, &["camera \"cam_2\" has images of frames 1 to 15, none of which", "cam_0, cam_1"]);
}

#[test]
fn names_that_hold_the_camera_last_are_refused_with_the_pattern_to_set() {
    let room = Room::new(usual, |camera, frame| format!("video_{frame:04}_cam{camera}.png"));
    room.refused(&DEMO, &["are both number 0", "video_%04d_cam0.png"]);
    for camera in 0..3 {
        let folder = format!("masks/cam_{camera}\"");
        room.edit_cluster(&folder, &format!("masks/cam_{camera}/video_%04d_cam{camera}.png\""));
    }
    room.warned(&DEMO);
}

#[test]
fn a_deployed_run_names_the_camera_whose_numbers_are_times() {
    let room = Room::new(usual, |camera, frame| {
        format!("{}.png", frame + if camera == 1 { 1_700_000_000 } else { 0 })
    });
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    command.current_dir(room.path()).args(["node", "room.cluster.toml", "--stop-with-stdin"]);
    command.args(["--camera", "cam_0", "--camera", "cam_1", "--camera", "cam_2"]);
    let mut node =
        Running::start(command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut listening = String::new();
    BufReader::new(node.child().stdout.take().expect("piped")).read_line(&mut listening).expect("a line");
    let output = room.run(&["coordinator", "room.cluster.toml", "--headless", "--unpaced"]);
    // The node ends with its standard input.
    drop(node.child().stdin.take());
    let ended = node.wait_with_output().expect("ends");
    let log = String::from_utf8_lossy(&ended.stderr).into_owned();
    let reason = "camera \"cam_1\": ";
    let (said, number) = (said(&output), "image numbers start at 1700000000");
    assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
    assert!(said.contains(reason) && said.contains(number), "{said}");
    assert!(log.contains(reason) && log.contains(number), "{log}");
}

#[test]
fn a_camera_s_program_does_not_inherit_the_token_of_the_page() {
    let room = Room::new(usual, |_, frame| format!("{frame:06}.png"));
    let counts = "echo tokens: $(env | grep -c HULLTOUCH_TOKEN) >&2; exit 1";
    let program = format!(
        "source = {{ kind = \"pipe\", command = [\"sh\", \"-c\", \"{counts}\"] }}\nsegmentation = {{ method = \"chroma\" }}"
    );
    room.edit_cluster("source = { kind = \"masks\", path = \"masks/cam_0\" }", &program);
    let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    let output =
        command.current_dir(room.path()).args(DEMO).env("HULLTOUCH_TOKEN", "a-secret-token").output();
    let said = said(&output.expect("runs"));
    assert!(said.contains("tokens: 0"), "{said}");
}
