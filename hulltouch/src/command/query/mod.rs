//! `hulltouch query`: a file of points against silhouettes from files.

mod answers;
pub mod masks;
mod points;
mod through_nodes;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use camera_node::source::MaskFiles;
use clap::Args;
use hull::cull::hull_box;
use hull::pass::{BodyResult, PaperResult, Pass};
use hull::question::Answer;
use hull::rule::{HullRule, NormalWindow, OutOfView, ProbeSettings};
use hull::view_set::Scratch;
use hull::{Observer, Rig, Silhouette, View, ViewSet};

use points::PointsFile;
use setup::cli::{
    Failure, NamedValue, Outcome, check_json_writable, named, outln, while_working, write_whole,
};

/// Answers a file of points against silhouettes from files.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch query --rig rig.toml --silhouettes masks --points points.csv --json answers.json\n\n\
    masks/NAME.png (with --frame 12: masks/NAME/12.png or masks/NAME/000012.png) is the silhouette of \
    the camera NAME, of the rig's size (docs/film.md says what is a mask). points.csv begins with the \
    line x,y,z or x,y,z,body; metres. Points of one body need not stand together.")]
pub struct QueryArguments {
    /// The rig: calibrated cameras.
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Where the silhouettes are.
    #[arg(long, value_name = "DIR")]
    silhouettes: PathBuf,
    /// The points, CSV.
    #[arg(long, value_name = "FILE")]
    points: PathBuf,
    /// How a camera classifies a point that it does not see.
    #[arg(long, value_parser = named(OUT_OF_VIEW), default_value = "outside")]
    out_of_view: OutOfView,
    /// How many cameras must classify a point as inside.
    #[arg(long, value_name = "N", default_value_t = HullRule::default().min_views)]
    min_views: u32,
    /// Half the side of the window for normals, pixels, or `auto`.
    #[arg(long, value_name = "K|auto", default_value = "auto", value_parser = normal_window)]
    normal_window: NormalWindow,
    /// How far an exit is searched, metres.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    max_depth: f64,
    /// The frame, where the silhouettes of a camera are a folder of numbered images.
    #[arg(long, value_name = "N")]
    frame: Option<u64>,
    /// Ask real nodes, a process for each camera on this machine, instead of answering in this process.
    #[arg(long)]
    cluster: bool,
    /// Where the answers go.
    #[arg(long, value_name = "FILE")]
    json: PathBuf,
}

/// How a camera classifies a point that it does not see.
const OUT_OF_VIEW: [NamedValue<OutOfView>; 2] = [
    ("outside", OutOfView::Outside, "Outside: the paper's bounding frusta"),
    ("abstain", OutOfView::Abstain, "Nothing: cameras that do not see the point have no vote"),
];

/// One query, read and checked: nothing of it can be wrong any more.
struct Query {
    rig: Rig,
    settings: ProbeSettings,
    mask_paths: Vec<PathBuf>,
    silhouettes: Vec<Silhouette>,
    points: PointsFile,
}

/// Runs it.
pub fn run(arguments: &QueryArguments) -> Outcome {
    let query = Query::read(arguments)?;
    check_json_writable(&arguments.json)?;
    let began = Instant::now();
    let results = while_working("answering", || {
        if arguments.cluster { through_nodes::results(&query) } else { query.results() }
    })?;
    let took_s = began.elapsed().as_secs_f64();
    let answers = answers::answers(&query.rig, &query.points, &results);
    let mut text = serde_json::to_vec(&answers).map_err(Failure::run)?;
    text.push(b'\n');
    write_whole(&arguments.json, &text)?;
    let inside: usize = results.iter().map(|body| body.inside.len()).sum();
    let moved = results.iter().filter(|body| body.response_m.is_ok()).count();
    let bodies = match answers.body_count() {
        0 => String::new(),
        count => format!(", {moved} of {count} bodies have a response"),
    };
    outln!(
        "{} points, {inside} inside{bodies}, {} cameras, {:.3} s: {}",
        query.points.points_m.len(),
        query.rig.cameras().len(),
        took_s,
        arguments.json.display()
    )
}

