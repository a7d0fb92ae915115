//! Pictures of a run, drawn on a thread of their own while the run goes on.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use coordinator::{Silhouettes, Snapshot};
use hull::{Camera, Observer, Rig, Silhouette, View};
use nalgebra::{Point3, Vector3};
use setup::cli::{Failure, Outcome};
use sim::Body;

use super::report::Overlap;
use crate::picture::{PictureScene, interest, overlaps, overview_camera, render};

/// Pictures that wait to be drawn at most: each holds a frame's silhouettes. A run a second of film
/// long for each waits no longer than this.
const MAX_WAITING: usize = 16;
const SIZE: (u32, u32) = (960, 720);

/// One moment of a run, its data shared or copied.
struct Moment {
    film_s: f64,
    frame: u64,
    silhouettes: Silhouettes,
    bodies: Vec<Body>,
    up: Vector3<f64>,
    inside_world: Vec<Point3<f64>>,
}

/// Draws moments into a folder.
pub struct Album {
    moments: SyncSender<Moment>,
    hurry: Arc<AtomicBool>,
    artist: JoinHandle<Outcome<Vec<Overlap>>>,
}

impl Album {
    /// Begins an album in a folder that exists.
    pub fn begin(folder: &Path, rig: Rig, observers: Vec<Arc<Observer>>, floor_m: Option<f64>) -> Album {
        let (moments, waiting) = sync_channel(MAX_WAITING);
        let hurry = Arc::new(AtomicBool::new(false));
        let folder = folder.to_owned();
        let artist = Artist { folder, rig, observers, floor_m, camera: None, hurry: Arc::clone(&hurry) };
        Album { moments, hurry, artist: std::thread::spawn(move || artist.draw_all(&waiting)) }
    }

    /// Hands in a moment; waits if too many wait already.
    pub fn add(&self, snapshot: Snapshot<'_>) {
        let moment = Moment {
            film_s: snapshot.film_s,
            frame: snapshot.frame,
            silhouettes: snapshot.silhouettes,
            bodies: snapshot.world.bodies().to_vec(),
            up: snapshot.world.up().into(),
            inside_world: snapshot.inside_world.into_iter().map(Point3::from).collect(),
        };
        // A thread that failed returns its error from `finish`; the album ends early.
        let _ = self.moments.send(moment);
    }

    /// Set it, and pictures that still wait are left out.
    pub fn hurry(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.hurry)
    }

    /// Waits until all is drawn; the overlaps of hull and silhouettes at each moment.
    pub fn finish(self) -> Outcome<Vec<Overlap>> {
        drop(self.moments);
        self.artist.join().unwrap_or_else(|_| Err(Failure::run("drawing a picture panicked")))
    }
}

struct Artist {
    folder: PathBuf,
    rig: Rig,
    observers: Vec<Arc<Observer>>,
    floor_m: Option<f64>,
    /// One viewpoint for all pictures, chosen at the first.
    camera: Option<Camera>,
    hurry: Arc<AtomicBool>,
}

impl Artist {
    fn draw_all(mut self, moments: &Receiver<Moment>) -> Outcome<Vec<Overlap>> {
        let mut overlaps = Vec::new();
        while let Ok(moment) = moments.recv() {
            if self.hurry.load(Ordering::Relaxed) {
                break;
            }
            overlaps.push(self.draw(&moment)?);
        }
        Ok(overlaps)
    }

    fn draw(&mut self, moment: &Moment) -> Outcome<Overlap> {
        let view = |(place, silhouette): &(u16, Arc<Silhouette>)| {
            let observer = self.observers.iter().find(|observer| observer.rig_index() == *place)?;
            Some(View::new(Arc::clone(observer), silhouette))
        };
        let views: Vec<View> = moment.silhouettes.iter().filter_map(view).collect();
        let camera = match &self.camera {
            Some(camera) => camera.clone(),
            None => {
                let interest = interest(&views, &moment.bodies);
                let camera = overview_camera(&self.rig, &interest, &moment.up, SIZE).map_err(Failure::run)?;
                self.camera.insert(camera).clone()
            }
        };
        let scene = PictureScene {
            views: &views,
            bodies: &moment.bodies,
            inside_world: &moment.inside_world,
            up: moment.up,
            floor_m: self.floor_m,
        };
        let path = self.folder.join(format!("at_{:06.2}_s.png", moment.film_s));
        let picture = render(&scene, &camera);
        let mut png = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut png, image::ImageFormat::Png).map_err(Failure::run)?;
        setup::cli::write_whole(&path, png.get_ref())?;
        let names = self.rig.cameras().iter().map(|camera| camera.name().to_owned());
        let cameras = names.zip(overlaps(&views)).collect();
        Ok(Overlap { film_s: moment.film_s, frame: moment.frame, view: camera, cameras })
    }
}
