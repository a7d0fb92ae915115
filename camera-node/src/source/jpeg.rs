//! Whether a JPEG is whole: decoders make a picture also of a file that is cut off.

use std::io::{self, BufRead, Read as _};

const END_OF_IMAGE: u8 = 0xd9;

/// Reads the segments of a JPEG up to the marker of its end; `false` if the bytes end before it. A picture within a
/// segment (a preview in its tags) has no part in this.
pub(super) fn has_end(bytes: &mut impl BufRead) -> io::Result<bool> {
    while let Some(marker) = next_marker(bytes)? {
        match marker {
            END_OF_IMAGE => return Ok(true),
            // Start of the image, a stuffed byte of a scan, restarts: nothing belongs to them.
            0x00 | 0x01 | 0xd0..=0xd8 => {}
            _ => {
                let mut length = [0; 2];
                if bytes.read_exact(&mut length).is_err() {
                    return Ok(false);
                }
                // What follows a segment is searched for markers: a scan follows its head.
                let rest = u64::from(u16::from_be_bytes(length).saturating_sub(2));
                io::copy(&mut bytes.by_ref().take(rest), &mut io::sink())?;
            }
        }
    }
    Ok(false)
}

/// Passes over all bytes up to the next marker, and over it; `None` where there is none.
fn next_marker(bytes: &mut impl BufRead) -> io::Result<Option<u8>> {
    if bytes.skip_until(0xff)? == 0 {
        return Ok(None);
    }
    loop {
        let Some(&byte) = bytes.fill_buf()?.first() else { return Ok(None) };
        bytes.consume(1);
        // Any number of them may stand before a marker.
        if byte != 0xff {
            return Ok(Some(byte));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: [u8; 25] = [
        0xff, 0xd8, // the start
        0xff, 0xe1, 0, 6, 0xff, 0xd9, 0xff, 0xd8, // tags with the end of a preview
        0xff, 0xff, 0xda, 0, 3, 7, // the head of a scan, after a filler
        1, 0xff, 0x00, 2, 0xff, 0xd0, 3, // the scan, with a stuffed byte and a restart
        0xff, 0xd9,
    ];

    #[test]
    fn a_jpeg_that_is_cut_off_anywhere_has_no_end() {
        assert!(has_end(&mut &WHOLE[..]).expect("read"));
        let with_more = [&WHOLE[..], b"more"].concat();
        assert!(has_end(&mut &with_more[..]).expect("read"));
        for length in 0..WHOLE.len() {
            assert!(!has_end(&mut &WHOLE[..length]).expect("read"), "{length}");
        }
    }
}
