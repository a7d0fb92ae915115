//! Distances to the edge of a mask, by the 3-4 chamfer: two sweeps over the pixels.

/// Straight and diagonal neighbours count 3 and 4: thirds of a pixel.
pub(super) const STRAIGHT: u16 = 3;
const DIAGONAL: u16 = 4;
/// Farther than any pixel of an image.
const FAR: u16 = 30_000;

/// Distances to the line half-way between pixels, averaged with the pixels around, near ones twice.
pub(super) fn averaged(thirds: &[i16], columns: usize) -> Vec<f32> {
    let to_line = |&thirds: &i16| f32::from(thirds) - 0.5 * f32::from(STRAIGHT) * f32::from(thirds.signum());
    let mut values: Vec<f32> = thirds.iter().map(to_line).collect();
    for stride in [1, columns] {
        let plain = values.clone();
        for at in stride..plain.len() - stride {
            values[at] = 0.25 * (plain[at - stride] + 2.0 * plain[at] + plain[at + stride]);
        }
    }
    values
}

/// Chamfer distances, thirds of a pixel, to the nearest pixel of that value; beyond the borders all are
/// of that value or none.
pub(super) fn distances(values: &[bool], columns: usize, wanted: bool, beyond: bool) -> Vec<u16> {
    let mut found: Vec<u16> = values.iter().map(|&value| if value == wanted { 0 } else { FAR }).collect();
    let rows = values.len() / columns;
    let off = if beyond { 0 } else { FAR };
    for row in 0..rows {
        let (above, here) = found.split_at_mut(row * columns);
        let above = row.checked_sub(1).map(|before| &above[before * columns..]);
        relax(&mut here[..columns], above, off, false);
    }
    for row in (0..rows).rev() {
        let (here, below) = found.split_at_mut((row + 1) * columns);
        let below = (row + 1 < rows).then(|| &below[..columns]);
        relax(&mut here[row * columns..], below, off, true);
    }
    found
}

/// Lowers a row's distances by way of the row before and of the pixel before in the row.
fn relax(here: &mut [u16], before: Option<&[u16]>, off: u16, backwards: bool) {
    let columns = here.len();
    let pick = |column: usize| before.map_or(off, |before| before[column]);
    let mut last = off;
    for index in 0..columns {
        let column = if backwards { columns - 1 - index } else { index };
        let left = if column > 0 { pick(column - 1) } else { off };
        let right = if column + 1 < columns { pick(column + 1) } else { off };
        let straight = last.min(pick(column)) + STRAIGHT;
        last = here[column].min(straight).min(left.min(right) + DIAGONAL);
        here[column] = last;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_thirds_of_pixels() {
        let values: Vec<bool> = (0..35).map(|at| at == 17).collect();
        let found = distances(&values, 7, true, false);
        assert_eq!(&found[14..21], [9, 6, 3, 0, 3, 6, 9]);
        assert_eq!(&found[..7], [11, 8, 7, 6, 7, 8, 11]);
        let bordered = distances(&values, 7, true, true);
        assert_eq!(&bordered[14..21], [3, 6, 3, 0, 3, 6, 3]);
        assert_eq!(&bordered[..7], [3; 7]);
    }
}
