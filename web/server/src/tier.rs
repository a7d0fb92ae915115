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
    const ALL: [Tier; 4] = [Tier::Full, Tier::Half, Tier::Quarter, Tier::Off];

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
        Tier::ALL.into_iter().find(|tier| tier.name() == name)
    }

    /// Both sides of a picture are divided by 2 to the power of this.
    pub fn scale_log2(self) -> u8 {
        match self {
            Tier::Full => 0,
            Tier::Half => 1,
            Tier::Quarter | Tier::Off => 2,
        }
    }

    /// The next smaller one, if there is one.
    pub fn less(self) -> Tier {
        Tier::ALL.into_iter().find(|&tier| tier > self).unwrap_or(self)
    }

    /// The next larger one, if there is one.
    pub fn more(self) -> Tier {
        Tier::ALL.into_iter().rfind(|&tier| tier < self).unwrap_or(self)
    }
}
