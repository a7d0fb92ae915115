//! Sizes of images on the command line.

/// `WxH` in pixels.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || format!("found {text:?}, expected WxH in pixels, like 640x480");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    Ok((width.parse().map_err(|_| wrong())?, height.parse().map_err(|_| wrong())?))
}
