//! The channels of a recording.

/// Messages of every channel belong to this package.
const PACKAGE: &str = "hulltouch.recording.v1";

/// A channel. Cameras count in rig order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channel {
    /// Everything that a run needs besides its film.
    Header,
    /// Silhouettes of a camera.
    Silhouette(usize),
    /// Colour of a camera.
    Colour(usize),
    /// The world after each step.
    Step,
    /// The bodies.
    Scene,
    /// Their poses.
    Bodies,
    /// Samples inside the hull.
    Touches,
    /// The hull's surface at the bodies.
    Patches,
    /// The run's figures.
    Figures,
    /// The end.
    End,
}

impl Channel {
    /// All channels of a rig.
    pub fn all(cameras: usize) -> impl Iterator<Item = Channel> {
        let of_cameras =
            (0..cameras).flat_map(|camera| [Channel::Silhouette(camera), Channel::Colour(camera)]);
        let of_bodies = [Channel::Scene, Channel::Bodies, Channel::Touches, Channel::Patches];
        let of_run = [Channel::Step].into_iter().chain(of_bodies).chain([Channel::Figures]);
        [Channel::Header].into_iter().chain(of_cameras).chain(of_run).chain([Channel::End])
    }

    /// Its topic; `names` are the cameras'.
    pub fn topic(self, names: &[String]) -> String {
        let name = self.message().to_ascii_lowercase();
        match self {
            Channel::Silhouette(camera) | Channel::Colour(camera) => {
                format!("/camera/{}/{name}", names[camera])
            }
            _ => format!("/{name}"),
        }
    }

    /// The full name of its messages.
    pub fn schema(self) -> String {
        format!("{PACKAGE}.{}", self.message())
    }

    fn message(self) -> &'static str {
        match self {
            Channel::Header => "Header",
            Channel::Silhouette(_) => "Silhouette",
            Channel::Colour(_) => "Colour",
            Channel::Step => "Step",
            Channel::Scene => "Scene",
            Channel::Bodies => "Bodies",
            Channel::Touches => "Touches",
            Channel::Patches => "Patches",
            Channel::Figures => "Figures",
            Channel::End => "End",
        }
    }
}
