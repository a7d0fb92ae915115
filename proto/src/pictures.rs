//! Pictures for people to look at: silhouettes and colours of a frame.

use bytes::Bytes;

/// Both sides of a picture are divided by 2 to the power of this at most.
pub const MAX_SCALE_LOG2: u8 = 3;

/// What of a camera's image is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PictureKind {
    /// Its silhouette.
    Silhouettes,
    /// Its silhouette, and the colours around it.
    Crops,
    /// The whole image, without the silhouette.
    Whole,
}

/// A request for pictures of one frame.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PictureRequest {
    /// Which frame; `None`: the newest.
    pub frame: Option<u64>,
    /// What of it.
    pub kind: PictureKind,
    /// Both sides of the JPEG are divided by 2 to the power of this, 0 to [`MAX_SCALE_LOG2`].
    pub scale_log2: u8,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
    /// Places in the rig; empty: all cameras.
    pub cameras: Vec<u16>,
}

/// One camera's part of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraPicture {
    /// Its place in the rig.
    pub rig_index: u16,
    /// Its silhouette, whole image: the wire's RUNS. Empty if only the image was asked for.
    pub runs: Bytes,
    /// Both sides of the JPEG are divided by 2 to the power of this.
    pub scale_log2: u8,
    /// Left, top, width and height of what the JPEG shows, in the camera's own pixels.
    pub crop: [u16; 4],
    /// The colours; empty if there are none.
    pub jpeg: Bytes,
}

/// A picture and the frame that it is of.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The frame's number.
    pub frame: u64,
    /// When it was captured by the wall clock, unix seconds.
    pub captured_unix_s: f64,
    /// The camera's part.
    pub camera: CameraPicture,
}

/// A frame of as many cameras as have it.
#[derive(Clone, Debug, PartialEq)]
pub struct FramePictures {
    /// Its number.
    pub frame: u64,
    /// When it was captured, unix seconds.
    pub captured_unix_s: f64,
    /// In rig order.
    pub cameras: Vec<CameraPicture>,
}
