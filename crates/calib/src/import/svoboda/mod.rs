//! Svoboda's MultiCamSelfCal (the paper's own calibration tool): a folder with `camera%d.Pmat.cal`,
//! perhaps `<base>%d.rad`, `camera_order.txt` and `Res.dat`.
//!
//! The K and R that the tool saves have flipped signs, so P alone is read. Each P's sign is chosen so
//! that the point all cameras look at lies in front; then its left 3×3 must have a positive
//! determinant, or the world is mirrored.

use hull::Camera;
use nalgebra::{Matrix3, Matrix3x4, Point3, Vector3};

use super::projection::{Parts, Placement, matrix_from, placed, taken_apart};
use super::refit::Chain;
use super::scan::plain_name;
use super::{
    ImportError, ImportOptions, Imported, TextFile, axes, from_origin, numbers, place, room, size_of,
};

/// MATLAB's point finder counts pixels from 1.
const MATLAB_ORIGIN: f64 = 1.0;
/// Refits worse than this give a warning, pixels.
const TOLD_PX: f64 = 0.1;

/// Reads the files of a MultiCamSelfCal folder (others among them are left alone).
pub fn from_svoboda(files: &[TextFile], options: &ImportOptions) -> Result<Imported, ImportError> {
    let mut found: Vec<(u32, &TextFile)> = files
        .iter()
        .filter_map(|file| number_before(&file.path, ".pmat.cal").map(|number| (number, file)))
        .collect();
    found.sort_by_key(|&(number, _)| number);
    if found.is_empty() {
        let file = files.first().map_or("no files".to_owned(), |file| file.path.clone());
        return Err(ImportError::Unknown { file, expected: "camera1.Pmat.cal and so on" });
    }
    if let Some(pair) = found.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let conflict = format!("two projection matrices of camera {}", pair[0].0);
        return Err(ImportError::conflict(
            &pair[0].1.path,
            &pair[1].1.path,
            conflict,
            "one file per camera: move one away",
        ));
    }
    let folder_of =
        |file: &TextFile| file.path.rsplit_once('/').map_or(String::new(), |(folder, _)| folder.to_owned());
    if let Some(other) = found.iter().find(|(_, file)| folder_of(file) != folder_of(found[0].1)) {
        let conflict = "projection matrices in two folders";
        return Err(ImportError::conflict(
            &found[0].1.path,
            &other.1.path,
            conflict,
            "those of one calibration: give its folder",
        ));
    }
    let unnumbered = files.iter().filter(|file| {
        plain_name(&file.path).ends_with(".pmat.cal") && number_before(&file.path, ".pmat.cal").is_none()
    });
    let mut warnings: Vec<String> = unnumbered
        .map(|file| format!("{}: left out, expected a number before .Pmat.cal", file.path))
        .collect();
    if options.pixel_origin.is_none() {
        warnings.push(
            "MultiCamSelfCal: top left pixel taken as (1, 1), MATLAB's; give the pixel origin 0 if the points \
             came from Python"
                .to_owned(),
        );
    }
    if options.scale.is_none() || options.up.is_none() {
        warnings.push(
            "MultiCamSelfCal: scale and axes are arbitrary unless the calibration was aligned: give the scale \
             and which axis is up"
                .to_owned(),
        );
    }
    let matrices = signed(&found)?;
    let folder = Folder { files, names: names(files, &found)?, sizes: sizes(files)? };
    folder.check_lenses(&found, &mut warnings)?;
    let mut cameras = Vec::new();
    for (rank, ((number, file), p)) in found.iter().zip(&matrices).enumerate() {
        let parts = taken_apart(&file.path, p)?;
        if parts.r.determinant() < 0.0 {
            let determinant = p.fixed_columns::<3>(0).determinant();
            let detail = format!("the left 3 x 3 of P has determinant {determinant:.3e}");
            return Err(ImportError::Mirrored { file: file.path.clone(), detail });
        }
        let size = size_of(&file.path, folder.size(*number, rank, found.len()), options, &mut warnings)?;
        let name = folder.name(*number);
        let placement = Placement { file: &file.path, key: "P", name: &name, size };
        cameras.push(folder.camera(&placement, *number, parts, options, &mut warnings)?);
    }
    axes::finished(place(files), cameras, 1.0, options, warnings)
}

/// The digits right before an ending in lower case: 12 for `camera12.Pmat.cal`.
fn number_before(path: &str, ending: &str) -> Option<u32> {
    let name = plain_name(path);
    let name = name.strip_suffix(ending)?;
    let digits = name.len() - name.bytes().rev().take_while(u8::is_ascii_digit).count();
    name[digits..].parse().ok()
}

