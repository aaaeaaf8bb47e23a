//! The demo's picture: a ball of the original, one of the decoded table, and their difference in false colours with its scale.

use csbrdf::assess::render::{Image, RADIUS};

use crate::picture::Picture;
use crate::picture::font::{ADVANCE, HEIGHT};

/// Space around the balls, and pixels to a pixel of the letters.
const MARGIN: usize = 16;
const LETTER: usize = 2;
const LINE: usize = LETTER * HEIGHT + 6;
/// Behind everything: sRGB.
const PAPER: [u8; 3] = [24, 26, 31];
const INK: [u8; 3] = [226, 228, 232];
const FAINT: [u8; 3] = [150, 154, 162];

/// Colours of the difference from none to the end of the scale, sRGB: every eighth of viridis of matplotlib (CC0).
const SCALE: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// What the demo shows.
pub struct Board {
    /// The three balls alone, side by side.
    pub balls: Picture,
    /// The balls, what is written under each, and the scale.
    pub whole: Picture,
}

impl Board {
    /// Draws two pictures of the same size, both with the original's exposure; two lines of text go under each.
    pub fn new(original: &Image, decoded: &Image, captions: [[&str; 2]; 2]) -> Board {
        let size = original.width;
        let exposure = original.exposure();
        let difference = relative(original, decoded);
        let end = round_up(percentile(&difference, 0.99));
        let parts = [lit(original, exposure), lit(decoded, exposure), coloured(&difference, size, end)];
        let mut balls = Picture::filled(3 * size, size, PAPER);
        let mut whole = Picture::filled(3 * size + 4 * MARGIN, MARGIN + size + 3 * LINE + MARGIN, PAPER);
        for (i, part) in parts.iter().enumerate() {
            balls.place(i * size, 0, part);
            whole.place(MARGIN + i * (size + MARGIN), MARGIN, part);
        }
        let top = MARGIN + size + LETTER;
        for (i, (title, lines)) in ["original", "decoded"].into_iter().zip(captions).enumerate() {
            let left = MARGIN + i * (size + MARGIN);
            centred(&mut whole, left, size, top, INK, title);
            centred(&mut whole, left, size, top + LINE, INK, lines[0]);
            centred(&mut whole, left, size, top + 2 * LINE, FAINT, lines[1]);
        }
        let left = MARGIN + 2 * (size + MARGIN);
        centred(&mut whole, left, size, top, INK, "radiance difference");
        scale(&mut whole, left, size, top + LINE, end);
        Board { balls, whole }
    }
}

/// Share of a pixel that the ball covers, row-major.
fn coverage(size: usize) -> impl Iterator<Item = f64> {
    let across = move |i: usize| 2.0 * (i as f64 + 0.5) / size as f64 - 1.0;
    let radius = move |i: usize| across(i % size).hypot(across(i / size));
    (0..size * size).map(move |i| ((RADIUS - radius(i)) * size as f64 / 2.0 + 0.5).clamp(0.0, 1.0))
}

/// The largest difference of a pixel's three colours, in percent of the original's radiance; NaN off the ball.
fn relative(original: &Image, decoded: &Image) -> Vec<f64> {
    let of = |(a, b): (&f32, &f32)| {
        let difference = 100.0 * (f64::from(*b) - f64::from(*a)).abs();
        if difference == 0.0 { 0.0 } else { difference / f64::from(*a).abs() }
    };
    let pixels = original.rgb.chunks_exact(3).zip(decoded.rgb.chunks_exact(3));
    let pixels = pixels.map(|(a, b)| a.iter().zip(b).map(of).fold(0.0, f64::max));
    pixels.zip(coverage(original.width)).map(|(d, share)| if share > 0.0 { d } else { f64::NAN }).collect()
}

