//! One axis of a chart in numbers: where values lie on it, its marks, and what they say.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use super::Axis;

/// Most marks on an axis.
const MARKS: usize = 8;

/// A range of values and how it is drawn.
#[derive(Clone, Debug)]
pub enum Scale {
    /// Equal steps are equally far.
    Linear(Range<f64>),
    /// Equal factors are equally far.
    Logarithmic(Range<f64>),
    /// Names, each over one unit from zero.
    Names(Vec<String>),
}

impl Scale {
    /// A scale that shows all values that it can.
    pub fn around(axis: &Axis, values: impl Iterator<Item = f64>) -> Scale {
        let shown = values.filter(|&value| value.is_finite() && (!axis.logarithmic || value > 0.0));
        let both = |range: Option<Range<f64>>, value: f64| {
            Some(range.map_or(value..value, |range| range.start.min(value)..range.end.max(value)))
        };
        let range = shown.fold(None, both);
        if axis.logarithmic {
            let range = range.unwrap_or(1.0..10.0);
            return Scale::Logarithmic(rounded_down(range.start * 0.999)..rounded_up(range.end * 1.001));
        }
        let range = range.unwrap_or(0.0..1.0);
        let start = range.start.min(0.0) * 1.05;
        Scale::Linear(start..(range.end * 1.05).max(start + f64::MIN_POSITIVE.max(start.abs() * 0.01) + 1e-9))
    }

    /// A scale of names.
    pub fn of_names(names: &[String]) -> Scale {
        Scale::Names(names.to_vec())
    }

    /// True if the value has a place on it.
    pub fn shows(&self, value: f64) -> bool {
        value.is_finite() && (value > 0.0 || !matches!(self, Scale::Logarithmic(_)))
    }

    /// Where bars begin.
    pub fn floor(&self) -> f64 {
        match self {
            Scale::Logarithmic(range) => range.start,
            _ => 0.0,
        }
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let range = self.range();
        let share = match self {
            Scale::Logarithmic(_) => libm::log(value / range.start) / libm::log(range.end / range.start),
            _ => (value - range.start) / (range.end - range.start),
        };
        limit.0 + (f64::from(limit.1 - limit.0) * share).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let most = hint.max_num_points().clamp(2, MARKS);
        match self {
            Scale::Names(names) => (0..names.len()).map(|index| index as f64 + 0.5).collect(),
            Scale::Linear(range) => {
                let step = rounded_up((range.end - range.start) / most as f64);
                let (first, last) = ((range.start / step).ceil() as i64, (range.end / step).floor() as i64);
                (first..=last).map(|index| index as f64 * step).collect()
            }
            Scale::Logarithmic(range) => {
                let mut marks: Vec<f64> = Vec::new();
                let mut mark = range.start;
                while mark <= range.end * 1.001 {
                    marks.push(mark);
                    mark = rounded_up(mark * 1.001);
                }
                let every = if marks.len() <= most + 2 { 1 } else { 3 };
                // Of 1, 2 and 5 the ones stay.
                let is_one = |mark: f64| (leading(mark) - 1.0).abs() < 1e-6;
                marks.retain(|&mark| every == 1 || is_one(mark));
                marks
            }
        }
    }

    fn range(&self) -> Range<f64> {
        match self {
            Scale::Linear(range) | Scale::Logarithmic(range) => range.clone(),
            Scale::Names(names) => 0.0..names.len().max(1) as f64,
        }
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        match self {
            Scale::Names(names) => names.get(*value as usize).cloned().unwrap_or_default(),
            _ => short(*value),
        }
    }
}

/// A number in few characters.
fn short(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if size >= 1e9 => (value / 1e9, " G"),
        size if size >= 1e6 => (value / 1e6, " M"),
        size if size >= 1e3 => (value / 1e3, " k"),
        _ => (value, ""),
    };
    let digits = format!("{scaled:.3}");
    let digits = if scaled.abs() < 0.01 && scaled != 0.0 { format!("{scaled:.0e}") } else { digits };
    let digits =
        if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { &digits };
    format!("{digits}{unit}")
}

fn decade(value: f64) -> f64 {
    libm::pow(10.0, libm::floor(libm::log10(value)))
}

fn leading(value: f64) -> f64 {
    value / decade(value * 1.000_001)
}

/// The greatest of 1, 2, 5 times a power of ten that is not above.
fn rounded_down(value: f64) -> f64 {
    let decade = decade(value);
    [5.0, 2.0].into_iter().map(|digit| digit * decade).find(|&round| round <= value).unwrap_or(decade)
}

/// The least of 1, 2, 5 times a power of ten that is not below.
fn rounded_up(value: f64) -> f64 {
    let decade = decade(value);
    let rounds = [1.0, 2.0, 5.0].into_iter().map(|digit| digit * decade);
    rounds.into_iter().find(|&round| round >= value).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::coord::ranged1d::BoldPoints;

    #[test]
    fn logarithmic_marks_are_one_two_five() {
        let scale = Scale::around(&Axis::logarithmic("x"), [3.0, 70.0, 0.0, -1.0].into_iter());
        assert_eq!(scale.range(), 2.0..100.0);
        assert_eq!(scale.key_points(BoldPoints(10)).len(), 6, "2 5 10 20 50 100");
        assert_eq!(scale.map(&2.0, (0, 100)), 0);
        assert_eq!(scale.map(&100.0, (0, 100)), 100);
    }

    #[test]
    fn a_linear_axis_holds_zero_and_one_value_is_enough() {
        let scale = Scale::around(&Axis::linear("x"), [7.0].into_iter());
        assert!(scale.range().start == 0.0 && scale.range().end > 7.0);
        let empty = Scale::around(&Axis::linear("x"), std::iter::empty());
        assert!(!empty.key_points(BoldPoints(10)).is_empty());
    }

    #[test]
    fn numbers_are_short() {
        let said = [0.0, 0.25, 1500.0, 2e6, 3.5e9, 1e-4].map(short);
        assert_eq!(said, ["0", "0.25", "1.5 k", "2 M", "3.5 G", "1e-4"]);
    }
}