fn named<'a>(files: &'a [TextFile], name: &str) -> Option<&'a TextFile> {
    files.iter().find(|file| plain_name(&file.path) == name)
}

/// `camera_order.txt`: a name per line, of camera 1 first. A list that ends before the last camera is an error.
fn names<'a>(files: &'a [TextFile], cameras: &[(u32, &TextFile)]) -> Result<Vec<&'a str>, ImportError> {
    let Some(order) = named(files, "camera_order.txt") else { return Ok(Vec::new()) };
    let lines = order.text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let names: Vec<&str> = lines.collect();
    let wrong =
        |found| Err(ImportError::key(&order.path, "names", found, "one name a line, for each camera"));
    if let Some(line) = names.iter().find(|line| line.split_whitespace().count() > 1) {
        return wrong(format!("{line:?}"));
    }
    match cameras.last() {
        Some(&(last, _)) if names.len() < last as usize => {
            wrong(format!("{} names, and camera {last}", names.len()))
        }
        _ => Ok(names),
    }
}

/// `Res.dat`: a width and a height per line.
fn sizes(files: &[TextFile]) -> Result<Vec<(u32, u32)>, ImportError> {
    let Some(file) = named(files, "res.dat") else { return Ok(Vec::new()) };
    let expected = "a width and a height in whole pixels per line";
    file.text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| match numbers(line).as_deref() {
            Ok(&[w, h]) if [w, h].iter().all(|s| s.fract() == 0.0 && (1.0..1e6).contains(s)) => {
                Ok((w as u32, h as u32))
            }
            _ => Err(ImportError::key(&file.path, "size", format!("{line:?}"), expected)),
        })
        .collect()
}

/// The projection matrices, each with the sign that puts the subject in front of the camera.
fn signed(found: &[(u32, &TextFile)]) -> Result<Vec<Matrix3x4<f64>>, ImportError> {
    let mut matrices = found.iter().map(|(_, file)| matrix_from(file)).collect::<Result<Vec<_>, _>>()?;
    let subject = matrices.iter().map(axis).collect::<Option<Vec<_>>>().and_then(|axes| room::subject(&axes));
    for p in &mut matrices {
        let depth = subject.map_or(1.0, |subject| (*p * subject.coords.push(1.0)).z);
        if depth < 0.0 {
            *p = -*p;
        }
    }
    Ok(matrices)
}

/// The place of a camera and its optical axis, whose sign is that of P.
fn axis(p: &Matrix3x4<f64>) -> Option<(Point3<f64>, Vector3<f64>)> {
    let centre = p.fixed_columns::<3>(0).try_inverse()? * -p.column(3);
    Some((Point3::from(centre), Vector3::new(p[(2, 0)], p[(2, 1)], p[(2, 2)]).normalize()))
}

/// What stands beside the projection matrices.
struct Folder<'a> {
    files: &'a [TextFile],
    /// Of camera 1 first; empty if there is no list of names.
    names: Vec<&'a str>,
    sizes: Vec<(u32, u32)>,
}

impl<'a> Folder<'a> {
    /// The name that `camera_order.txt` gives camera `number`.
    fn name(&self, number: u32) -> String {
        let name = (number as usize).checked_sub(1).and_then(|index| self.names.get(index));
        name.map_or_else(|| format!("camera{number}"), |&name| name.to_owned())
    }

