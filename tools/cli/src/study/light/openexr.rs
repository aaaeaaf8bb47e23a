//! OpenEXR pictures (.exr): red, green and blue of the first part that has them.

use std::io::{BufRead, Seek};

use exr::meta::attribute::{IntegerBounds, Text};
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, Vec2, read as reader};

use super::{Map, Refused, texels};

impl From<exr::error::Error> for Refused {
    fn from(error: exr::error::Error) -> Refused {
        match error {
            exr::error::Error::Io(e) => e.into(),
            e => Refused::Malformed(format!("as OpenEXR: {e}")),
        }
    }
}

/// Whether a file that begins so is an OpenEXR picture.
pub fn is_of(head: &[u8]) -> bool {
    head.starts_with(&[0x76, 0x2F, 0x31, 0x01])
}

/// Reads the display window at full resolution; what the file has no data for is black.
pub fn read(from: impl BufRead + Seek) -> Result<Map, Refused> {
    let chunks = exr::block::read(from, false)?;
    let has = |header: &Header, name| header.channels.find_index_of_channel(&Text::from(name)).is_some();
    let coloured = |h: &&Header| !h.deep && ["R", "G", "B"].iter().all(|name| has(h, *name));
    let Some(header) = chunks.headers().iter().find(coloured) else {
        return Err(Refused::Malformed("has no channels R, G and B of one sample a pixel".into()));
    };
    if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(Refused::Malformed("has channels of fewer samples than pixels".into()));
    }
    let display: IntegerBounds = header.shared_attributes.display_window;
    let (Vec2(left, top), Vec2(width, height)) = (header.own_attributes.layer_position, display.size);
    let count = texels(width, height)?;
    // The data may reach beyond what is displayed: its rows are unpacked all the same.
    for Vec2(width, height) in chunks.headers().iter().map(|h| h.layer_size) {
        texels(width, height)?;
    }
    // Where the data begin in the display window.
    let [left, top] = [(left, display.position.0), (top, display.position.1)].map(|(a, b)| i64::from(a) - i64::from(b));
    let place = move |Vec2(x, y): Vec2<usize>| {
        let within = |at: usize, from: i64, n: usize| usize::try_from(at as i64 + from).ok().filter(|at| *at < n);
        Some(within(y, top, height)? * width + within(x, left, width)?)
    };
    let image = reader()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            move |_, _| vec![[0f32; 3]; count],
            move |map: &mut Vec<[f32; 3]>, at, (r, g, b): (f32, f32, f32)| {
                if let Some(texel) = place(at).and_then(|i| map.get_mut(i)) {
                    *texel = [r, g, b];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_chunks(chunks)?;
    Ok(Map { width, height, texels: image.layer_data.channel_data.pixels })
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use exr::image::write::channels::WritableChannels;
    use exr::image::write::layers::WritableLayers;
    use exr::prelude::*;

    use super::{is_of, read};
    use crate::study::light::{Map, Refused};

    const SIZE: Vec2<usize> = Vec2(37, 21);

    fn texel(Vec2(x, y): Vec2<usize>) -> [f32; 3] {
        [x as f32, y as f32 / 4.0, 1000.0]
    }

    fn layer(compression: Compression) -> Layer<impl for<'s> WritableChannels<'s>> {
        let rgb = SpecificChannels::rgb(|at| <(f32, f32, f32)>::from(texel(at)));
        let encoding = Encoding { compression, ..Encoding::FAST_LOSSLESS };
        Layer::new(SIZE, LayerAttributes::named("light"), encoding, rgb)
    }

    fn file<'a>(image: &'a Image<impl WritableLayers<'a>>) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        image.write().non_parallel().to_buffered(&mut file).unwrap();
        file.into_inner()
    }

    fn map_of(file: &[u8]) -> std::result::Result<Map, Refused> {
        read(Cursor::new(file))
    }

    #[test]
    fn pictures_read_back() {
        let expected: Vec<_> = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| texel(Vec2(x, y)))).collect();
        for compression in
            [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
        {
            let file = file(&Image::from_layer(layer(compression)));
            assert!(is_of(&file) && !is_of(&file[1..]));
            let map = map_of(&file).unwrap();
            assert_eq!((map.width, map.height), (37, 21));
            assert!(map.texels == expected, "{compression}");
        }
    }

    #[test]
    fn the_display_window_is_what_counts() {
        let mut image = Image::from_layer(layer(Compression::ZIP16));
        image.layer_data.attributes.layer_position = Vec2(-2, 1);
        image.attributes.display_window = IntegerBounds::new((-1, -1), (5, 4));
        let map = map_of(&file(&image)).unwrap();
        assert_eq!((map.width, map.height, map.texels.len()), (5, 4, 20));
        // The second column of the data is the first that shows, their first row the third.
        assert!(map.texels[..10].iter().all(|t| *t == [0.0; 3]));
        assert_eq!(map.texels[10..12], [texel(Vec2(1, 0)), texel(Vec2(2, 0))]);
        assert_eq!(map.texels[15], texel(Vec2(1, 1)));
    }

    #[test]
    fn what_is_damaged_or_too_large_is_refused() {
        let good = file(&Image::from_layer(layer(Compression::ZIP16)));
        for end in (0..good.len()).step_by(7) {
            assert!(map_of(&good[..end]).is_err(), "{end}");
        }
        // Every byte of the head changed: an error or a map of the size that it says, never a panic.
        for at in 0..good.len().min(600) {
            let mut bad = good.clone();
            bad[at] ^= 0x41;
            if let Ok(map) = map_of(&bad) {
                assert_eq!(map.texels.len(), map.width * map.height);
            }
        }
        let grey = SpecificChannels::build().with_channel::<f32>("Y").with_pixel_fn(|_| (1.0f32,));
        let grey = file(&Image::from_channels(SIZE, grey));
        assert!(matches!(map_of(&grey), Err(Refused::Malformed(what)) if what.contains("R, G and B")));
        let mut huge = Image::from_layer(layer(Compression::ZIP16));
        huge.attributes.display_window = IntegerBounds::new((0, 0), (1 << 16, 1 << 15));
        assert!(matches!(map_of(&file(&huge)), Err(Refused::TooLarge(what)) if what.contains("smaller map")));
    }
}
