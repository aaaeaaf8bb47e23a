//! Pictures: exposure, sRGB, PSNR, difference, PNG.

use std::io::Write;

use super::RADIUS;
use crate::base::error::{Error, Result};

/// Factor of the difference picture.
pub const DIFFERENCE_GAIN: f64 = 8.0;

/// A rendered picture in linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Rows from the top, pixels from the left, red, green and blue of each; linear, 0 and up.
    pub rgb: Vec<f32>,
}

impl Image {
    /// The factor that brings the 99th percentile (nearest rank) of the brightest channel over the sphere's pixels to
    /// 0.9, linear; 1 for a picture that is black there.
    ///
    /// Take the reference's exposure for every picture that is compared with it.
    pub fn exposure(&self) -> f32 {
        exposure(self.sphere())
    }

    /// As [`Image::exposure`], over the pixels that `mask` selects, one flag a pixel, instead of the sphere's.
    pub fn exposure_over(&self, mask: &[bool]) -> f32 {
        exposure(self.selected(mask))
    }

    /// 8-bit sRGB of the exposed picture, clamped, three bytes a pixel.
    pub fn to_srgb8(&self, exposure: f32) -> Vec<u8> {
        self.rgb.iter().map(|v| byte(srgb(v * exposure))).collect()
    }

    /// Pixels whose centre is on the sphere.
    fn sphere(&self) -> impl Iterator<Item = &[f32]> {
        let (w, h) = (self.width, self.height);
        self.rgb.chunks_exact(3).enumerate().filter(move |(i, _)| on_sphere(*i, w, h)).map(|(_, pixel)| pixel)
    }

    fn selected<'a>(&'a self, mask: &'a [bool]) -> impl Iterator<Item = &'a [f32]> {
        self.rgb.chunks_exact(3).zip(mask).filter(|(_, selected)| **selected).map(|(pixel, _)| pixel)
    }
}

/// The factor that brings the 99th percentile of the pixels' brightest channels to 0.9.
fn exposure<'a>(pixels: impl Iterator<Item = &'a [f32]>) -> f32 {
    let peak = |p: &[f32]| p.iter().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
    let mut peaks: Vec<f32> = pixels.map(peak).collect();
    peaks.sort_unstable_by(f32::total_cmp);
    let rank = (peaks.len() * 99).div_ceil(100).max(1) - 1;
    match peaks.get(rank) {
        Some(white) if *white > 0.0 => (0.9 / white).min(f32::MAX),
        _ => 1.0,
    }
}

/// True for a pixel (row-major index) whose centre is on the sphere.
fn on_sphere(index: usize, width: usize, height: usize) -> bool {
    let across = |i: usize, n: usize| 2.0 * (i as f64 + 0.5) / n as f64 - 1.0;
    across(index % width, width).hypot(across(index / width, height)) < RADIUS
}

/// Peak signal-to-noise ratio in dB of `b` against the reference `a`, both with the exposure of `a`.
///
/// The values are the clamped sRGB ones that 8-bit pictures hold, in [0, 1] and not rounded: peak 1, mean squared error
/// over the three channels of all pixels whose centre is on the sphere. Equal pictures give `+inf`.
///
/// # Errors
/// `InvalidArgument` if the pictures differ in size.
pub fn psnr(a: &Image, b: &Image) -> Result<f64> {
    same_size(a, b)?;
    let (sums, count) = squared_errors(a.sphere().zip(b.sphere()), a.exposure());
    Ok(decibel(sums.iter().sum(), 3 * count))
}

/// As [`psnr`], with an exposure of the caller's choice over the pixels that `mask` selects, one flag a pixel.
///
/// # Errors
/// `InvalidArgument` if the pictures or the mask differ in size.
pub fn psnr_over(a: &Image, b: &Image, exposure: f32, mask: &[bool]) -> Result<f64> {
    same_size(a, b)?;
    if mask.len() != a.width * a.height {
        return Err(Error::InvalidArgument(format!("a mask of {} flags for {} pixels", mask.len(), a.rgb.len() / 3)));
    }
    let (sums, count) = squared_errors(a.selected(mask).zip(b.selected(mask)), exposure);
    Ok(decibel(sums.iter().sum(), 3 * count))
}

/// As [`psnr`], of red, green and blue alone.
///
/// # Errors
/// `InvalidArgument` if the pictures differ in size.
pub fn channel_psnr(a: &Image, b: &Image) -> Result<[f64; 3]> {
    same_size(a, b)?;
    let (sums, count) = squared_errors(a.sphere().zip(b.sphere()), a.exposure());
    Ok(sums.map(|sum| decibel(sum, count)))
}

/// Sums of the squared errors of red, green and blue over pairs of pixels, and their number.
fn squared_errors<'a>(pixels: impl Iterator<Item = (&'a [f32], &'a [f32])>, exposure: f32) -> ([f64; 3], usize) {
    let (mut sums, mut count) = ([0.0; 3], 0);
    for (p, q) in pixels {
        for ((x, y), sum) in p.iter().zip(q).zip(&mut sums) {
            let error = srgb(x * exposure) - srgb(y * exposure);
            *sum += error * error;
        }
        count += 1;
    }
    (sums, count)
}

fn decibel(squares: f64, count: usize) -> f64 {
    if squares > 0.0 { 10.0 * (count as f64 / squares).log10() } else { f64::INFINITY }
}

