//! Many points as structure of arrays: what the probes' vector loops read.

use nalgebra::Point3;

/// Points of the world, metres, coordinate by coordinate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coordinates {
    /// All x.
    pub x: Vec<f64>,
    /// All y.
    pub y: Vec<f64>,
    /// All z.
    pub z: Vec<f64>,
}

impl Coordinates {
    /// How many points there are.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Forgets the points and keeps the memory.
    pub fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
    }

    /// The point at a place.
    #[inline(always)]
    pub fn point(&self, at: usize) -> Point3<f64> {
        Point3::new(self.x[at], self.y[at], self.z[at])
    }

    /// Appends a point.
    #[inline(always)]
    pub fn push(&mut self, point: Point3<f64>) {
        self.x.push(point.x);
        self.y.push(point.y);
        self.z.push(point.z);
    }

    /// Appends points given one after the other.
    #[inline(always)]
    pub fn extend(&mut self, points: impl ExactSizeIterator<Item = [f64; 3]>) {
        let first = self.len();
        let count = first + points.len();
        self.x.resize(count, 0.0);
        self.y.resize(count, 0.0);
        self.z.resize(count, 0.0);
        let places = self.x[first..].iter_mut().zip(&mut self.y[first..]).zip(&mut self.z[first..]);
        for (((x, y), z), point) in places.zip(points) {
            [*x, *y, *z] = point;
        }
    }
}

impl FromIterator<Point3<f64>> for Coordinates {
    fn from_iter<I: IntoIterator<Item = Point3<f64>>>(points: I) -> Coordinates {
        let mut coordinates = Coordinates::default();
        for point in points {
            coordinates.push(point);
        }
        coordinates
    }
}
