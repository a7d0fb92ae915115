//! The size of a page's colours.

/// The size of colours, the largest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Tier {
    Full,
    Half,
    Quarter,
    Off,
}

impl Tier {
    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Tier::Full => "full",
            Tier::Half => "half",
            Tier::Quarter => "quarter",
            Tier::Off => "off",
        }
    }

    pub fn from_name(name: &str) -> Option<Tier> {
        [Tier::Full, Tier::Half, Tier::Quarter, Tier::Off].into_iter().find(|tier| tier.name() == name)
    }

    /// Both sides of a picture are divided by 2 to the power of this.
    pub fn scale_log2(self) -> u8 {
        match self {
            Tier::Full => 0,
            Tier::Half => 1,
            Tier::Quarter | Tier::Off => 2,
        }
    }

    /// The next smaller one.
    pub fn less(self) -> Tier {
        match self {
            Tier::Full => Tier::Half,
            Tier::Half => Tier::Quarter,
            Tier::Quarter | Tier::Off => Tier::Off,
        }
    }

    /// The next larger one.
    pub fn more(self) -> Tier {
        match self {
            Tier::Off => Tier::Quarter,
            Tier::Quarter => Tier::Half,
            Tier::Half | Tier::Full => Tier::Full,
        }
    }
}
