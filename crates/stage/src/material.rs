//! The looks of skin, hair, cloth, cardboard and wood: colour by place on the solid, in 0–255.

use crate::solid::Material;

/// A colour, red green blue, 0–255.
pub(crate) type Colour = [f32; 3];

/// A number in 0..1 for each cell of a grid.
#[inline]
pub(crate) fn grain(i: i32, j: i32) -> f32 {
    let mut bits = (i as u32).wrapping_mul(0x9e37_79b1) ^ (j as u32).wrapping_mul(0x85eb_ca77);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
    bits ^= bits >> 13;
    (bits & 0xffff) as f32 * (1.0 / 65536.0)
}

/// The albedo of a material at `p`, metres in the solid's frame (squashed), on a solid of `length_m`.
#[inline]
pub(crate) fn albedo(material: Material, p: [f32; 3], length_m: f32) -> Colour {
    match material {
        Material::Skin => skin(p),
        Material::Face => face(p),
        Material::Hair => scaled([62.0, 40.0, 27.0], 0.75 + 0.5 * grain(cell(p[0], 220.0), cell(p[1], 40.0))),
        Material::Shirt => shirt(p[1] + 0.02 * p[0] * p[0], p),
        // The stripes of a sleeve begin below the shoulder.
        Material::Sleeve => shirt(if p[1] > 0.045 { p[1] + 0.03 } else { 0.03 }, p),
        // A plain yoke over the shoulders, where the stripes of the pieces would not meet.
        Material::Yoke => {
            scaled([188.0, 46.0, 48.0], 0.92 + 0.1 * grain(cell(p[0], 180.0), cell(p[1], 180.0)))
        }
        Material::Belted => {
            let over_belt_m = p[1] - length_m;
            if over_belt_m > 0.002 {
                scaled([188.0, 46.0, 48.0], 0.97)
            } else if over_belt_m > -0.034 {
                let buckle = p[0].abs() < 0.022 && p[2] > 0.0;
                if buckle { [190.0, 175.0, 120.0] } else { [58.0, 38.0, 28.0] }
            } else {
                denim(p)
            }
        }
        Material::Trousers => denim(p),
        Material::Shoe => shoe(p),
        Material::Cardboard => cardboard(p),
        Material::Wood => {
            let ring = p[2] * 30.0 + 0.6 * wobble(p[0] * 9.0) + 0.4 * p[1];
            let line = ring - ring.floor();
            scaled([158.0, 104.0, 62.0], 0.88 + 0.2 * line * (1.0 - line) * 4.0)
        }
    }
}

#[inline]
fn scaled(colour: Colour, factor: f32) -> Colour {
    colour.map(|channel| channel * factor)
}

#[inline]
fn cell(metres: f32, per_metre: f32) -> i32 {
    (metres * per_metre).floor() as i32
}

/// A smooth wave of period 2 between −1 and 1, by a parabola: no sine needed.
#[inline]
fn wobble(x: f32) -> f32 {
    let half = x - 2.0 * (x * 0.5).floor() - 1.0;
    4.0 * half * (1.0 - half.abs())
}

#[inline]
fn skin(p: [f32; 3]) -> Colour {
    scaled([222.0, 165.0, 134.0], 0.97 + 0.06 * grain(cell(p[0] + p[2], 160.0), cell(p[1], 160.0)))
}

/// Eyes, brows, lips and a flush on the front of the skull.
#[inline]
fn face(p: [f32; 3]) -> Colour {
    let side = p[0].abs();
    if p[2] < 0.03 {
        return skin(p);
    }
    let within = |x: f32, y: f32, rx: f32, ry: f32| {
        let (u, v) = ((side - x) / rx, (p[1] - y) / ry);
        u * u + v * v < 1.0
    };
    if within(0.031, 0.008, 0.008, 0.008) {
        [48.0, 58.0, 62.0]
    } else if within(0.031, 0.008, 0.018, 0.010) {
        [236.0, 230.0, 222.0]
    } else if within(0.032, 0.031, 0.022, 0.006) {
        [74.0, 48.0, 34.0]
    } else if within(0.0, -0.056, 0.024, 0.008) {
        [176.0, 84.0, 78.0]
    } else if within(0.045, -0.025, 0.02, 0.02) {
        [226.0, 150.0, 124.0]
    } else {
        skin(p)
    }
}

/// Broad red and amber stripes, woven.
#[inline]
fn shirt(height_m: f32, p: [f32; 3]) -> Colour {
    let stripe = height_m * 11.0;
    let share = stripe - stripe.floor();
    let weave = 0.92 + 0.14 * grain(cell(p[0], 180.0), cell(p[1], 180.0)) * (0.6 + 0.4 * wobble(p[0] * 60.0));
    let base = if share < 0.62 {
        [188.0, 46.0, 48.0]
    } else if !(0.70..=0.92).contains(&share) {
        [120.0, 26.0, 36.0]
    } else {
        [232.0, 172.0, 60.0]
    };
    scaled(base, weave)
}

#[inline]
fn denim(p: [f32; 3]) -> Colour {
    let thread = grain(cell(p[0] + p[1], 260.0), cell(p[1] - p[0], 90.0));
    let fold = 1.0 + 0.04 * wobble(p[1] * 11.0 + 3.0 * p[0]);
    scaled([48.0, 66.0, 124.0], (0.82 + 0.32 * thread) * fold)
}

#[inline]
fn shoe(p: [f32; 3]) -> Colour {
    if p[2] > 0.024 {
        [214.0, 206.0, 190.0]
    } else {
        scaled([70.0, 34.0, 30.0], 0.9 + 0.2 * grain(cell(p[0], 120.0), cell(p[1], 120.0)))
    }
}

/// Corrugated board with tape over the top and a label on the front and the back.
#[inline]
fn cardboard(p: [f32; 3]) -> Colour {
    let flute = 0.95 + 0.06 * grain(cell(p[0], 70.0), cell(p[2], 70.0)) + 0.03 * wobble(p[0] * 120.0);
    let label = p[0] > 0.03 && p[0] < 0.20 && p[1] > -0.08 && p[1] < 0.07;
    if p[0].abs() < 0.03 && p[1].abs() > 0.10 {
        [214.0, 182.0, 122.0]
    } else if label && p[2].abs() > 0.195 {
        let print = cell(p[1], 60.0) % 2 == 0 && p[0] < 0.18 && p[0] > 0.05;
        if print { [60.0, 84.0, 150.0] } else { [226.0, 214.0, 170.0] }
    } else {
        scaled([196.0, 146.0, 92.0], flute)
    }
}
