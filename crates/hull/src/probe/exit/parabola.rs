//! The nearly parabolic image of a span.

/// A span's image: one coordinate by the other, through the ends and a place between.
pub(super) struct Parabola {
    /// Where it begins on the major axis, and how far it goes.
    pub from: f64,
    pub length: f64,
    beside: f64,
    slope: f64,
    curve: f64,
    /// The share of the span by the major coordinate.
    share_curve: f64,
    /// How far it may be away from the image, pixels.
    pub error: f64,
}

impl Parabola {
    /// Through the start, the middle and the end (major, minor) of a curve whose second and third derivative
    /// by its share keep to these bounds.
    #[inline(always)]
    pub fn through(places: [(f64, f64); 3], bend: f64, twist: f64) -> Parabola {
        let [(from, beside), (along, up), (length, height)] = places;
        let (along, up) = (along - from, up - beside);
        let (length, height) = (length - from, height - beside);
        let per_length = 1.0 / length;
        let slope = height * per_length;
        let per_bow = 1.0 / (along * (along - length));
        // With the slopes within a twentieth of their means, the third derivative of one coordinate by the
        // other is within 2.85 twists and 8.14 bends squared; a parabola misses by a 119th of that.
        let error = 0.024 * twist + 0.07 * bend * bend * per_length.abs() + 1e-9;
        Parabola {
            from,
            length,
            beside,
            slope,
            curve: (up - slope * along) * per_bow,
            share_curve: (0.5 - along * per_length) * per_bow,
            error,
        }
    }

    /// The minor coordinate so far along the major.
    #[inline(always)]
    pub fn beside(&self, along: f64) -> f64 {
        self.beside + along * (self.slope + self.curve * (along - self.length))
    }

    /// The share of the span so far along.
    #[inline(always)]
    pub fn share(&self, along: f64) -> f64 {
        along * (1.0 / self.length + self.share_curve * (along - self.length))
    }

    /// How many pixels past the first the image can enter in a share of the span; two more, for rounding.
    #[inline(always)]
    pub fn steps_until(&self, share: f64) -> i32 {
        // The length at most bends by an eighth of a tenth of itself.
        ((share + 0.0125) * self.length.abs()) as i32 + 2
    }

    /// How far along the major axis the image goes of its length, at least.
    #[inline(always)]
    pub fn shrink(&self, bend: f64) -> f64 {
        let bend = 0.5 * bend / self.length.abs();
        let slope = (self.slope.abs() + bend) / (1.0 - bend);
        1.0 / (1.0 + slope * slope).sqrt()
    }
}
