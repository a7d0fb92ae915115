//! What a text is, by its content.

use super::TextFile;

/// Names of a camera matrix, in lower case without `_` and `-`; the first is preferred.
pub(super) const MATRIX_NAMES: [&str; 7] =
    ["cameramatrix", "k", "m", "mtx", "intrinsicmatrix", "intrinsics", "intrinsic"];
/// Numbers that lens coefficients, a matrix with a missing number, or a few matrices in one file may hold.
const NEARLY: std::ops::RangeInclusive<usize> = 4..=48;

/// OpenCV FileStorage in XML or YAML, or the YAML of a ROS camera, which has the same form.
pub(super) fn is_storage(file: &TextFile) -> bool {
    let text = file.text.trim_start();
    text.contains("<opencv_storage")
        || text.starts_with("%YAML")
        || (text.contains("!!opencv-matrix") && !text.starts_with('{'))
        || text.lines().any(|line| line.starts_with("camera_matrix:"))
        || (is_yaml(&file.path)
            && text.lines().any(|line| !line.starts_with(char::is_whitespace) && begins_matrix(line)))
}

fn is_yaml(path: &str) -> bool {
    let path = path.to_ascii_lowercase();
    let plain = path.strip_suffix(".gz").unwrap_or(&path);
    plain.ends_with(".yml") || plain.ends_with(".yaml")
}

/// Whether a line begins the list of a camera matrix: `K: [500.0, …`, or `K:` with the list below.
fn begins_matrix(line: &str) -> bool {
    line.split_once(':').is_some_and(|(key, value)| {
        let value = value.trim();
        let name = key.trim().trim_matches(['"', '\'']).to_ascii_lowercase().replace(['_', '-'], "");
        (value.is_empty() || value.starts_with('[')) && MATRIX_NAMES.contains(&name.as_str())
    })
}

/// Twelve numbers, lines with `#` in front left out.
pub(super) fn is_matrix(text: &str) -> bool {
    counted(text, 13) == Some(12)
}

/// How many numbers a text of numbers alone holds, if they are almost a matrix.
pub(super) fn nearly_matrix(text: &str) -> Option<usize> {
    counted(text, NEARLY.end() + 1).filter(|count| NEARLY.contains(count) && *count != 12)
}

/// How many numbers a text of numbers alone holds, counted up to `most`.
fn counted(text: &str, most: usize) -> Option<usize> {
    let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    let mut words = lines.flat_map(matrix_words).take(most);
    words.try_fold(0, |count, word| word.parse::<f64>().is_ok().then_some(count + 1))
}

/// Whether a text holds twelve numbers and, beside these, brackets or a few words: `P = [1 2 3 4; …]`, a title line.
pub(super) fn is_dressed_matrix(text: &str) -> bool {
    const MOST_WORDS: usize = 24;
    let split = |c: char| c.is_whitespace() || "[](){},;=:\"'".contains(c);
    let words =
        text.lines().filter(|line| !line.trim_start().starts_with('#')).flat_map(|line| line.split(split));
    let (mut numbers, mut others) = (0, 0);
    for word in words.filter(|word| !word.is_empty()) {
        // Fortran's exponents, 1.0D+03, too.
        let is_number = word.replace(['D', 'd'], "e").parse::<f64>().is_ok();
        *(if is_number { &mut numbers } else { &mut others }) += 1;
        if numbers > 13 || others > MOST_WORDS {
            return false;
        }
    }
    // A title as "Camera 5" holds a number too.
    numbers == 12 || (numbers == 13 && others > 0)
}

/// Whether a text has the lines of a matrix, and a few words of them are no numbers as they are read: `1.#QNAN`, `0x10`.
/// The first such word.
pub(super) fn odd_word(text: &str) -> Option<&str> {
    const MOST_ODD: usize = 3;
    let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    let words = |line| matrix_words(line).take(13).collect::<Vec<&str>>();
    let lines: Vec<Vec<&str>> = lines.map(words).filter(|words| !words.is_empty()).take(4).collect();
    let counts: Vec<usize> = lines.iter().map(Vec::len).collect();
    let mut odd = lines.into_iter().flatten().filter(|word| word.parse::<f64>().is_err());
    let first = odd.next().filter(|_| counts == [4, 4, 4] || counts == [12])?;
    (odd.count() < MOST_ODD).then_some(first)
}

/// What stands between the blanks, commas and semicolons of a line.
fn matrix_words(line: &str) -> impl Iterator<Item = &str> {
    line.split([' ', '\t', ',', ';']).map(str::trim).filter(|word| !word.is_empty())
}