    fn radials(&self, number: u32) -> impl Iterator<Item = &'a TextFile> {
        self.files.iter().filter(move |file| number_before(&file.path, ".rad") == Some(number))
    }

    /// A warning for the cameras without a `.rad`, where others have one; an error if there is one without a camera
    /// then: they may be counted from 0.
    fn check_lenses(
        &self,
        cameras: &[(u32, &TextFile)],
        warnings: &mut Vec<String>,
    ) -> Result<(), ImportError> {
        let (with, without): (Vec<u32>, Vec<u32>) = cameras
            .iter()
            .map(|&(number, _)| number)
            .partition(|&number| self.radials(number).next().is_some());
        if !with.is_empty() && !without.is_empty() {
            let is_of_none = |file: &&TextFile| {
                let number = number_before(&file.path, ".rad");
                number.is_some_and(|number| cameras.iter().all(|&(camera, _)| camera != number))
            };
            if let Some(lone) = self.files.iter().find(is_of_none) {
                let found = format!("the lens of no camera, and none of camera {}", without[0]);
                let expected =
                    "the numbers of the cameras' matrices: renumber the .rad files, or move those away";
                return Err(ImportError::key(&lone.path, "number", found, expected));
            }
            let without: Vec<String> = without.iter().map(|number| format!("camera {number}")).collect();
            warnings.push(format!(
                "MultiCamSelfCal: found no .rad of {}: lens coefficients taken as zero",
                without.join(", ")
            ));
        }
        Ok(())
    }

    /// By camera number, or by rank where `Res.dat` lists only the cameras in use.
    fn size(&self, number: u32, rank: usize, cameras: usize) -> Option<(u32, u32)> {
        let line = if self.sizes.len() == cameras { rank } else { (number as usize).checked_sub(1)? };
        self.sizes.get(line).copied()
    }

    fn camera(
        &self,
        placement: &Placement,
        number: u32,
        mut parts: Parts,
        options: &ImportOptions,
        warnings: &mut Vec<String>,
    ) -> Result<Camera, ImportError> {
        let origin = options.pixel_origin.unwrap_or(MATLAB_ORIGIN);
        parts.k = from_origin(parts.k, origin);
        let mut radials = self.radials(number);
        let radial = radials.next();
        if let Some((one, other)) =
            radial.zip(radials.find(|other| radial.is_some_and(|one| one.text != other.text)))
        {
            let found = format!("two lenses of camera {number} that differ");
            return Err(ImportError::conflict(
                &one.path,
                &other.path,
                found,
                "one .rad per camera: move one away",
            ));
        }
        let Some(radial) = radial else {
            return placed(placement, parts.k, [0.0; 5], &parts.r, parts.t, warnings);
        };
        let (k_lens, distortion) = read_radial(radial)?;
        if k_lens == FAILED && distortion == [0.0; 5] {
            warnings.push(format!(
                "{}: the radial fit of camera {} failed (the tool's default K, no distortion): pictures of that \
                 camera will be off towards the corners",
                radial.path, placement.name
            ));
        }
        let chain = Chain {
            k_projection: parts.k,
            k_lens: from_origin(k_lens, origin),
            distortion,
            size: placement.size,
        };
        let refit = chain.refit();
        if refit.error_px > TOLD_PX {
            warnings.push(format!(
                "{}: P and the lens of camera {} have different intrinsics; the nearest single camera is up to \
                 {:.2} px off",
                radial.path, placement.name, refit.error_px
            ));
        }
        let (rotation, translation) = (refit.turn * parts.r, refit.turn * parts.t);
        placed(placement, refit.k, refit.distortion, &rotation, translation, warnings)
    }
}

/// What the tool leaves when its radial fit fails.
const FAILED: Matrix3<f64> = Matrix3::new(700.0, 0.0, 320.0, 0.0, 700.0, 240.0, 0.0, 0.0, 1.0);

/// `K11 = …` to `K33`, `kc1 = …` to `kc4` (k1 k2 p1 p2), perhaps with `;` at the end.
fn read_radial(file: &TextFile) -> Result<(Matrix3<f64>, [f64; 5]), ImportError> {
    let value = |key: &str| {
        let mut lines = file.text.lines().filter_map(|line| {
            let (name, value) = line.split_once('=')?;
            (name.trim() == key).then(|| value.trim().trim_end_matches(';').trim())
        });
        let line = lines.next();
        if let Some(other) = lines.find(|other| Some(*other) != line) {
            let found = format!("{:?} and {other:?}", line.unwrap_or_default());
            return Err(ImportError::key(&file.path, key, found, "one value"));
        }
        let found: Option<f64> =
            line.and_then(|text| text.parse().ok()).filter(|value: &f64| value.is_finite());
        let shown = line.map_or_else(|| "nothing".to_owned(), |text| format!("{text:?}"));
        found.ok_or_else(|| ImportError::key(&file.path, key, shown, "a number"))
    };
    let mut k = Matrix3::zeros();
    for row in 0..3 {
        for column in 0..3 {
            k[(row, column)] = value(&format!("K{}{}", row + 1, column + 1))?;
        }
    }
    if k[(0, 0)] <= 0.0 || k[(1, 1)] <= 0.0 || k[(2, 2)] != 1.0 {
        let found = format!("{} {} {}", k[(0, 0)], k[(1, 1)], k[(2, 2)]);
        return Err(ImportError::key(&file.path, "K11, K22, K33", found, "two focal lengths and 1"));
    }
    // What Bouguet's toolbox has beyond the tool's four.
    for key in ["kc5", "kc6"] {
        let names_it = |line: &str| line.split_once('=').is_some_and(|(name, _)| name.trim() == key);
        let found = if file.text.lines().any(names_it) { value(key)? } else { 0.0 };
        if found != 0.0 {
            return Err(ImportError::key(&file.path, key, found.to_string(), "zero: kc1 to kc4 are read"));
        }
    }
    Ok((k, [value("kc1")?, value("kc2")?, value("kc3")?, value("kc4")?, 0.0]))
}

#[cfg(test)]
mod tests;
