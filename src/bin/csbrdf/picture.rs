//! The picture that `compare` and `demo` show: reference, other, difference side by side.

use std::fmt::Write as _;

use csbrdf::render::{Image, difference, write_png};

use crate::failure::Outcome;
use crate::output::Target;

/// An 8-bit sRGB picture.
pub struct Picture {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Picture {
    /// Reference, other and their difference times 8, all with the reference's exposure.
    pub fn comparison(reference: &Image, other: &Image) -> csbrdf::Result<Picture> {
        let exposure = reference.exposure();
        let parts = [reference.to_srgb8(exposure), other.to_srgb8(exposure), difference(reference, other, exposure)?];
        let (width, height) = (reference.width, reference.height);
        let rows = (0..height).flat_map(|y| parts.iter().map(move |part| &part[3 * y * width..3 * (y + 1) * width]));
        Ok(Picture { width: 3 * width, height, rgb: rows.flatten().copied().collect() })
    }

    /// Writes a PNG file.
    pub fn write(&self, target: &Target, force: bool) -> Outcome {
        target.write(force, |out| write_png(out, self.width, self.height, &self.rgb))
    }

    /// Two pixels a character, upper and lower half, in 24-bit colours.
    pub fn half_blocks(&self) -> String {
        let pixel = |x: usize, y: usize| {
            let at = 3 * (y * self.width + x);
            self.rgb.get(at..at + 3).map_or([0; 3], |p| [p[0], p[1], p[2]])
        };
        let mut text = String::new();
        for y in (0..self.height).step_by(2) {
            for x in 0..self.width {
                let ([r, g, b], [s, h, c]) = (pixel(x, y), pixel(x, y + 1));
                let _ = write!(text, "\x1b[38;2;{r};{g};{b};48;2;{s};{h};{c}m\u{2580}");
            }
            text.push_str("\x1b[0m\n");
        }
        text
    }
}