/// Whether a text may be a calibration, in whatever format.
pub(super) fn looks_like_calibration(text: &str) -> bool {
    text.trim_start().starts_with("%YAML") || names_camera(text)
}

/// Whether a text has the keys of a camera's calibration.
pub(super) fn names_camera(text: &str) -> bool {
    const WORDS: [&str; 13] = [
        "opencv_storage",
        "opencv-matrix",
        "camera_matrix",
        "cameramatrix",
        "distortion_coeff",
        "distcoeffs",
        "camera_model",
        "t_cn_cnm1",
        "<camera",
        "<k>",
        "<rvec",
        "rvec:",
        "intrinsics:",
    ];
    let lower = text.to_ascii_lowercase();
    WORDS.iter().any(|word| lower.contains(word)) || text.split(['{', ',', '\n']).any(begins_matrix)
}

/// Whether the keys of a camera stand in braces: JSON, or YAML in flow style.
pub(super) fn is_in_braces(text: &str) -> bool {
    text.trim_start().trim_start_matches("---").trim_start().starts_with('{')
        && text.split(['{', ',', '\n']).any(begins_matrix)
}

/// Whether a TOML text has the keys of a rig file.
pub(super) fn is_rig(text: &str) -> bool {
    let holds = |word| text.contains(word);
    holds("[cameras.") || holds("distortions") || (holds("matrix") && holds("translation"))
}

/// The camera chain of Kalibr, a YAML of its own.
pub(super) fn is_kalibr(text: &str) -> bool {
    text.lines().any(|line| line.starts_with("cam0:")) && text.contains("camera_model:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_numbers_are_a_matrix_and_nothing_else_is() {
        assert!(is_matrix("# P\n1 2 3 4\n5,6,7,8\r\n9 1e+002 0 -1\n"));
        assert!(!is_matrix("1 2 3 4 5 6 7 8 9 10 11"));
        assert!(!is_matrix("1 2 3 4 5 6 7 8 9 10 11 12 13"));
        assert!(!is_matrix("a b c d e f g h i j k l"));
        assert_eq!(nearly_matrix("1 2 3 4 5 6 7 8 9 10 11"), Some(11));
        assert_eq!(nearly_matrix("-0.28 0.09 0.0011 -0.0003 0.02"), Some(5));
        assert_eq!(nearly_matrix("640 480"), None);
        assert_eq!(nearly_matrix(&"1 ".repeat(1000)), None);
        for text in [
            "P=[1 2 3 4; 5 6 7 8; 9 10 11 12]",
            "[[1 2 3 4]\n[5 6 7 8]\n[9 1 2 3]]",
            "Camera 5\n1 2 3 4 5 6 7 8 9 1 2 3",
            "1.0D+03 2 3 4\n5 6 7 8\n9 1 2 3",
        ] {
            assert!(is_dressed_matrix(text) && !is_matrix(text), "{text}");
        }
        assert!(!is_dressed_matrix("taken on Monday") && !is_dressed_matrix("1 2 3"));
        for odd in ["1.#QNAN", "0x10", "1_0", "1+0i", "1.2.3", "1,5"] {
            let text = format!("1 2 3 4\n5 {odd} 7 8\n9 1 2 3\n");
            assert_eq!(odd_word(&text), (odd != "1,5").then_some(odd));
        }
        assert_eq!(odd_word("1 2 3 4\n5 6 7 8\n9 1 2 3\n"), None);
        assert_eq!(odd_word("a b c d\ne f g h\n1 2 3 4\n"), None);
    }

    #[test]
    fn storages_are_known_by_their_content() {
        let storage = |text: &str| is_storage(&TextFile { path: String::new(), text: text.to_owned() });
        assert!(storage("%YAML 1.2\n---\n") && storage("camera_matrix:\n  rows: 3\n"));
        assert!(!storage("services:\n  web: 1\n") && !storage("{ \"type_id\": \"!!opencv-matrix\" }"));
        for text in ["{\n  \"K\": [\n", "{D: [0, 0], K: [[1, 0, 0]]}", "--- {camera_matrix: [1]}"] {
            assert!(is_in_braces(text) && names_camera(text) && !storage(text), "{text}");
        }
        assert!(!is_in_braces("{\"services\": [1], \"unit\": 2}"));
        assert!(is_kalibr("cam0:\n  camera_model: pinhole\n"));
    }
}
