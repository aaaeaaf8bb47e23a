//! The environment of the pictures, built in or from a file.

mod openexr;
mod radiance;

use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

use csbrdf::assess::render::environment::Environment;

use crate::failure::Failure;
use crate::source;

/// Most bytes of a map in memory, three numbers of single precision a texel: more is refused before it is allocated.
const MOST_BYTES: usize = 512 << 20;

/// A picture of linear radiance, rows from the top.
#[derive(Debug, PartialEq)]
struct Map {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
}

/// Why a file gave no map.
#[derive(Debug)]
enum Refused {
    Io(std::io::Error),
    Malformed(String),
    TooLarge(String),
}

impl From<std::io::Error> for Refused {
    fn from(error: std::io::Error) -> Refused {
        match error.kind() {
            ErrorKind::UnexpectedEof => Refused::Malformed("ends in the middle of the picture".into()),
            _ => Refused::Io(error),
        }
    }
}

/// The number of texels, if they may be allocated.
fn texels(width: usize, height: usize) -> Result<usize, Refused> {
    let most = MOST_BYTES / size_of::<[f32; 3]>();
    width.checked_mul(height).filter(|n| *n <= most).ok_or_else(|| {
        Refused::TooLarge(format!("has {width} x {height} texels, and at most {most} are read; give a smaller map"))
    })
}

/// The environment and what to call it.
pub fn environment(file: Option<&Path>) -> Result<(Environment, String), Failure> {
    let Some(file) = file else {
        return Ok((Environment::built_in(), "built-in: a sky over a floor, a softbox, a warm strip light".into()));
    };
    let remedy = "give a latitude-longitude map as .hdr (Radiance) or .exr (OpenEXR)";
    let (opened, _) = source::open_regular(file)?;
    let mut reader = BufReader::new(opened);
    let head = reader.fill_buf().map_err(|e| Failure::io(file, &e))?;
    let map = if radiance::is_of(head) {
        radiance::read(reader)
    } else if openexr::is_of(head) {
        openexr::read(reader)
    } else {
        return Err(Failure::bad_input(file, format!("is no picture of a known format; {remedy}")));
    };
    let map = map.map_err(|e| match e {
        Refused::Io(e) => Failure::io(file, &e),
        Refused::TooLarge(what) => Failure::unsupported(file, what),
        Refused::Malformed(what) => Failure::bad_input(file, format!("{what}; {remedy}")),
    })?;
    let (width, height) = (map.width, map.height);
    let environment = Environment::new(width, height, map.texels).map_err(|e| Failure::bad_input(file, e))?;
    let name = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Ok((environment, format!("{name}, {width} x {height}")))
}
