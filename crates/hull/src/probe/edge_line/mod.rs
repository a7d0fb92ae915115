//! The silhouette's edge near an edge pixel as a straight line, from the background within a disc.
//!
//! Its direction is that of the mean vector to the background, its place follows from the background's share
//! of the disc. A square, as spec §3.2 has it for the paper's response, turns an edge that is tilted by a small
//! angle to two thirds of it; a disc prefers no direction. A disc that reached across a thin limb, or across a
//! gap between two, would take the other side for this one: so it is made smaller there.

#[cfg(target_arch = "x86_64")]
mod avx512;

use nalgebra::{Point2, Vector2};

use super::edge_normal::Sum;
use crate::camera::Pixel;
use crate::silhouette::{BitMap, STRIP};
use crate::vector::VectorPath;

/// The radius of the disc that first tells which way to look for another edge, pixels.
const FIRST_RADIUS: usize = 2;
/// Rows that are summed together: the least disc has five.
const ROWS: usize = 8;
/// Steps of Newton's method that find an offset to a billionth of the radius.
const OFFSET_STEPS: usize = 3;

/// A straight edge of a silhouette.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeLine {
    /// Its point nearest to the edge pixel, image coordinates.
    pub image: Point2<f64>,
    /// Its unit normal, towards the background.
    pub normal: Vector2<f64>,
}

impl EdgeLine {
    /// No line.
    pub const NONE: EdgeLine = EdgeLine { image: Point2::new(0.0, 0.0), normal: Vector2::new(0.0, 0.0) };
}

/// The discs of every radius from one pixel up to the half side of a window.
#[derive(Clone, Debug)]
pub struct Discs(Vec<Disc>);

/// The pixels no farther from a pixel than k + 1/2: those with a squared distance of at most k² + k.
#[derive(Clone, Debug)]
struct Disc {
    radius: i32,
    /// Row by row from the first, how many pixels it has on either side of the middle; then negative up to a multiple of
    /// sixteen rows.
    half_by_row: Vec<i32>,
    /// Its pixels in windows of 32 columns, from its leftmost on, in blocks of rows, from its first on.
    masks: Vec<Vec<[u32; ROWS]>>,
    /// By how many of its pixels are background: how far a straight edge is from its middle.
    offsets: Vec<f64>,
}

impl Discs {
    /// Discs of radii from one to `most`, which is at least one.
    pub fn up_to(most: u32) -> Discs {
        Discs((1..=most.max(1) as i32).map(Disc::of_radius).collect())
    }

    /// No line is farther than this from its edge pixel, pixels.
    pub fn reach_pixels(&self) -> f64 {
        let radius = |disc: &Disc| ((disc.offsets.len() - 1) as f64 / std::f64::consts::PI).sqrt();
        self.0.iter().map(radius).fold(0.0, f64::max)
    }

    fn most(&self) -> usize {
        self.0.len()
    }

    fn of(&self, radius: usize) -> &Disc {
        &self.0[radius.clamp(1, self.most()) - 1]
    }
}

impl Disc {
    fn of_radius(radius: i32) -> Disc {
        let squared = radius * radius + radius;
        let half_widths: Vec<i32> = (0..=radius).map(|row| (squared - row * row).isqrt()).collect();
        let twice: i32 = half_widths[1..].iter().map(|half| 2 * half + 1).sum();
        let count = 2 * twice + 2 * half_widths[0] + 1;
        let offsets = (0..=count).map(|background| offset(background, count)).collect();
        let rows = (-radius..=radius).map(|row| half_widths[row.unsigned_abs() as usize]);
        let mut half_by_row: Vec<i32> = rows.collect();
        half_by_row.resize(half_by_row.len().next_multiple_of(16), -1);
        let has = |half: i32, column: i32| (column - radius).abs() <= half;
        let mask = |half: i32, window: i32| {
            (0..STRIP).fold(0, |mask, bit| mask | u32::from(has(half, window * STRIP + bit)) << bit)
        };
        let rows = (2 * radius + 1) as usize;
        let (blocks, _) = half_by_row[..rows.next_multiple_of(ROWS)].as_chunks::<ROWS>();
        let of_window =
            |window: i32| blocks.iter().map(|half| half.map(|half| mask(half, window))).collect::<Vec<_>>();
        let masks = (0..(2 * radius) / STRIP + 1).map(of_window).collect();
        Disc { radius, half_by_row, masks, offsets }
    }

