//! Pictures of 8 bits that the subcommands write and show.

pub mod font;

use std::fmt::Write as _;

use csbrdf::assess::render::{Image, difference, write_png};

use crate::failure::Outcome;
use crate::guard::Guard;
use crate::output::Target;

/// An 8-bit sRGB picture.
#[derive(Clone)]
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

    /// A black picture.
    pub fn black(width: usize, height: usize) -> Picture {
        Picture::filled(width, height, [0; 3])
    }

    /// A picture of one colour.
    pub fn filled(width: usize, height: usize, rgb: [u8; 3]) -> Picture {
        Picture { width, height, rgb: rgb.repeat(width * height) }
    }

    /// A rendered picture.
    pub fn of(image: &Image, exposure: f32) -> Picture {
        Picture { width: image.width, height: image.height, rgb: image.to_srgb8(exposure) }
    }

    /// The difference of two rendered pictures times 8.
    pub fn difference(reference: &Image, other: &Image, exposure: f32) -> csbrdf::Result<Picture> {
        let rgb = difference(reference, other, exposure)?;
        Ok(Picture { width: reference.width, height: reference.height, rgb })
    }

    /// Sets one pixel; `x` and `y` within the picture.
    pub fn set(&mut self, x: usize, y: usize, rgb: [u8; 3]) {
        self.rgb[3 * (y * self.width + x)..][..3].copy_from_slice(&rgb);
    }

    /// One pixel; `x` and `y` within the picture.
    #[cfg(test)]
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        std::array::from_fn(|k| self.rgb[3 * (y * self.width + x) + k])
    }

    /// Writes a line of text, its upper left corner at `x`, `y`, `scale` pixels to one of the font; what hangs over is cut off.
    pub fn write_text(&mut self, x: usize, y: usize, scale: usize, rgb: [u8; 3], text: &str) {
        for (i, letter) in text.chars().enumerate() {
            for at in 0..scale * font::ADVANCE * scale * font::HEIGHT {
                let (across, down) = (at % (scale * font::ADVANCE), at / (scale * font::ADVANCE));
                let (px, py) = (x + scale * font::ADVANCE * i + across, y + down);
                if px < self.width && py < self.height && font::ink(letter, across / scale, down / scale) {
                    self.set(px, py, rgb);
                }
            }
        }
    }

    /// Puts another picture over this one, its upper left corner at `x`, `y`; what hangs over is cut off.
    pub fn place(&mut self, x: usize, y: usize, other: &Picture) {
        let width = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = &other.rgb[3 * row * other.width..][..3 * width];
            self.rgb[3 * ((y + row) * self.width + x)..][..3 * width].copy_from_slice(from);
        }
    }

    /// The picture at `1 / factor` of its size, each pixel the mean of `factor` x `factor`; `factor` at least 1.
    pub fn shrunk(&self, factor: usize) -> Picture {
        let mut small = Picture::black(self.width / factor, self.height / factor);
        for y in 0..small.height {
            for x in 0..small.width {
                let mean = [0, 1, 2].map(|k| {
                    let at = |i: usize| {
                        let (x, y) = (x * factor + i % factor, y * factor + i / factor);
                        usize::from(self.rgb[3 * (y * self.width + x) + k])
                    };
                    ((0..factor * factor).map(at).sum::<usize>() / (factor * factor)) as u8
                });
                small.set(x, y, mean);
            }
        }
        small
    }

    /// Writes a PNG file.
    pub fn write(&self, target: &Target, guard: &Guard) -> Outcome {
        target.write(guard, |out| write_png(out, self.width, self.height, &self.rgb))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_placed_and_shrunk() {
        let mut small = Picture::black(2, 2);
        small.set(1, 0, [200, 100, 40]);
        let mut large = Picture::black(4, 3);
        large.place(2, 1, &small);
        large.place(3, 2, &small);
        let at = |p: &Picture, x: usize, y: usize| p.rgb[3 * (y * p.width + x)];
        assert_eq!((at(&large, 3, 1), at(&large, 2, 1), at(&large, 3, 2)), (200, 0, 0));
        assert_eq!(small.shrunk(2).rgb, [50, 25, 10]);
        assert_eq!((small.pixel(1, 0), small.pixel(0, 1)), ([200, 100, 40], [0; 3]));
    }

    #[test]
    fn text_is_drawn_within_the_picture() {
        let mut picture = Picture::filled(20, 20, [9; 3]);
        // The stem of an l, two pixels wide; the second letter hangs over.
        picture.write_text(0, 0, 2, [255; 3], "ll");
        picture.write_text(19, 19, 3, [255; 3], "8");
        assert_eq!([2, 4, 5, 6, 16].map(|x| picture.pixel(x, 6)[0]), [9, 255, 255, 9, 255]);
    }
}