/// The value that this share of the values, NaN apart, is not above.
fn percentile(values: &[f64], share: f64) -> f64 {
    let mut known: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    known.sort_unstable_by(f64::total_cmp);
    let at = (share * known.len() as f64) as usize;
    known.get(at.min(known.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// The next 1, 2 or 5 times a power of ten; that of 0.001 to 100.
fn round_up(x: f64) -> f64 {
    let steps =
        (-3..2).flat_map(|k| [1.0, 2.0, 5.0].map(|m| if k < 0 { m / 10f64.powi(-k) } else { m * 10f64.powi(k) }));
    steps.into_iter().find(|step| *step >= x).unwrap_or(100.0)
}

/// A ball on paper.
fn lit(image: &Image, exposure: f32) -> Picture {
    let paper = PAPER.map(|c| (f64::from(c) / 255.0 + 0.055) / 1.055).map(|c| c.powf(2.4) as f32 / exposure);
    let rest = coverage(image.width).flat_map(|share| paper.map(|c| (1.0 - share) as f32 * c));
    let rgb = image.rgb.iter().zip(rest).map(|(v, rest)| v + rest).collect();
    Picture::of(&Image { width: image.width, height: image.height, rgb }, exposure)
}

/// The ball of differences; `end` is the value of the last colour.
fn coloured(difference: &[f64], size: usize, end: f64) -> Picture {
    let mut picture = Picture::filled(size, size, PAPER);
    for (i, (value, share)) in difference.iter().zip(coverage(size)).enumerate().filter(|(_, (_, share))| *share > 0.0)
    {
        picture.set(i % size, i / size, mixed(PAPER, colour(value / end), share));
    }
    picture
}

/// The colour of a share of the scale.
fn colour(share: f64) -> [u8; 3] {
    let at = if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) } * (SCALE.len() - 1) as f64;
    let below = (at as usize).min(SCALE.len() - 2);
    mixed(SCALE[below], SCALE[below + 1], at - below as f64)
}

fn mixed(a: [u8; 3], b: [u8; 3], share: f64) -> [u8; 3] {
    std::array::from_fn(|k| (f64::from(a[k]) + share * (f64::from(b[k]) - f64::from(a[k]))).round() as u8)
}

/// The colours from none to `end` percent, and numbers under them.
fn scale(picture: &mut Picture, left: usize, width: usize, top: usize, end: f64) {
    let (bar, inset) = (LINE / 2, width / 16);
    let long = width - 2 * inset;
    for x in 0..long {
        let rgb = colour(x as f64 / (long - 1).max(1) as f64);
        (0..bar).for_each(|y| picture.set(left + inset + x, top + y, rgb));
    }
    for (share, tick) in [(0, "0".to_string()), (1, figure(end / 2.0)), (2, figure(end))] {
        let at = left + inset + share * (long - 1) / 2;
        (0..bar + 4).for_each(|y| picture.set(at, top + y, INK));
        // Centred under its tick, as far as it fits.
        let text = format!("{tick} %");
        let half = LETTER * ADVANCE * text.len() / 2;
        let from = (at + LETTER / 2).saturating_sub(half).min((left + width).saturating_sub(2 * half)).max(left);
        picture.write_text(from, top + bar + 8, LETTER, INK, &text);
    }
}

/// A number of the scale with no more digits than it needs.
fn figure(x: f64) -> String {
    format!("{x:.4}").trim_end_matches('0').trim_end_matches('.').to_string()
}

fn centred(picture: &mut Picture, left: usize, width: usize, top: usize, ink: [u8; 3], text: &str) {
    let from = left + width.saturating_sub(LETTER * ADVANCE * text.len()) / 2;
    picture.write_text(from, top, LETTER, ink, text);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(size: usize, value: impl Fn(usize) -> f32) -> Image {
        let rgb = coverage(size).enumerate().flat_map(|(i, share)| [share as f32 * value(i); 3]).collect();
        Image { width: size, height: size, rgb }
    }

    #[test]
    fn the_scale_ends_at_a_round_number_that_holds_nearly_all() {
        assert_eq!(
            [0.0, 0.0011, 0.03, 0.5, 0.51, 7.0, 1e9, f64::INFINITY].map(round_up),
            [0.001, 0.002, 0.05, 0.5, 1.0, 10.0, 100.0, 100.0]
        );
        assert_eq!([0.0005, 0.25, 0.5, 2.5, 100.0].map(figure), ["0.0005", "0.25", "0.5", "2.5", "100"]);
        let values: Vec<f64> = (0..100).map(f64::from).chain([f64::NAN; 9]).collect();
        assert_eq!((percentile(&values, 0.9), percentile(&values, 1.0), percentile(&[], 0.5)), (90.0, 99.0, 0.0));
    }

    #[test]
    fn differences_are_in_percent_and_never_black() {
        let (a, b) = (ball(64, |_| 0.5), ball(64, |i| if i % 64 < 32 { 0.5 } else { 0.505 }));
        let difference = relative(&a, &b);
        assert!(difference[0].is_nan() && difference[64 * 32 + 20] == 0.0);
        assert!((difference[64 * 32 + 40] - 1.0).abs() < 1e-4);
        assert_eq!(relative(&ball(8, |_| 0.0), &ball(8, |_| 1.0))[8 * 4 + 4], f64::INFINITY);
        let board = Board::new(&a, &b, [["1 byte", ""], ["1 byte", "1:1"]]);
        let (left, right) = (board.balls.pixel(2 * 64 + 20, 32), board.balls.pixel(2 * 64 + 40, 32));
        assert_eq!(left, SCALE[0]);
        // 1 % of a scale that ends at 1 or 2 %, rounding aside.
        assert!(right[1] > 140, "{right:?}");
        // Equal pictures: the ball shows all the same, in the colour of none.
        let equal = Board::new(&a, &a, [[""; 2]; 2]);
        assert_eq!(equal.balls.pixel(2 * 64 + 40, 32), SCALE[0]);
        assert_eq!(equal.balls.pixel(0, 0), PAPER);
        // The same two balls, and text under them.
        assert_eq!(equal.balls.pixel(20, 32), equal.balls.pixel(84, 32));
        let (width, height) = (3 * 64 + 4 * MARGIN, 64 + 2 * MARGIN + 3 * LINE);
        let inked = |b: &Board| (0..width * height).filter(|i| b.whole.pixel(i % width, i / width) == INK).count();
        assert!(inked(&board) > inked(&equal) && inked(&equal) > 500);
    }
}
