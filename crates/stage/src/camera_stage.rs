//! The film of one camera: the empty room once, then per frame only what moves, its shadow and the noise.

use hull::silhouette::{SilhouetteBuilder, SilhouetteError};
use hull::{Camera, Silhouette};
use nalgebra::Vector3;

use crate::noise::Noise;
use crate::rect::{Rect, rect_of_quad};
use crate::room;
use crate::shadow::{LAMP_M, MapPlace, SHADOW_FACTOR, ShadowMap};
use crate::solid::Solid;
use crate::studio::StageSettings;
use crate::trace::View;

/// No solid on this pixel.
const NOTHING: u8 = u8::MAX;

/// One camera's view of the stage. The bytes it renders depend on settings, camera, index and frame
/// alone: not on what was rendered before, nor on the machine.
pub struct CameraStage {
    settings: StageSettings,
    camera: Camera,
    camera_index: usize,
    rays: Vec<[f32; 2]>,
    room_rgb: Vec<u8>,
    floor: Vec<MapPlace>,
    shadow: ShadowMap,
    depths: Vec<f32>,
    parts: Vec<u8>,
    /// Where `depths` and `parts` are not clear.
    drawn: Rect,
}

impl CameraStage {
    /// Looks at the empty room once; `camera_index` chooses this camera's noise.
    pub fn new(settings: &StageSettings, camera: &Camera, camera_index: usize) -> CameraStage {
        let rays = room::rays(camera);
        let (room_rgb, floor) = room::picture(camera, &rays);
        CameraStage {
            settings: settings.clone(),
            camera: camera.clone(),
            camera_index,
            room_rgb,
            floor,
            shadow: ShadowMap::new(),
            depths: vec![f32::INFINITY; rays.len()],
            parts: vec![NOTHING; rays.len()],
            rays,
            drawn: Rect::EMPTY,
        }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Bytes of one frame: width × height × 3.
    pub fn frame_bytes(&self) -> usize {
        self.room_rgb.len()
    }

    /// Renders a frame as red, green, blue bytes, row by row from the top left.
    ///
    /// # Panics
    /// If `rgb` is not of [`Self::frame_bytes`].
    pub fn render(&mut self, frame: u64, rgb: &mut [u8]) {
        rgb.copy_from_slice(&self.room_rgb);
        let solids = self.settings.solids(self.settings.time_s(frame));
        self.darken(&solids, rgb);
        let views = self.trace(&solids);
        self.shade(&views, rgb);
        self.add_noise(frame, 0, rgb);
    }

    /// Renders a frame of the empty room: neither person nor props. Its noise is other than that of the film.
    ///
    /// # Panics
    /// If `rgb` is not of [`Self::frame_bytes`].
    pub fn render_empty(&self, frame: u64, rgb: &mut [u8]) {
        rgb.copy_from_slice(&self.room_rgb);
        self.add_noise(frame, 1, rgb);
    }

    /// The true silhouette at a time of the film, seconds: 255 where a pixel's viewing ray meets person or
    /// props, else 0, row by row. The very test that [`Self::render`] draws by.
    pub fn mask(&mut self, time_s: f64) -> Vec<u8> {
        let solids = self.settings.solids(time_s);
        self.trace(&solids);
        self.parts.iter().map(|&part| if part == NOTHING { 0 } else { 255 }).collect()
    }

    /// Finds the nearest solid of every pixel.
    fn trace(&mut self, solids: &[Solid]) -> Vec<View> {
        let width = self.camera.width() as usize;
        for row in self.drawn.rows.0..self.drawn.rows.1 {
            let span = row * width + self.drawn.columns.0..row * width + self.drawn.columns.1;
            self.depths[span.clone()].fill(f32::INFINITY);
            self.parts[span].fill(NOTHING);
        }
        let views = views(solids, &self.camera);
        self.drawn = drawn_rect(&views);
        // A stage has far fewer solids than a byte counts.
        for (part, view) in views.iter().enumerate() {
            for row in view.rect.rows.0..view.rect.rows.1 {
                let span = row * width + view.rect.columns.0..row * width + view.rect.columns.1;
                let (depths, parts) = (&mut self.depths[span.clone()], &mut self.parts[span.clone()]);
                view.trace_row(&self.rays[span], depths, parts, part as u8);
            }
        }
        views
    }

    fn shade(&self, views: &[View], rgb: &mut [u8]) {
        let width = self.camera.width() as usize;
        for row in self.drawn.rows.0..self.drawn.rows.1 {
            for at in row * width + self.drawn.columns.0..row * width + self.drawn.columns.1 {
                let part = self.parts[at];
                if part != NOTHING {
                    let colour = views[usize::from(part)].colour(self.rays[at], self.depths[at]);
                    rgb[3 * at..3 * at + 3].copy_from_slice(&colour.map(|channel| (channel + 0.5) as u8));
                }
            }
        }
    }

    /// The cast shadow on the floor: all channels by one factor.
    fn darken(&mut self, solids: &[Solid], rgb: &mut [u8]) {
        const DEPTH: u32 = ((1.0 - SHADOW_FACTOR) * 256.0) as u32;
        self.shadow.draw(solids);
        let Some(corners) = self.shadow.corners_world() else { return };
        let rect = rect_of_quad(&self.camera, &corners);
        let width = self.camera.width() as usize;
        for row in rect.rows.0..rect.rows.1 {
            let (from, to) = (row * width + rect.columns.0, row * width + rect.columns.1);
            for (place, pixel) in self.floor[from..to].iter().zip(rgb[3 * from..3 * to].chunks_exact_mut(3)) {
                let hidden = self.shadow.hidden(*place);
                if hidden > 0 {
                    let factor = 65_536 - hidden * DEPTH * 256 / 255;
                    for channel in pixel {
                        *channel = ((u32::from(*channel) * factor + 32_768) >> 16) as u8;
                    }
                }
            }
        }
    }

    fn add_noise(&self, frame: u64, clip: u64, rgb: &mut [u8]) {
        let noise = Noise::new(self.settings.seed, self.camera_index, frame, clip);
        for (row, bytes) in rgb.chunks_mut(3 * self.camera.width() as usize).enumerate() {
            noise.add(row, bytes);
        }
    }
}

/// The solids that a camera sees.
fn views(solids: &[Solid], camera: &Camera) -> Vec<View> {
    let lamp = Vector3::from(LAMP_M);
    solids.iter().filter_map(|solid| View::new(solid, camera, &lamp)).collect()
}

/// Nothing is seen beyond it.
fn drawn_rect(views: &[View]) -> Rect {
    views.iter().fold(Rect::EMPTY, |all, view| all.union(view.rect))
}

/// The true silhouette at a time of the film, seconds, which is [`CameraStage::mask`]. It is drawn a row at a time, so
/// that images of any size take no memory to speak of.
pub fn true_silhouette(
    settings: &StageSettings,
    camera: &Camera,
    time_s: f64,
) -> Result<Silhouette, SilhouetteError> {
    let views = views(&settings.solids(time_s), camera);
    let Rect { columns, rows } = drawn_rect(&views);
    let mut silhouette = SilhouetteBuilder::new(camera.width(), camera.height())?;
    let (mut rays, mut mask) = (Vec::new(), vec![0; camera.width() as usize]);
    let (mut depths, mut parts) = (vec![0.0; mask.len()], vec![NOTHING; mask.len()]);
    for row in 0..camera.height() {
        if !(rows.0..rows.1).contains(&(row as usize)) {
            silhouette.push_runs(&[])?;
            continue;
        }
        rays.clear();
        rays.extend(room::row_rays(camera, row, columns.0 as u32..columns.1 as u32));
        let (depths, parts) = (&mut depths[..rays.len()], &mut parts[..rays.len()]);
        depths.fill(f32::INFINITY);
        parts.fill(NOTHING);
        for view in views.iter().filter(|view| (view.rect.rows.0..view.rect.rows.1).contains(&(row as usize)))
        {
            let span = view.rect.columns.0 - columns.0..view.rect.columns.1 - columns.0;
            view.trace_row(&rays[span.clone()], &mut depths[span.clone()], &mut parts[span], 0);
        }
        let within = mask[columns.0..columns.1].iter_mut().zip(parts.iter());
        within.for_each(|(pixel, &part)| *pixel = if part == NOTHING { 0 } else { 255 });
        silhouette.push_mask_row(&mask)?;
    }
    silhouette.finish()
}
