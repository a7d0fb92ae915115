//! `hulltouch rig import`.

use std::path::{Path, PathBuf};

use calib::import::{Axis, Format, ImportOptions, import};
use clap::{Args, ValueEnum};
use hull::Camera;

use setup::cli::{Failure, Outcome, out, outln, parse_size, write_whole};

/// Turns another program's calibration into a rig file: in metres, and +Y up if --up names the source's axis.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch rig import --up z Calib.qca.txt --out rig.toml\n  \
    hulltouch rig import --format opencv --scale 0.001 --size 644x486 calibration/ --out rig.toml\n\n\
    opencv: a FileStorage file (XML or YAML), or a folder of one file or folder per camera; a stereo \
    file is two cameras; EasyMocap's two files. svoboda: the data folder of MultiCamSelfCal. matrices: a \
    3 x 4 matrix, or a folder of one text file per camera.")]
pub struct ImportArguments {
    /// A calibration file or folder.
    input: PathBuf,
    /// Whose format it is.
    #[arg(long, value_enum, default_value = "auto")]
    format: FormatChoice,
    /// Which axis of the source's world points up: x, y, z, -x, -y or -z [default: axes are kept].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<Axis>,
    /// The source's unit of length in metres [default: the format's own, else 1].
    #[arg(long, value_name = "S")]
    scale: Option<f64>,
    /// The image size, for sources that do not contain it.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// The source's coordinates of the top left pixel's centre [default: the format's own, else 0].
    #[arg(long, value_name = "0|0.5|1", value_parser = pixel_origin)]
    pixel_origin: Option<f64>,
    /// The rig file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FormatChoice {
    /// Found by names and content.
    Auto,
    /// OpenCV FileStorage.
    Opencv,
    /// Qualisys .qca.txt.
    Qualisys,
    /// The TOML of aniposelib, Pose2Sim, FreeMoCap and Caliscope, its camera_array.toml too.
    Aniposelib,
    /// The projection matrices of MultiCamSelfCal.
    Svoboda,
    /// Plain 3 x 4 projection matrices.
    Matrices,
}

impl FormatChoice {
    fn format(self) -> Option<Format> {
        Some(match self {
            FormatChoice::Auto => return None,
            FormatChoice::Opencv => Format::OpenCv,
            FormatChoice::Qualisys => Format::Qualisys,
            FormatChoice::Aniposelib => Format::Aniposelib,
            FormatChoice::Svoboda => Format::Svoboda,
            FormatChoice::Matrices => Format::Matrices,
        })
    }
}

/// Runs it.
pub fn run(arguments: &ImportArguments) -> Outcome {
    let options = ImportOptions {
        up: arguments.up,
        scale: arguments.scale,
        size: arguments.size,
        pixel_origin: arguments.pixel_origin,
    };
    refuse_own_input(&arguments.input, &arguments.out)?;
    let imported = import(&arguments.input, arguments.format.format(), &options).map_err(Failure::input)?;
    for warning in &imported.warnings {
        tracing::warn!("{warning}");
    }
    write_whole(&arguments.out, imported.rig.to_toml().as_bytes())?;
    let cameras = imported.rig.cameras();
    out!("{}", table(cameras))?;
    outln!("{} cameras: {}", cameras.len(), arguments.out.display())
}

/// Refuses to write over the calibration that is read: the file itself, or one of its folder that is no rig file.
fn refuse_own_input(input: &Path, out: &Path) -> Outcome {
    let (Ok(input), Ok(written)) = (input.canonicalize(), out.canonicalize()) else { return Ok(()) };
    let is_rig = written.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    if written == input || (written.starts_with(&input) && !is_rig) {
        let problem = "it is part of the calibration that is imported, expected another file for --out";
        return Err(Failure::unreadable(out, problem));
    }
    Ok(())
}

fn table(cameras: &[Camera]) -> String {
    let names = cameras.iter().map(|camera| camera.name().chars().count());
    let width = names.max().unwrap_or(0).max("camera".len());
    let mut text = format!("{:width$}  {:>11}  {:>17}  position, m\n", "camera", "size", "focal length, px");
    for camera in cameras {
        let (k, centre) = (camera.intrinsics(), camera.centre_world());
        let size = format!("{} x {}", camera.width(), camera.height());
        let focal = format!("{:.1} {:.1}", k[(0, 0)], k[(1, 1)]);
        text += &format!(
            "{:width$}  {size:>11}  {focal:>17}  {:8.3} {:8.3} {:8.3}\n",
            camera.name(),
            centre.x,
            centre.y,
            centre.z
        );
    }
    text
}

fn pixel_origin(text: &str) -> Result<f64, String> {
    match text {
        "0" => Ok(0.0),
        "0.5" => Ok(0.5),
        "1" => Ok(1.0),
        _ => Err(format!("found {text:?}, expected 0 (OpenCV), 0.5 (OpenGL) or 1 (MATLAB)")),
    }
}
