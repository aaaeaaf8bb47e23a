//! The environment of the pictures, built in or from a file.

use std::io::BufReader;
use std::path::Path;

use csbrdf::assess::render::environment::Environment;
use image::ImageReader;

use crate::failure::Failure;
use crate::source;

/// The environment and what to call it.
pub fn environment(file: Option<&Path>) -> Result<(Environment, String), Failure> {
    let Some(file) = file else {
        return Ok((Environment::built_in(), "built-in: a sky over a floor, a softbox, a warm strip light".into()));
    };
    let remedy = "give a latitude-longitude map as .hdr (Radiance) or .exr (OpenEXR)";
    let (opened, _) = source::open_regular(file)?;
    let reader = ImageReader::new(BufReader::new(opened)).with_guessed_format();
    let reader = reader.map_err(|e| Failure::io(file, &e))?;
    if reader.format().is_none() {
        return Err(Failure::bad_input(file, format!("is no picture of a known format; {remedy}")));
    }
    let picture = reader.decode().map_err(|e| match e {
        image::ImageError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Failure::io(file, &e),
        image::ImageError::Limits(e) => Failure::unsupported(file, format!("{e}; give a smaller map")),
        e => Failure::bad_input(file, format!("{e}; {remedy}")),
    })?;
    let map = picture.into_rgb32f();
    let (width, height) = (map.width() as usize, map.height() as usize);
    let texels = map.pixels().map(|p| p.0).collect();
    let environment = Environment::new(width, height, texels).map_err(|e| Failure::bad_input(file, e))?;
    let name = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Ok((environment, format!("{name}, {width} x {height}")))
}
