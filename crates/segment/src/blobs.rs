//! Connected components, on runs: specks go, small holes are filled.

use hull::silhouette::Run;

use crate::bits::{Area, BitImage};

/// Labels components of an image; its buffers are kept between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blobs {
    runs: Vec<Run>,
    row_offsets: Vec<usize>,
    /// Parent of each run; a run that is its own parent stands for its component.
    parents: Vec<u32>,
    /// Pixels of the component, at the run that stands for it.
    areas: Vec<u32>,
    on_border: Vec<bool>,
    by_area: Vec<(u32, u32)>,
}

impl Blobs {
    /// Clears components (pixels that touch, also at corners) of fewer than `least_px` pixels. All that is
    /// set must be in the area, here and below.
    pub(crate) fn remove_specks(&mut self, image: &mut BitImage, area: &Area, least_px: u32) {
        self.label(image, area, 1);
        self.paint(image, area, false, |blobs, root| blobs.areas[root] < least_px);
    }

    /// Clears all but the `keep` largest groups (of equal ones the upper stay). What is one component
    /// in `grown`, an image that covers this one, is one group here.
    pub(crate) fn keep_largest(&mut self, image: &mut BitImage, grown: &BitImage, area: &Area, keep: usize) {
        self.label(grown, area, 1);
        self.areas.fill(0);
        for (at_row, row) in area.rows.clone().enumerate() {
            for at in self.row_offsets[at_row]..self.row_offsets[at_row + 1] {
                let root = self.root(at);
                self.areas[root] += image.count_run(row, self.runs[at]);
            }
        }
        self.by_area.clear();
        for (run, &parent) in self.parents.iter().enumerate() {
            if parent as usize == run {
                self.by_area.push((self.areas[run], u32::MAX - parent));
            }
        }
        if self.by_area.len() <= keep {
            return;
        }
        let last = self.by_area.len() - keep;
        let least = *self.by_area.select_nth_unstable(last).1;
        self.paint(image, area, false, |blobs, root| (blobs.areas[root], u32::MAX - root as u32) < least);
    }

    /// Fills background components of at most `most_px` pixels that do not touch the image's border.
    pub(crate) fn fill_holes(&mut self, image: &mut BitImage, area: &Area, most_px: u32) {
        image.invert(area);
        self.label(image, area, 0);
        image.invert(area);
        self.on_border.clear();
        self.on_border.resize(self.runs.len(), false);
        // From the area's border it is all background to the image's.
        let columns = image.columns(area);
        for at_row in 0..area.rows.len() {
            for at in self.row_offsets[at_row]..self.row_offsets[at_row + 1] {
                let run = self.runs[at];
                let outermost = at_row == 0 || at_row + 1 == area.rows.len();
                if outermost || u32::from(run.start) == columns.start || u32::from(run.end) == columns.end {
                    let root = self.root(at);
                    self.on_border[root] = true;
                }
            }
        }
        self.paint(image, area, true, |blobs, root| blobs.areas[root] <= most_px && !blobs.on_border[root]);
    }

    /// Sets the pixels of all components that are `chosen` to `value`.
    fn paint(
        &mut self,
        image: &mut BitImage,
        area: &Area,
        value: bool,
        chosen: impl Fn(&Blobs, usize) -> bool,
    ) {
        for (at_row, row) in area.rows.clone().enumerate() {
            for at in self.row_offsets[at_row]..self.row_offsets[at_row + 1] {
                let root = self.root(at);
                if chosen(self, root) {
                    image.set_run(row, self.runs[at], value);
                }
            }
        }
    }

    /// Finds components; runs of neighbouring rows touch if they overlap after growing by `reach`.
    fn label(&mut self, image: &BitImage, area: &Area, reach: u32) {
        self.runs.clear();
        self.row_offsets.clear();
        self.row_offsets.push(0);
        for row in area.rows.clone() {
            image.row_runs(row, area, &mut self.runs);
            self.row_offsets.push(self.runs.len());
        }
        self.parents.clear();
        self.parents.extend(0..self.runs.len() as u32);
        for row in 1..area.rows.len() {
            self.join_rows(row, reach);
        }
        self.areas.clear();
        self.areas.resize(self.runs.len(), 0);
        for at in 0..self.runs.len() {
            let root = self.root(at);
            self.areas[root] += u32::from(self.runs[at].end - self.runs[at].start);
        }
    }

    fn join_rows(&mut self, row: usize, reach: u32) {
        let (mut above, here_first) = (self.row_offsets[row - 1], self.row_offsets[row]);
        let mut here = here_first;
        while above < here_first && here < self.row_offsets[row + 1] {
            let (a, b) = (self.runs[above], self.runs[here]);
            if u32::from(a.start) < u32::from(b.end) + reach && u32::from(b.start) < u32::from(a.end) + reach
            {
                let (first, second) = (self.root(above), self.root(here));
                // The smaller index stands for both, so that labels do not depend on the order.
                self.parents[first.max(second)] = first.min(second) as u32;
            }
            if a.end <= b.end {
                above += 1;
            } else {
                here += 1;
            }
        }
    }