    /// The zeros of the map within the disc, and how many there are.
    #[inline(always)]
    fn background(&self, candidates: &BitMap, centre: Pixel, path: VectorPath) -> (Sum, i32) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            return unsafe { avx512::background(candidates, centre, &self.half_by_row) };
        }
        let _ = path;
        let (mut sum, mut count) = (Sum::default(), 0);
        for (window, masks) in self.masks.iter().enumerate() {
            // Windows of 32 columns begin where the disc does, so that a row's mask is the same wherever the disc is.
            let across = window as i32 * STRIP - self.radius;
            for (block, masks) in masks.iter().enumerate() {
                let down = (block * ROWS) as i32 - self.radius;
                let corner = Pixel { column: centre.column + across, row: centre.row + down };
                count += sum.add_rows(&candidates.words_from(corner), masks, across, down);
            }
        }
        (sum, count)
    }

    /// See [`edge_line`].
    #[inline(always)]
    fn edge_line(&self, candidates: &BitMap, edge: Pixel, start: Pixel, path: VectorPath) -> Fit {
        let (sum, background) = self.background(candidates, edge, path);
        let (across, down) = (f64::from(sum.across), f64::from(sum.down));
        let depends_on_start = sum.across == 0 && sum.down == 0;
        let normal = if depends_on_start {
            Vector2::new(f64::from(edge.column - start.column), f64::from(edge.row - start.row))
        } else {
            Vector2::new(across, down)
        };
        let normal = normal / (normal.x * normal.x + normal.y * normal.y).sqrt();
        let line = EdgeLine { image: edge.centre() + normal * self.offsets[background as usize], normal };
        Fit { line, depends_on_start }
    }
}

/// An edge line, and whether another start finds another line at the same edge pixel.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The line.
    pub line: EdgeLine,
    /// The background lies evenly around the edge pixel, and the start decides.
    pub depends_on_start: bool,
}

/// The edge near `edge`, a background pixel that is the nearest to the pixel `start` of the foreground. The
/// candidates are zero at background; `discs` say how much of the edge is averaged where there is room.
#[inline(always)]
pub fn edge_line(candidates: &BitMap, edge: Pixel, start: Pixel, discs: &Discs, path: VectorPath) -> Fit {
    let first = discs.of(FIRST_RADIUS).edge_line(candidates, edge, start, path);
    let most = discs.most();
    let radius = room_within_limb(candidates, edge, first.line.normal, most);
    if radius == FIRST_RADIUS.min(most) {
        return first;
    }
    let last = discs.of(radius).edge_line(candidates, edge, start, path);
    Fit { depends_on_start: first.depends_on_start || last.depends_on_start, ..last }
}

/// Where an edge was in an earlier frame: the nearest step from foreground to background in its direction, no more
/// than `steps` pixels away, and how many that takes.
#[inline(always)]
pub fn line_before(
    candidates: &BitMap,
    line: &EdgeLine,
    steps: i32,
    discs: &Discs,
    path: VectorPath,
) -> Option<(i32, EdgeLine)> {
    let pixel = |step: i32| {
        let place = line.image + line.normal * f64::from(step);
        Pixel::holding(place.x, place.y)
    };
    let is_step = |step: i32| candidates.get(pixel(step)) && !candidates.get(pixel(step + 1));
    // The line is between pixel -1/2 and 1/2: steps there come first.
    for away in 0..=steps {
        for step in [away, -away - 1] {
            if is_step(step) {
                let fit = edge_line(candidates, pixel(step + 1), pixel(step), discs, path);
                return Some((away, fit.line));
            }
        }
    }
    None
}

/// The greatest radius up to `most` of a disc around an edge pixel that does not reach across the foreground to
/// background on its other side. One pixel of background within the foreground is noise, not another side.
#[inline(always)]
fn room_within_limb(candidates: &BitMap, edge: Pixel, normal: Vector2<f64>, most: usize) -> usize {
    let is_foreground = |step: usize| {
        let step = step as f64;
        let place = (f64::from(edge.column) - normal.x * step, f64::from(edge.row) - normal.y * step);
        candidates.get(Pixel::holding(place.0, place.1))
    };
    let mut entry = 1;
    while !is_foreground(entry) {
        entry += 1;
        if entry > FIRST_RADIUS {
            return most;
        }
    }
    // A step may end three quarters of a pixel beyond the other edge, and a disc reaches half a pixel beyond its radius.
    let mut before = true;
    for step in entry + 1..=most + 2 {
        let now = is_foreground(step);
        if !before && !now && step > entry + 1 {
            return (step - 3).clamp(1, most);
        }
        before = now;
    }
    most
}

