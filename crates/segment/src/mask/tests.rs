//! Masks as programs write them, and images that are none.

use super::*;

/// A grey image drawn by a function of column and row.
fn drawn(width: u32, height: u32, value: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    (0..height)
        .flat_map(|row| (0..width).map(move |column| (column, row)))
        .map(|(x, y)| value(x, y))
        .collect()
}

fn image(width: u32, channels: Channels, samples: Samples<'_>) -> MaskImage<'_> {
    let count = match samples {
        Samples::Bytes(bytes) => bytes.len(),
        Samples::Words(words) => words.len(),
    };
    let height = (count / channels.count() / width as usize) as u32;
    MaskImage { width, height, channels, samples, is_lossy: false }
}

fn read_one(image: &MaskImage<'_>, mask: &mut Vec<u8>) -> Result<(), MaskError> {
    MaskFilm::default().read(image, mask)
}

fn read_bytes(width: u32, channels: Channels, bytes: &[u8]) -> Result<Vec<u8>, MaskError> {
    let mut mask = vec![9; 3];
    read_one(&image(width, channels, Samples::Bytes(bytes)), &mut mask).map(|()| mask)
}

fn read_greys(width: u32, bytes: &[u8]) -> Result<Vec<u8>, MaskError> {
    read_bytes(width, Channels::Grey, bytes)
}

fn read_jpeg(width: u32, bytes: &[u8]) -> Result<Vec<u8>, MaskError> {
    let mut mask = Vec::new();
    let image = MaskImage { is_lossy: true, ..image(width, Channels::Grey, Samples::Bytes(bytes)) };
    read_one(&image, &mut mask).map(|()| mask)
}

fn distance((x, y): (u32, u32), (centre_x, centre_y): (f64, f64)) -> f64 {
    let (right, down) = (f64::from(x) - centre_x, f64::from(y) - centre_y);
    (right * right + down * down).sqrt()
}

/// Pixels of a disc's three rings: inside, border, outside.
fn rings(inside: u8, border: u8, outside: u8) -> Vec<u8> {
    drawn(64, 48, |x, y| match distance((x, y), (32.0, 24.0)) {
        away if away < 12.0 => inside,
        away if away < 16.0 => border,
        _ => outside,
    })
}

/// A disc whose edge is a slope so many pixels wide, from `low` to `high`.
fn soft_disc(slope_px: f64, low: f64, high: f64) -> Vec<u8> {
    drawn(64, 48, |x, y| {
        let away = distance((x, y), (32.0, 24.0));
        (low + (high - low) * (0.5 + (12.0 - away) / slope_px).clamp(0.0, 1.0)).round() as u8
    })
}

/// Means of five by five pixels.
fn blur(width: u32, values: &[u8]) -> Vec<u8> {
    let height = values.len() as u32 / width;
    drawn(width, height, |x, y| {
        let near = |at: u32, size: u32| at.saturating_sub(2)..(at + 3).min(size);
        let window = near(y, height).flat_map(|row| near(x, width).map(move |column| row * width + column));
        let (sum, count) =
            window.fold((0, 0), |(sum, count), at| (sum + u32::from(values[at as usize]), count + 1));
        (sum / count) as u8
    })
}

fn over_half(values: &[u8]) -> Vec<u8> {
    values.iter().map(|&value| u8::from(value > 127)).collect()
}

/// The colour samples of pixels that a palette names.
fn painted<const N: usize>(indices: &[u8], palette: &[[u8; N]]) -> Vec<u8> {
    indices.iter().flat_map(|&index| palette[usize::from(index)]).collect()
}

#[track_caller]
fn refused(outcome: Result<Vec<u8>, MaskError>, message: &str) {
    let error = outcome.expect_err("refused").to_string();
    assert!(error.contains(message) && !error.contains('\n'), "{error}");
}

#[test]
fn of_two_greys_one_of_which_is_0_the_other_is_foreground() {
    for other in [1, 2, 7, 85, 127, 128, 254, 255] {
        assert_eq!(read_greys(2, &[0, other, other, 0]), Ok(vec![0, 1, 1, 0]), "{other}");
    }
    for other in [1u16, 7, 255, 256, 32_768, 65_535] {
        let (words, mut mask) = ([0, other, other, 0], Vec::new());
        read_one(&image(2, Channels::Grey, Samples::Words(&words)), &mut mask).expect("a mask");
        assert_eq!(mask, [0, 1, 1, 0], "{other}");
    }
}

#[test]
fn of_two_greys_on_both_sides_of_half_the_brighter_is_foreground_and_others_are_refused() {
    assert_eq!(read_greys(2, &[127, 128]), Ok(vec![0, 1]));
    assert_eq!(read_greys(2, &[235, 16]), Ok(vec![1, 0]));
    refused(
        read_greys(2, &[1, 2]),
        "found the grey values 1, 2, all of them up to half (127); expected 0 and",
    );
    refused(read_greys(2, &[200, 255]), "found the grey values 200, 255, all of them over half (127)");
    refused(read_greys(3, &[0, 1, 2]), "found the grey values 0, 1, 2, all of them up to half (127)");
    let words = [0u16, 11, 13, 255];
    let error = read_one(&image(4, Channels::Grey, Samples::Words(&words)), &mut Vec::new());
    refused(error.map(|()| vec![]), "found the grey values 0, 11, 13, 255, all of them up to half (32767)");
}

#[test]
fn an_image_of_one_value_is_background_at_0_and_foreground_at_the_largest_alone() {
    assert_eq!(read_greys(2, &[0; 4]), Ok(vec![0; 4]));
    assert_eq!(read_greys(2, &[255; 4]), Ok(vec![1; 4]));
    for value in [1, 7, 16, 127, 128, 200, 254] {
        refused(read_greys(2, &[value; 4]), &format!("found the grey value {value} in every pixel"));
    }
    let mut mask = Vec::new();
    read_one(&image(2, Channels::Grey, Samples::Words(&[65_535; 4])), &mut mask).expect("a mask");
    assert_eq!(mask, [1; 4]);
    let error = read_one(&image(2, Channels::Grey, Samples::Words(&[255; 4])), &mut mask);
    refused(error.map(|()| vec![]), "found the grey value 255 in every pixel");
}

#[test]
fn flat_regions_of_three_greys_are_labels() {
    for (inside, border, outside) in
        [(15, 255, 0), (255, 128, 0), (128, 255, 0), (7, 255, 11), (1, 255, 0), (0, 64, 255), (150, 220, 0)]
    {
        refused(read_greys(64, &rings(inside, border, outside)), "as class labels and trimaps have");
    }
    let ids = drawn(64, 48, |x, y| if y < 3 { 255 } else { (x / 8 + y / 12) as u8 });
    refused(read_greys(64, &ids), "(0, 1, 2, 3, 4, 5 and others), as class labels");
    // A trimap whose bands have soft edges.
    let slope = |x: u32, from: u32, most: u32| (x.saturating_sub(from) * 32).min(most);
    let soft = drawn(64, 48, |x, _| (slope(x, 24, 128) + slope(x, 36, 127)) as u8);
    refused(read_greys(64, &soft), "as class labels and trimaps have");
    refused(read_jpeg(64, &rings(255, 128, 0)), "as class labels and trimaps have");
    // The same, made smaller and larger again: the border of 255 lies on slopes.
    let blurred = blur(64, &rings(15, 255, 0));
    refused(read_greys(64, &blurred), "as class labels and trimaps have");
    // Many labels on both sides of half, each of them small.
    let many = drawn(64, 48, |x, y| match (x / 6, y / 6) {
        (column @ 1..6, row @ 1..3) => {
            [20, 60, 100, 120, 40, 140, 160, 200, 220, 240][(column * 2 + row - 3) as usize]
        }
        _ => {
            if x < 40 {
                0
            } else {
                255
            }
        }
    });
    refused(read_greys(64, &many), "as class labels and trimaps have");
    // Few pixels are labels, too.
    refused(
        read_greys(8, &drawn(8, 6, |x, _| [0, 0, 0, 128, 128, 255, 255, 255][x as usize])),
        "(0, 128, 255)",
    );
}

#[test]
fn shadows_of_background_subtraction_are_background() {
    let shadow = rings(255, 127, 0);
    assert_eq!(read_greys(64, &shadow), Ok(over_half(&shadow)));
    let colours: Vec<u8> = shadow.iter().flat_map(|&grey| [grey; 3]).collect();
    assert_eq!(read_bytes(64, Channels::Rgb, &colours), Ok(over_half(&shadow)));
    let transparent: Vec<u8> = shadow.iter().flat_map(|&alpha| [0, alpha]).collect();
    refused(read_bytes(64, Channels::GreyAlpha, &transparent), "alpha: found flat regions");
    refused(read_greys(64, &rings(255, 126, 0)), "as class labels and trimaps have");
}

#[test]
fn soft_edges_mattes_and_noise_of_video_are_masks_by_half() {
    for slope_px in [1.0, 1.5, 4.0, 12.0] {
        for (low, high) in [(0.0, 255.0), (16.0, 235.0), (4.0, 250.0)] {
            let disc = soft_disc(slope_px, low, high);
            assert_eq!(read_greys(64, &disc), Ok(over_half(&disc)), "{slope_px} px, {low} to {high}");
            assert_eq!(read_jpeg(64, &disc), Ok(over_half(&disc)), "{slope_px} px, {low} to {high}");
        }
    }
    // What is left of JPEG in a lossless copy: ringing about an edge, farther from the extremes than their noise.
    let ringing = drawn(64, 48, |x, _| match x {
        0..24 => 0,
        24..32 => [0, 12, 1, 9, 0, 5, 14, 2][x as usize - 24],
        32..40 => [243, 255, 250, 254, 246, 255, 253, 255][x as usize - 32],
        _ => 255,
    });
    assert_eq!(read_greys(64, &ringing), Ok(over_half(&ringing)));
    // Two by two samples a pixel.
    let coverage = drawn(64, 48, |x, y| {
        let inside = |x: u32, y: u32| distance((x, y), (63.3, 47.1)) < 30.0;
        let corners = [(0, 0), (0, 1), (1, 0), (1, 1)];
        corners.iter().map(|(right, down)| if inside(2 * x + right, 2 * y + down) { 63 } else { 0 }).sum()
    });
    assert_eq!(read_greys(64, &coverage), Ok(over_half(&coverage)));
    // Every pixel twice across and down.
    let steps = drawn(128, 96, |x, y| soft_disc(6.0, 0.0, 255.0)[(y / 2 * 64 + x / 2) as usize] / 17 * 17);
    assert_eq!(read_greys(128, &steps), Ok(over_half(&steps)));
    // What is near the extremes is noise, in blocks or not.
    let noisy = drawn(64, 48, |x, y| {
        let noise = ((x / 8 * 7 + y / 8 * 5) % 4) as u8;
        if x < 24 { 255 - noise } else { noise }
    });
    assert_eq!(read_greys(64, &noisy), Ok(over_half(&noisy)));
    assert_eq!(read_jpeg(64, &noisy), Ok(over_half(&noisy)));
}

#[test]
fn a_lossy_image_has_no_labels() {
    refused(read_jpeg(4, &[0, 1, 1, 0]), "all of them up to half");
    refused(read_jpeg(4, &[0, 100, 100, 0]), "all of them up to half");
    assert_eq!(read_jpeg(4, &[0, 255, 255, 0]), Ok(vec![0, 1, 1, 0]));
    assert_eq!(read_jpeg(4, &[0; 4]), Ok(vec![0; 4]));
}

#[test]
fn a_picture_is_no_mask() {
    let picture = drawn(64, 48, |x, y| (60 + (x * 13 + y * 31 + x * y) % 150) as u8);
    refused(read_greys(64, &picture), "found a picture: ");
    refused(read_jpeg(64, &picture), "found a picture: ");
    // A dark person before a bright wall, with some noise.
    let person = soft_disc(3.0, 200.0, 60.0);
    let person: Vec<u8> = (0..).zip(&person).map(|(at, &grey)| grey + (at * 7 % 5) as u8).collect();
    for outcome in [read_greys(64, &person), read_jpeg(64, &person)] {
        refused(outcome, "found a picture: most of its pixels are near ");
    }
    let colours = drawn(64 * 3, 48, |x, y| ((x * 7) ^ (y * 13)) as u8);
    refused(read_bytes(64, Channels::Rgb, &colours), "found the colours #00070e, ");
}

#[test]
fn black_and_one_other_colour_is_a_mask_and_three_colours_are_none() {
    let indices: Vec<u8> = rings(1, 1, 0);
    for other in [[128, 0, 0], [0, 0, 1], [192, 128, 128], [255, 255, 255], [1, 1, 1]] {
        let image = painted(&indices, &[[0; 3], other]);
        assert_eq!(read_bytes(64, Channels::Rgb, &image), Ok(indices.clone()), "{other:?}");
    }
    let voc = painted(&rings(1, 2, 0), &[[0; 3], [192, 128, 128], [224, 224, 192]]);
    refused(
        read_bytes(64, Channels::Rgb, &voc),
        "#000000, #e0e0c0, #c08080; expected black and one other colour",
    );
    let two = painted(&indices, &[[255, 0, 0], [0, 0, 255]]);
    refused(read_bytes(64, Channels::Rgb, &two), "found the colours #ff0000, #0000ff");
    refused(
        read_bytes(64, Channels::Rgb, &painted(&[0; 64], &[[200, 0, 0]])),
        "found the colour #c80000 in every",
    );
    let greys = painted(&rings(1, 2, 0), &[[0; 3], [15; 3], [255; 3]]);
    refused(read_bytes(64, Channels::Rgb, &greys), "(0, 15, 255), as class labels");
    let deep: Vec<u16> = indices.iter().flat_map(|&index| [u16::from(index) * 300, 0, 0]).collect();
    let mut mask = Vec::new();
    read_one(&image(64, Channels::Rgb, Samples::Words(&deep)), &mut mask).expect("a mask");
    assert_eq!(mask, indices);
}

#[test]
fn nearly_grey_colours_of_video_are_greys() {
    let disc = soft_disc(12.0, 3.0, 250.0);
    let tinted: Vec<u8> = disc.iter().flat_map(|&grey| [grey, grey - 1, grey + 2]).collect();
    assert_eq!(read_bytes(64, Channels::Rgb, &tinted), Ok(over_half(&disc)));
}

#[test]
fn white_with_noise_is_foreground_in_greys_and_in_colours() {
    let all = drawn(64, 48, |x, y| if (x * 7 + y) % 3 == 0 { 254 } else { 255 });
    assert_eq!(read_greys(64, &all), Ok(vec![1; 64 * 48]));
    assert_eq!(read_jpeg(64, &all), Ok(vec![1; 64 * 48]));
    refused(read_greys(64, &rings(240, 255, 255)), "found the grey values 240, 255, all of them over half");
    let inside = rings(1, 1, 0);
    let pixel = |(index, &inside): (usize, &u8)| {
        [index % 2, index / 2 % 2, index / 4 % 2].map(|bit| inside * (255 - bit as u8))
    };
    let white: Vec<u8> = inside.iter().enumerate().flat_map(pixel).collect();
    assert_eq!(read_bytes(64, Channels::Rgb, &white), Ok(inside.clone()));
    let classes = painted(&rings(1, 2, 0), &[[0; 3], [1, 0, 0], [0, 0, 1]]);
    refused(read_bytes(64, Channels::Rgb, &classes), "found the colours ");
    let tinted = painted(&rings(1, 2, 0), &[[0; 3], [255; 3], [255, 250, 249]]);
    refused(read_bytes(64, Channels::Rgb, &tinted), "found the colours ");
}

#[test]
fn alpha_that_is_not_constant_is_the_mask() {
    let inside = rings(1, 1, 0);
    let cut_out = |colour: fn(usize) -> [u8; 3], outside: [u8; 3]| -> Vec<u8> {
        let pixel = |(index, &inside): (usize, &u8)| match (inside, colour(index), outside) {
            (0, _, [red, green, blue]) => [red, green, blue, 0],
            (_, [red, green, blue], _) => [red, green, blue, 255],
        };
        inside.iter().enumerate().flat_map(pixel).collect()
    };
    let picture = |index: usize| [(index * 7) as u8, (index * 3) as u8, 9];
    let images = [
        cut_out(|_| [0; 3], [0; 3]),
        cut_out(|_| [255; 3], [255; 3]),
        cut_out(|_| [255; 3], [0; 3]),
        cut_out(|_| [0; 3], [255; 3]),
        cut_out(picture, [0; 3]),
        cut_out(picture, [90, 1, 255]),
        cut_out(|index| [(index % 40) as u8; 3], [255; 3]),
    ];
    for (number, image) in images.iter().enumerate() {
        assert_eq!(read_bytes(64, Channels::Rgba, image), Ok(inside.clone()), "image {number}");
    }
    let soft = soft_disc(4.0, 0.0, 255.0);
    for colour in [0, 255] {
        let pixels: Vec<u8> = soft.iter().flat_map(|&alpha| [colour, alpha]).collect();
        assert_eq!(read_bytes(64, Channels::GreyAlpha, &pixels), Ok(over_half(&soft)));
        let words: Vec<u16> = pixels.iter().map(|&value| u16::from(value) * 257).collect();
        let mut mask = Vec::new();
        read_one(&image(64, Channels::GreyAlpha, Samples::Words(&words)), &mut mask).expect("reads");
        assert_eq!(mask, over_half(&soft));
    }
    // Colours that were multiplied with alpha say the same.
    let multiplied: Vec<u8> = soft.iter().flat_map(|&alpha| [alpha, alpha, alpha, alpha]).collect();
    assert_eq!(read_bytes(64, Channels::Rgba, &multiplied), Ok(over_half(&soft)));
    let labels: Vec<u8> = rings(255, 128, 0).iter().flat_map(|&alpha| [0, alpha]).collect();
    refused(read_bytes(64, Channels::GreyAlpha, &labels), "alpha: found flat regions");
}

#[test]
fn constant_alpha_leaves_the_mask_to_the_colours() {
    for alpha in [255, 128, 1] {
        assert_eq!(read_bytes(2, Channels::GreyAlpha, &[0, alpha, 7, alpha]), Ok(vec![0, 1]));
        assert_eq!(read_bytes(2, Channels::Rgba, &[0, 0, 0, alpha, 9, 0, 0, alpha]), Ok(vec![0, 1]));
    }
    assert_eq!(read_bytes(2, Channels::Rgba, &[255, 255, 255, 0, 255, 255, 255, 0]), Ok(vec![0, 0]));
    assert_eq!(read_bytes(2, Channels::GreyAlpha, &[0; 4]), Ok(vec![0, 0]));
    refused(read_bytes(2, Channels::GreyAlpha, &[0, 0, 255, 0]), "alpha 0 in every pixel");
}

#[test]
fn colours_and_alpha_that_are_two_masks_are_refused() {
    let of_colours = rings(255, 0, 0);
    let of_alpha = drawn(64, 48, |x, _| if x < 40 { 255 } else { 0 });
    let both = |colours: &[u8]| -> Vec<u8> {
        colours.iter().zip(&of_alpha).flat_map(|(&colour, &alpha)| [colour, alpha]).collect()
    };
    refused(read_bytes(64, Channels::GreyAlpha, &both(&of_colours)), "expected one mask");
    refused(read_bytes(64, Channels::GreyAlpha, &both(&soft_disc(2.0, 0.0, 255.0))), "expected one mask");
}

#[test]
fn alpha_that_clears_a_part_of_a_mask_or_of_labels_contradicts_it() {
    let with_alpha = |colours: &[[u8; 3]], alpha: &[u8]| -> Vec<u8> {
        let pixels = colours.iter().zip(alpha);
        pixels.flat_map(|([red, green, blue], &alpha)| [*red, *green, *blue, alpha]).collect()
    };
    let greys = |values: Vec<u8>| -> Vec<[u8; 3]> { values.into_iter().map(|grey| [grey; 3]).collect() };
    let corner = |opaque: u8| drawn(64, 48, |x, y| if x < 4 && y < 4 { 0 } else { opaque });
    let border = drawn(64, 48, |x, y| if (2..62).contains(&x) && (2..46).contains(&y) { 255 } else { 0 });
    let void = rings(255, 0, 255);
    let classes = |palette: [[u8; 3]; 3]| -> Vec<[u8; 3]> {
        drawn(64, 48, |x, y| match distance((x, y), (32.0, 24.0)) {
            away if away < 14.0 => 1,
            _ => {
                if x < 8 {
                    2
                } else {
                    0
                }
            }
        })
        .into_iter()
        .map(|class| palette[usize::from(class)])
        .collect()
    };
    for (name, image) in [
        ("mask, alpha 254", with_alpha(&greys(rings(255, 255, 0)), &corner(254))),
        ("soft mask", with_alpha(&greys(soft_disc(9.0, 0.0, 255.0)), &border)),
        ("noisy mask", with_alpha(&greys(rings(252, 254, 3)), &border)),
        ("classes", with_alpha(&classes([[0; 3], [192, 128, 128], [128, 0, 0]]), &void)),
        ("grey classes", with_alpha(&classes([[0; 3], [15; 3], [7; 3]]), &void)),
    ] {
        let outcome = read_bytes(64, Channels::Rgba, &image);
        refused(
            outcome.map_err(|error| {
                assert_eq!(error, MaskError::TwoMasks, "{name}");
                error
            }),
            "expected one mask",
        );
    }
    // A flat drawing in colours with black lines is cut out; alpha that is nearly opaque says nothing.
    let inside = rings(1, 1, 0);
    let drawing: Vec<[u8; 3]> = drawn(64, 48, |x, y| u8::from(x == 32) + 2 * u8::from(y > 24))
        .into_iter()
        .map(|class| [[200, 10, 10], [0; 3], [10, 10, 200], [0; 3]][usize::from(class)])
        .collect();
    let cut_out = with_alpha(&drawing, &inside.iter().map(|&inside| 255 * inside).collect::<Vec<_>>());
    assert_eq!(read_bytes(64, Channels::Rgba, &cut_out), Ok(inside.clone()));
    let rounded = drawn(64, 48, |x, _| if x % 7 == 0 { 254 } else { 255 });
    let nearly_opaque = with_alpha(&greys(rings(255, 255, 0)), &rounded);
    assert_eq!(read_bytes(64, Channels::Rgba, &nearly_opaque), Ok(inside));
}

#[test]
fn foreground_of_a_film_is_the_same_in_all_masks() {
    let read_film = |masks: &[&[u8]]| -> Result<Vec<u8>, MaskError> {
        let (mut film, mut mask) = (MaskFilm::default(), Vec::new());
        for bytes in masks {
            film.read(&image(64, Channels::Grey, Samples::Bytes(bytes)), &mut mask)?;
        }
        Ok(mask)
    };
    let inside = rings(1, 1, 0);
    let (white, one, fifteen, empty) =
        (rings(255, 255, 0), rings(1, 1, 0), rings(15, 15, 0), vec![0; 64 * 48]);
    assert_eq!(read_film(&[&empty, &one, &empty, &one]), Ok(inside.clone()));
    assert_eq!(read_film(&[&empty, &white, &rings(254, 254, 0)]), Ok(inside));
    for (first, then, message) in [
        (&white, &one, "found the grey value 1 as foreground, and values over half in the masks before"),
        (&one, &white, "found values over half as foreground, and the grey value 1 in the masks before"),
        (&one, &fifteen, "found the grey value 15 as foreground, and the grey value 1 in"),
        (&white, &rings(1, 2, 0), "found the grey values 0, 1, 2, all of them up to half"),
    ] {
        refused(read_film(&[first, then]), message);
    }
    // Noise, a shadow, and a soft edge that only begins.
    let noise = |levels: u32| drawn(64, 48, |x, y| ((x * 31 + y * 17 + x * y * 7) % 29 % levels) as u8);
    let edge = drawn(64, 48, |x, _| [0, 3, 10, 40][x.saturating_sub(60) as usize]);
    for empty_mask in [noise(2), noise(3), rings(127, 127, 0), edge] {
        assert_eq!(read_film(&[&white, &empty_mask]), Ok(empty.clone()));
    }
    refused(read_film(&[&noise(3)]), "all of them up to half");
    // A shadow or noise at the film's begin says nothing about what foreground is.
    for begin in [rings(127, 127, 0), noise(2)] {
        assert_eq!(read_film(&[&begin, &white]), Ok(over_half(&white)));
    }
    // What is foreground is known: an image full of it is no riddle.
    assert_eq!(read_film(&[&one, &[1; 64 * 48]]), Ok(vec![1; 64 * 48]));
    refused(read_film(&[&one, &[2; 64 * 48]]), "found the grey value 2 in every pixel");
}

/// A person of two parts before black: bright above, darker below, both with some texture.
fn clothed(bright: u8, dark: u8) -> Vec<u8> {
    drawn(160, 120, |x, y| {
        let texture = ((x * 31 + y * 17 + x * y * 7) % 13) as u8;
        match (x, y) {
            (60..100, 10..60) => bright - texture % 6,
            (60..100, 60..110) => dark + 2 * texture,
            _ => 0,
        }
    })
}

#[test]
fn a_person_cut_out_in_grey_is_no_mask() {
    for (bright, dark) in [(255, 40), (255, 90), (250, 180)] {
        refused(
            read_greys(160, &clothed(bright, dark)),
            "found a picture: pixels that are neither near 0 nor near",
        );
    }
    // A shadow of background subtraction with noise.
    let shadow = drawn(160, 120, |x, y| match (x, y) {
        (60..100, 10..100) => 255,
        (40..130, 100..118) => 124 + ((x * 31 + y * 17) % 7) as u8,
        _ => ((x * 7 + y * 3) % 4) as u8,
    });
    refused(read_greys(160, &shadow), "found flat regions");
}

#[test]
fn samples_of_another_size_are_refused() {
    refused(
        read_one(&MaskImage { height: 3, ..image(2, Channels::Grey, Samples::Bytes(&[0; 4])) }, &mut vec![])
            .map(|()| vec![]),
        "found 4 samples, expected 6",
    );
}