    fn root(&mut self, mut at: usize) -> usize {
        while self.parents[at] as usize != at {
            self.parents[at] = self.parents[self.parents[at] as usize];
            at = self.parents[at] as usize;
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bits::tests::{image, whole};
    use hull::VectorPath;
    use proptest::prelude::*;

    fn drawn(rows: &[&str]) -> BitImage {
        let pixels = rows.iter().flat_map(|row| row.bytes().map(|c| u8::from(c == b'#')));
        image(rows[0].len(), &pixels.collect::<Vec<u8>>())
    }

    const MESS: [&str; 7] = [
        "#......##...", //
        ".#.....##...",
        "..#.........",
        "...####...##",
        "...#..#...##",
        "...#.##...##",
        "...###......",
    ];

    #[test]
    fn corners_join_a_component_and_small_ones_go() {
        let mut image = drawn(&MESS);
        let area = whole(&image);
        Blobs::default().remove_specks(&mut image, &area, 5);
        let mut expected = MESS;
        expected[0] = "#...........";
        expected[1] = ".#..........";
        assert_eq!(image, drawn(&expected));
    }

    #[test]
    fn only_the_largest_are_kept() {
        let mut image = drawn(&MESS);
        let (unjoined, area) = (image.clone(), whole(&image));
        Blobs::default().keep_largest(&mut image, &unjoined, &area, 1);
        let kept = MESS.map(|row| format!("{}.....", &row[..7]));
        let kept = kept.each_ref().map(String::as_str);
        assert_eq!(image, drawn(&kept));
        let unjoined = image.clone();
        Blobs::default().keep_largest(&mut image, &unjoined, &area, 3);
        assert_eq!(image, drawn(&kept), "fewer than asked for are all kept");
    }

    #[test]
    fn pieces_that_are_near_each_other_are_kept_together() {
        let rows = ["##.....###", "##.....###", "..........", ".###......", ".###......"];
        let mut image = drawn(&rows);
        let mut grown = image.clone();
        let area = grown.grow(2, &whole(&image), VectorPath::Portable);
        Blobs::default().keep_largest(&mut image, &grown, &area, 1);
        assert_eq!(image, drawn(&["##........", "##........", "..........", ".###......", ".###......"]));
    }

    #[test]
    fn holes_are_filled_but_not_bays_of_the_border_nor_large_ones() {
        let ring = ["#####..", "#...#..", "#.#.#..", "#...###", "#####.."];
        let mut image = drawn(&ring);
        let area = whole(&image);
        Blobs::default().fill_holes(&mut image, &area, 7);
        assert_eq!(image, drawn(&ring), "the hole has eight pixels");
        Blobs::default().fill_holes(&mut image, &area, 8);
        assert_eq!(image, drawn(&["#####..", "#####..", "#####..", "#######", "#####.."]));
    }

    #[test]
    fn a_hole_does_not_leak_through_a_corner() {
        let mut image = drawn(&["......", "..#...", ".#.#..", "..#...", "......"]);
        let area = image.extent(VectorPath::Portable).0;
        Blobs::default().fill_holes(&mut image, &area, 1);
        assert_eq!(image.count(), 5);
    }

    proptest! {
        #[test]
        fn components_are_those_of_a_flood(mask in prop::collection::vec(0u8..2, 12 * 9), least in 1u32..12) {
            let (width, height) = (12usize, 9usize);
            let mut found = image(width, &mask);
            let area = found.extent(VectorPath::Portable).0;
            Blobs::default().remove_specks(&mut found, &area, least);
            let mut expected = mask.clone();
            let mut seen = vec![false; mask.len()];
            for seed in 0..mask.len() {
                let mut blob = if mask[seed] == 1 && !seen[seed] { vec![seed] } else { continue };
                seen[seed] = true;
                let mut next = 0;
                while next < blob.len() {
                    let (row, column) = ((blob[next] / width) as i32, (blob[next] % width) as i32);
                    next += 1;
                    for (r, c) in (row - 1..=row + 1).flat_map(|r| (column - 1..=column + 1).map(move |c| (r, c))) {
                        let on = (0..height as i32).contains(&r) && (0..width as i32).contains(&c);
                        let at = (r.max(0) * width as i32 + c.max(0)) as usize;
                        if on && mask[at] == 1 && !seen[at] {
                            seen[at] = true;
                            blob.push(at);
                        }
                    }
                }
                if (blob.len() as u32) < least {
                    blob.iter().for_each(|&at| expected[at] = 0);
                }
            }
            prop_assert_eq!(found, image(width, &expected));
        }
    }
}