/// How far from the middle of a disc a straight edge is, towards the background, that leaves so many of its pixels to
/// the background: a chord of a circle of the same area, pixels.
#[inline(always)]
fn offset(background: i32, pixels: i32) -> f64 {
    let (background, pixels) = (f64::from(background), f64::from(pixels));
    // Half the angle of the chord of the smaller part solves a - sin a cos a = area, which is 2/3 a³ where it is small.
    let is_small = 2.0 * background <= pixels;
    let share = if is_small { background } else { pixels - background } / pixels;
    let area = std::f64::consts::PI * share;
    let mut angle = libm::cbrt(1.5 * area);
    let (mut sine, mut cosine) = libm::sincos(angle);
    for _ in 0..OFFSET_STEPS {
        angle -= (angle - sine * cosine - area) / (2.0 * sine * sine);
        (sine, cosine) = libm::sincos(angle);
    }
    let radius = (pixels / std::f64::consts::PI).sqrt();
    if is_small { radius * cosine } else { -radius * cosine }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silhouette::Silhouette;
    use crate::silhouette::tests::random_mask;
    use proptest::prelude::*;

    const SIDE: i32 = 96;

    /// A map of the pixels that a function says are foreground.
    fn map_of(is_foreground: impl Fn(f64, f64) -> bool) -> BitMap {
        let pixels = (0..SIDE * SIDE).map(|at| is_foreground(f64::from(at % SIDE), f64::from(at / SIDE)));
        let mask: Vec<u8> = pixels.map(|one| if one { 255 } else { 0 }).collect();
        BitMap::foreground(&Silhouette::from_mask(SIDE as u32, SIDE as u32, &mask).expect("size"), 3)
    }

    /// Of straight edges through all angles at many places, the angles between normals and truth, degrees, and how far
    /// the lines are off, pixels; ascending.
    fn errors(k: u32) -> [Vec<f64>; 2] {
        let discs = Discs::up_to(k);
        let (mut angles_deg, mut offsets) = (Vec::new(), Vec::new());
        for turn in 0..360 {
            let (sine, cosine) = libm::sincos(f64::from(turn) * 1.003_f64.to_radians());
            let shift = f64::from(turn % 17) / 17.0;
            let away = |x: f64, y: f64| (x - 48.0) * cosine + (y - 48.0) * sine - shift;
            let map = map_of(|x, y| away(x, y) < 0.0);
            let background = (0..SIDE * SIDE).map(|at| Pixel { column: at % SIDE, row: at / SIDE });
            // The pixel of the background nearest to one well within the foreground.
            let start = Pixel::holding(48.0 - 20.0 * cosine, 48.0 - 20.0 * sine);
            let squared =
                |pixel: &Pixel| (pixel.column - start.column).pow(2) + (pixel.row - start.row).pow(2);
            let edge = background.filter(|&pixel| !map.get(pixel)).min_by_key(squared).expect("an edge");
            let line = edge_line(&map, edge, start, &discs, VectorPath::best()).line;
            let along = line.normal.x * cosine + line.normal.y * sine;
            angles_deg.push(libm::acos(along.min(1.0)).to_degrees());
            offsets.push(away(line.image.x, line.image.y).abs());
        }
        [angles_deg, offsets].map(|mut found| {
            found.sort_by(f64::total_cmp);
            found
        })
    }

    #[test]
    fn straight_edges_are_found_at_every_angle() {
        for (k, median_deg, p95_deg, p95_pixels) in [(2, 4.0, 11.5, 0.35), (12, 0.5, 1.4, 0.15)] {
            let [angles_deg, offsets] = errors(k);
            assert!(
                angles_deg[180] < median_deg && angles_deg[342] < p95_deg,
                "{k}: {} {}",
                angles_deg[180],
                angles_deg[342]
            );
            assert!(offsets[342] < p95_pixels, "{k}: {}", offsets[342]);
        }
    }

    #[test]
    fn an_edge_is_found_where_it_was_before() {
        let discs = Discs::up_to(4);
        let (sine, cosine) = libm::sincos(0.4);
        let map = |shift: f64| map_of(|x, y| (x - 48.0) * cosine + (y - 48.0) * sine < shift);
        let at = |shift: f64| {
            let (map, start) = (map(shift), Pixel { column: 40, row: 44 });
            let edges = (0..SIDE * SIDE).map(|at| Pixel { column: at % SIDE, row: at / SIDE });
            let squared =
                |pixel: &Pixel| (pixel.column - start.column).pow(2) + (pixel.row - start.row).pow(2);
            let edge = edges.filter(|&pixel| !map.get(pixel)).min_by_key(squared).expect("an edge");
            edge_line(&map, edge, start, &discs, VectorPath::best()).line
        };
        let line = at(0.0);
        for moved in [-9.0, -2.5, -0.6, 0.0, 0.6, 2.5, 9.0] {
            let before = line_before(&map(-moved), &line, 12, &discs, VectorPath::best())
                .expect("nearer than 12 pixels")
                .1;
            let found = (line.image - before.image).dot(&line.normal);
            assert!((found - moved).abs() < 0.5, "{found}, expected {moved}");
        }
        let far = |map: &BitMap| line_before(map, &line, 12, &discs, VectorPath::best());
        assert_eq!(far(&map(-20.0)), None, "too far");
        assert_eq!(far(&map(100.0)), None, "foreground all over");
    }

    #[test]
    fn a_disc_does_not_reach_across_a_limb() {
        let discs = Discs::up_to(12);
        // A bar of seven rows.
        let map = map_of(|_, y| (40.0..47.0).contains(&y));
        let (above, below) = (Pixel { column: 48, row: 39 }, Pixel { column: 48, row: 47 });
        for (edge, up) in [(above, -1.0), (below, 1.0)] {
            let start = Pixel { column: 48, row: 43 };
            let line = edge_line(&map, edge, start, &discs, VectorPath::best()).line;
            assert!((line.normal - Vector2::new(0.0, up)).norm() < 1e-12, "{line:?}");
            let expected = f64::from(edge.row) - 0.5 * up;
            assert!((line.image.y - expected).abs() < 0.2, "{line:?}, expected {expected}");
        }
        // A pixel of noise within the foreground is no other side.
        let noisy = map_of(|x, y| y < 48.0 && (x, y) != (48.0, 44.0));
        let edge = Pixel { column: 48, row: 48 };
        assert_eq!(room_within_limb(&noisy, edge, Vector2::new(0.0, 1.0), 12), 12);
    }

    #[test]
    fn an_offset_leaves_its_share_of_a_disc() {
        for pixels in [9, 21, 489] {
            for background in 1..pixels {
                let x = offset(background, pixels) / (f64::from(pixels) / std::f64::consts::PI).sqrt();
                let share = (libm::acos(x) - x * (1.0 - x * x).sqrt()) / std::f64::consts::PI;
                let expected = f64::from(background) / f64::from(pixels);
                assert!((share - expected).abs() < 1e-9, "{background} of {pixels}: {share}");
            }
        }
    }

    proptest! {
        #[test]
        fn sums_over_words_are_sums_over_pixels(
            width in 1u32..200, height in 1u32..60, seed in any::<u64>(), column in -3i32..203, row in -3i32..63,
            radius in 1i32..40,
        ) {
            let silhouette = Silhouette::from_mask(width, height, &random_mask(width, height, seed)).expect("size");
            let map = BitMap::foreground(&silhouette, 1);
            let (mut count, mut across, mut down, mut zeros) = (0, 0, 0, 0);
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    let is_in_disc = dx * dx + dy * dy <= radius * radius + radius;
                    count += i32::from(is_in_disc);
                    if is_in_disc && !map.get(Pixel { column: column + dx, row: row + dy }) {
                        (across, down, zeros) = (across + dx, down + dy, zeros + 1);
                    }
                }
            }
            let disc = Disc::of_radius(radius);
            prop_assert_eq!(disc.offsets.len() as i32, count + 1);
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                let (sum, background) = disc.background(&map, Pixel { column, row }, path);
                prop_assert_eq!((sum.across, sum.down, background), (across, down, zeros), "{:?}", path);
            }
        }
    }
}