/// The difference of two pictures as sRGB bytes: `|a - b|` of the sRGB values, times [`DIFFERENCE_GAIN`], clamped.
///
/// # Errors
/// `InvalidArgument` if the pictures differ in size.
pub fn difference(a: &Image, b: &Image, exposure: f32) -> Result<Vec<u8>> {
    same_size(a, b)?;
    let error = |(x, y): (&f32, &f32)| (srgb(x * exposure) - srgb(y * exposure)).abs();
    Ok(a.rgb.iter().zip(&b.rgb).map(|pair| byte(DIFFERENCE_GAIN * error(pair))).collect())
}

/// Writes sRGB bytes (three a pixel, rows from the top) as a PNG file.
///
/// # Errors
/// `InvalidArgument` if a size is zero, above 2^31 - 1, or does not match the number of bytes; `Io` from the writer.
pub fn write_png(writer: impl Write, width: usize, height: usize, srgb8: &[u8]) -> Result<()> {
    let side = |n: usize| u32::try_from(n).ok().filter(|n| (1..1 << 31).contains(n));
    let bytes = width.checked_mul(height).and_then(|n| n.checked_mul(3));
    let (Some(w), Some(h), true) = (side(width), side(height), bytes == Some(srgb8.len())) else {
        return Err(Error::InvalidArgument(format!(
            "no picture of {width} x {height} pixels from {} bytes",
            srgb8.len()
        )));
    };
    let mut encoder = png::Encoder::new(writer, w, h);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut png = encoder.write_header().map_err(std::io::Error::from)?;
    png.write_image_data(srgb8).map_err(std::io::Error::from)?;
    png.finish().map_err(std::io::Error::from)?;
    Ok(())
}

fn same_size(a: &Image, b: &Image) -> Result<()> {
    if (a.width, a.height, a.rgb.len()) == (b.width, b.height, b.rgb.len()) {
        return Ok(());
    }
    Err(Error::InvalidArgument(format!(
        "pictures of {} x {} and {} x {} pixels do not compare",
        a.width, a.height, b.width, b.height
    )))
}

/// The sRGB curve (IEC 61966-2-1) of a linear value clamped to [0, 1]; NaN gives 0.
fn srgb(linear: f32) -> f64 {
    let x = if linear.is_nan() { 0.0 } else { f64::from(linear).clamp(0.0, 1.0) };
    if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn byte(x: f64) -> u8 {
    (x * 255.0).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(size: usize, value: f32) -> Image {
        Image { width: size, height: size, rgb: vec![value; size * size * 3] }
    }

    #[test]
    fn psnr_is_that_of_the_definition() {
        let a = grey(16, 2.0);
        assert_eq!(psnr(&a, &a).unwrap(), f64::INFINITY);
        assert!((a.exposure() - 0.45).abs() < 1e-6);
        let b = grey(16, 1.0);
        let error = srgb(0.9) - srgb(0.45);
        assert!((psnr(&a, &b).unwrap() + 20.0 * error.log10()).abs() < 1e-5);
        let red =
            Image { rgb: a.rgb.iter().enumerate().map(|(i, v)| if i % 3 == 0 { v / 2.0 } else { *v }).collect(), ..a };
        let [r, g, _] = channel_psnr(&a, &red).unwrap();
        assert!((r + 20.0 * error.log10()).abs() < 1e-5 && g.is_infinite());
        assert!((psnr(&a, &red).unwrap() - r - 10.0 * 3f64.log10()).abs() < 1e-9);
        // A mask selects other pixels than the sphere's.
        let everywhere = psnr_over(&a, &b, a.exposure_over(&[true; 256]), &[true; 256]).unwrap();
        assert!((everywhere - psnr(&a, &b).unwrap()).abs() < 1e-9);
        assert_eq!(psnr_over(&a, &b, 1.0, &[false; 256]).unwrap(), f64::INFINITY);
        assert!(psnr_over(&a, &b, 1.0, &[true; 255]).is_err());
        // What is outside the sphere does not count.
        let mut c = a.clone();
        c.rgb[0] = 0.0;
        assert_eq!(psnr(&a, &c).unwrap(), f64::INFINITY);
        assert!(psnr(&a, &grey(8, 2.0)).is_err());
    }

    #[test]
    fn bad_pixels_and_empty_pictures_are_harmless() {
        let mut a = grey(8, 0.0);
        assert_eq!(a.exposure(), 1.0);
        a.rgb[100] = f32::NAN;
        a.rgb[101] = f32::INFINITY;
        a.rgb[102] = -1.0;
        assert_eq!(a.to_srgb8(1.0)[100..103], [0, 255, 0]);
        assert!(psnr(&grey(8, 0.0), &a).unwrap().is_finite());
        assert!(psnr(&grey(0, 0.0), &grey(0, 0.0)).unwrap().is_infinite());
        assert!(write_png(Vec::new(), 0, 0, &[]).is_err());
        assert!(write_png(Vec::new(), 2, 2, &[0; 11]).is_err());
    }

    #[test]
    fn a_png_reads_back() {
        let image = Image { width: 3, height: 2, rgb: (0..18).map(|i| i as f32 / 17.0).collect() };
        let bytes = image.to_srgb8(1.0);
        assert_eq!((bytes[0], bytes[17]), (0, 255));
        let mut file = Vec::new();
        write_png(&mut file, 3, 2, &bytes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut back = vec![0; 18];
        reader.next_frame(&mut back).unwrap();
        assert_eq!(back, bytes);
        let shifted = Image { rgb: image.rgb.iter().map(|v| v * 0.9).collect(), ..image.clone() };
        assert!(difference(&image, &shifted, 1.0).unwrap().iter().any(|v| *v > 50));
    }
}
