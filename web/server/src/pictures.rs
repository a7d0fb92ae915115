//! Where pictures come from: silhouettes and colours of a frame, made where it is filmed, and only on request.

use std::sync::Arc;

use coordinator::BoxError;
use futures::future::BoxFuture;
use node_client::NodePictures;
use proto::{FramePictures, PictureRequest};
use thiserror::Error;

/// JPEG quality of all pictures: eight cameras of 640 × 480 stay within 15 Mbit/s at 30 frames/s.
pub const JPEG_QUALITY: u8 = 80;

/// Why there are no pictures of a frame; one line.
#[derive(Clone, Debug, Error)]
#[error("{0}")]
pub struct PicturesError(Arc<dyn std::error::Error + Send + Sync>);

impl From<BoxError> for PicturesError {
    fn from(error: BoxError) -> PicturesError {
        PicturesError(error.into())
    }
}

/// Makes pictures.
pub trait Pictures: Send + Sync {
    /// The pictures of a frame. Takes half a second at most; of the newest frame, where cameras have to agree on
    /// one, twice that.
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, BoxError>>;
}

impl Pictures for NodePictures {
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, BoxError>> {
        let nodes = self.clone();
        Box::pin(async move { Ok(NodePictures::fetch(&nodes, request).await?) })
    }
}