impl Query {
    fn read(arguments: &QueryArguments) -> Outcome<Query> {
        let rule = HullRule { out_of_view: arguments.out_of_view, min_views: arguments.min_views };
        let settings = ProbeSettings::new(rule, arguments.normal_window, arguments.max_depth)
            .map_err(|error| Failure::input(format_args!("options: {error}")))?;
        let rig = read_rig(&arguments.rig)?;
        let points = PointsFile::read(&arguments.points)?;
        let mask_paths = masks::paths_of_frame(&arguments.silhouettes, &rig, arguments.frame)?;
        let silhouettes = while_working("reading silhouettes", || {
            let films = masks::films_around(&mask_paths, arguments.frame.is_some())?;
            let films: Vec<Vec<&Path>> =
                films.iter().map(|film| film.iter().map(PathBuf::as_path).collect()).collect();
            let mut films = MaskFiles::of_room(rig.cameras(), &films);
            let cameras = films.iter_mut().zip(&mask_paths);
            cameras
                .map(|(film, path)| film.read(path).map_err(Failure::input))
                .collect::<Outcome<Vec<Silhouette>>>()
        })?;
        for ((camera, path), silhouette) in rig.cameras().iter().zip(&mask_paths).zip(&silhouettes) {
            masks::warn_if_uniform(path, camera, [silhouette]);
        }
        Ok(Query { rig, settings, mask_paths, silhouettes, points })
    }

    /// Observers and silhouettes as one group of this process.
    fn view_set(&self) -> ViewSet {
        let cameras = self.rig.cameras().iter().zip(&self.silhouettes).enumerate();
        let views = cameras.map(|(index, (camera, silhouette))| {
            // A rig has far fewer cameras than 16 bits count: its file is parsed whole.
            let observer = Observer::new(camera.clone(), index as u16, self.settings, None);
            View::new(Arc::new(observer), silhouette)
        });
        ViewSet::new(views.collect())
    }

    /// A pass over all bodies, to be asked of so many groups.
    fn pass(&self, views: &ViewSet, group_count: usize) -> Pass {
        let frusta: Vec<_> = views.views().iter().map(|view| view.frustum().cloned()).collect();
        let hull_box = hull_box(&frusta, self.settings.rule());
        Pass::new(self.points.bodies(), hull_box.as_ref(), self.settings, group_count)
    }

    fn results(&self) -> Outcome<Vec<PaperResult>> {
        let views = self.view_set();
        let mut pass = self.pass(&views, 1);
        let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
        while let Some(question) = pass.question() {
            views.answer(question, &mut scratch, &mut answer);
            pass.answer(0, &answer).map_err(Failure::run)?;
        }
        Ok(paper_results(pass))
    }
}

/// Reads a rig file.
pub fn read_rig(path: &Path) -> Outcome<Rig> {
    let text = setup::read_text(path).map_err(|error| Failure::unreadable(path, error))?;
    Rig::from_toml(&text).map_err(|error| Failure::unreadable(path, error))
}

fn normal_window(text: &str) -> Result<NormalWindow, String> {
    if text == "auto" {
        return Ok(NormalWindow::Auto);
    }
    let pixels = text.parse().map(NormalWindow::Pixels);
    pixels.map_err(|_| format!("found {text:?}, expected auto or a number of pixels"))
}

/// What a pass found, which asked for the paper's response.
fn paper_results(pass: Pass) -> Vec<PaperResult> {
    let paper = |result| match result {
        BodyResult::Paper(paper) => paper,
        // It was asked for nothing else.
        BodyResult::Planes(_) | BodyResult::Inside(_) => PaperResult::default(),
    };
    pass.into_results().into_iter().map(paper).collect()
}
