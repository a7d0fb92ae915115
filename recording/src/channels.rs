//! The channels of a recording.

use std::borrow::Cow;

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
    /// Steps.
    Step,
    /// The bodies.
    Scene,
    /// Their poses.
    Bodies,
    /// Samples inside the hull.
    Touches,
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
        let of_run = [Channel::Step, Channel::Scene, Channel::Bodies, Channel::Touches, Channel::Figures];
        [Channel::Header].into_iter().chain(of_cameras).chain(of_run).chain([Channel::End])
    }

    /// Its topic; `names` are the cameras'.
    pub fn topic(self, names: &[String]) -> Cow<'static, str> {
        Cow::Borrowed(match self {
            Channel::Header => "/header",
            Channel::Silhouette(camera) => return format!("/camera/{}/silhouette", names[camera]).into(),
            Channel::Colour(camera) => return format!("/camera/{}/colour", names[camera]).into(),
            Channel::Step => "/step",
            Channel::Scene => "/scene",
            Channel::Bodies => "/bodies",
            Channel::Touches => "/touches",
            Channel::Figures => "/figures",
            Channel::End => "/end",
        })
    }

    /// The full name of its messages.
    pub fn schema(self) -> String {
        let message = match self {
            Channel::Header => "Header",
            Channel::Silhouette(_) => "Silhouette",
            Channel::Colour(_) => "Colour",
            Channel::Step => "Step",
            Channel::Scene => "Scene",
            Channel::Bodies => "Bodies",
            Channel::Touches => "Touches",
            Channel::Figures => "Figures",
            Channel::End => "End",
        };
        format!("{PACKAGE}.{message}")
    }
}
