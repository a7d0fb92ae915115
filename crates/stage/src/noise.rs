//! Sensor noise: a table of normal deviates, read from another place for every stretch of every row.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use crate::maths::mixed;

/// Standard deviation of the noise, of 255.
pub const NOISE_SIGMA: f64 = 2.4;

/// Bytes that get their noise from one stretch of the table.
const STRETCH: usize = 2048;
const TABLE: usize = 1 << 16;

/// What is added to, and what is taken from, each byte: one of the two is zero. Two saturating byte
/// operations are the whole work.
struct Table {
    more: Vec<u8>,
    less: Vec<u8>,
}

/// The noise of one frame of one camera.
pub(crate) struct Noise {
    key: u64,
    table: &'static Table,
}

impl Noise {
    pub fn new(seed: u64, camera_index: usize, frame: u64, clip: u64) -> Noise {
        static TABLE_CELL: OnceLock<Table> = OnceLock::new();
        let key = mixed(mixed(mixed(mixed(seed) ^ camera_index as u64) ^ frame) ^ clip);
        Noise { key, table: TABLE_CELL.get_or_init(table) }
    }

    /// Adds the noise of one row to its bytes.
    pub fn add(&self, row: usize, bytes: &mut [u8]) {
        for (stretch, bytes) in bytes.chunks_mut(STRETCH).enumerate() {
            let from = mixed(self.key ^ ((row as u64) << 20) ^ stretch as u64) as usize % TABLE;
            let more = &self.table.more[from..from + bytes.len()];
            let less = &self.table.less[from..from + bytes.len()];
            for ((byte, more), less) in bytes.iter_mut().zip(more).zip(less) {
                *byte = byte.saturating_add(*more).saturating_sub(*less);
            }
        }
    }
}

fn table() -> Table {
    let mut deviates = Vec::with_capacity(TABLE + STRETCH);
    let share = |number: u64| (mixed(number) >> 11) as f64 / (1u64 << 53) as f64;
    for pair in 0..(TABLE / 2) as u64 {
        // Box and Muller's pairs.
        let radius = (-2.0 * libm::log(1.0 - share(2 * pair))).sqrt();
        let (s, c) = libm::sincos(TAU * share(2 * pair + 1));
        deviates.extend([radius * s, radius * c].map(|deviate| (deviate * NOISE_SIGMA).round() as i32));
    }
    deviates.extend_from_within(..STRETCH);
    let positive = |sign: i32| deviates.iter().map(|&d| (sign * d).clamp(0, 255) as u8).collect();
    Table { more: positive(1), less: positive(-1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(frame: u64) -> Vec<f64> {
        let noise = Noise::new(7, 1, frame, 0);
        let mut bytes = vec![128u8; 640 * 3 * 40];
        for (row, bytes) in bytes.chunks_mut(640 * 3).enumerate() {
            noise.add(row, bytes);
        }
        bytes.into_iter().map(|byte| f64::from(byte) - 128.0).collect()
    }

    #[test]
    fn noise_is_normal_and_other_in_every_frame() {
        let (a, b) = (noisy(0), noisy(1));
        let count = a.len() as f64;
        let mean = a.iter().sum::<f64>() / count;
        let variance = a.iter().map(|d| d * d).sum::<f64>() / count;
        let beyond = a.iter().filter(|d| d.abs() > 2.0 * NOISE_SIGMA).count() as f64 / count;
        let shared = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() / count / variance;
        assert!(mean.abs() < 0.03, "mean {mean}");
        assert!((variance.sqrt() - NOISE_SIGMA).abs() < 0.1, "sigma {}", variance.sqrt());
        assert!((0.02..0.07).contains(&beyond), "{beyond} beyond two sigma");
        assert!(shared.abs() < 0.02, "correlation of two frames {shared}");
    }
}
