//! Channels that a pruned file keeps, and the header that such a file has.

use crate::base::error::{Error, Result};
use crate::blocks::BlockCodec;
use crate::codec::channel::ChannelTransform;
use crate::format::header::Coding;
use crate::table::grid::Grid;

/// Channels to keep, in the order of the file.
pub(super) struct Selection {
    channels: Vec<usize>,
    /// Components that they are made of, as many.
    components: Vec<usize>,
}

impl Selection {
    /// `None` if the file has no other channels.
    pub(super) fn new(codec: &BlockCodec, channels: &[usize]) -> Result<Option<Selection>> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        let count = codec.grid.channels().len();
        let mut sorted = channels.to_vec();
        sorted.sort_unstable();
        if sorted.is_empty() {
            return bad("no channel is to be kept; name one at least".into());
        }
        if let Some(channel) = sorted.iter().find(|channel| **channel >= count) {
            return bad(format!("channel {channel} does not exist, the file has {count}, numbered from 0"));
        }
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            let name = &codec.grid.channels()[pair[0]].name;
            return bad(format!("channel {} ({name:?}) is named twice", pair[0]));
        }
        if sorted.len() == count {
            return Ok(None);
        }
        let components = match &codec.coding.transform {
            ChannelTransform::None => sorted.clone(),
            // Leaving out a term that is zero changes no sum (spec section 2).
            ChannelTransform::Matrix(matrix) => {
                let rows = matrix.chunks_exact(count).enumerate();
                rows.filter(|(_, row)| sorted.iter().any(|&c| row[c] != 0.0)).map(|(t, _)| t).collect()
            }
        };
        if components.len() != sorted.len() {
            return bad(format!(
                "the file codes its channels together: those to keep need {} of its {count} components, and would not stay what they \
                 are with fewer; encode the table again with each channel alone (`csbrdf encode --channels separate`)",
                components.len()
            ));
        }
        Ok(Some(Selection { channels: sorted, components }))
    }

    /// Values of the channels kept, of some `[channel][position]`.
    pub(super) fn of_channels<T: Copy>(&self, values: &[T], positions: usize) -> Vec<T> {
        self.channels.iter().flat_map(|c| &values[c * positions..(c + 1) * positions]).copied().collect()
    }

    /// Values of their components, of some `[component][position]`.
    pub(super) fn of_components<T: Copy>(&self, values: &[T], positions: usize) -> Vec<T> {
        self.components.iter().flat_map(|t| &values[t * positions..(t + 1) * positions]).copied().collect()
    }

    /// What the file with these channels decodes by; its probabilities are yet to be found.
    pub(super) fn header(&self, source: &BlockCodec) -> Result<BlockCodec> {
        let count = source.grid.channels().len();
        let channels = self.channels.iter().map(|&c| source.grid.channels()[c].clone()).collect();
        let transform = match &source.coding.transform {
            ChannelTransform::None => ChannelTransform::None,
            ChannelTransform::Matrix(matrix) => ChannelTransform::Matrix(
                self.components.iter().flat_map(|t| self.of_channels(&matrix[t * count..(t + 1) * count], 1)).collect(),
            ),
        };
        let steps = self.of_components(&source.coding.steps, 1);
        let coding = Coding { steps, transform, ..source.coding.clone() };
        let profile = source.coded_profile.as_ref().map(|profile| {
            let kept = profile.with_components(&source.grid, &self.components);
            kept.map_err(|what| Error::corrupt("GRAZ", profile.offset, what))
        });
        let grid = Grid::new(source.grid.axes().to_vec(), channels)?;
        Ok(BlockCodec::new(grid, coding, source.partition.clone(), Vec::new().into())
            .with_profile(profile.transpose()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::touched::Touched;
    use crate::codec::fourier::Basis;
    use crate::codec::sample::{Sampling, SplitMix64};
    use crate::decode::{PrunedPolicy, Reader};
    use crate::edit::prune::Pruner;
    use crate::encode::contract::Contract;
    use crate::encode::{ChannelCoding, Encoder, Preset};
    use crate::format::directory;
    use crate::format::file::write_file;
    use crate::format::header::write_coding;
    use crate::table::Table;
    use crate::table::grid::{Axis, AxisName, Channel, Mapping};
    use proptest::prelude::*;

    const SHAPE: [usize; 3] = [5, 4, 7];

    /// A table over half and difference angles with holes and exact zeros, in common or each channel its own.
    fn table(channels: usize, common: bool, seed: u64) -> Table {
        let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 9, Mapping::Square, 1.5),
            axis(AxisName::ThetaD, 6, Mapping::Linear, 1.5),
            axis(AxisName::PhiD, 14, Mapping::Linear, 3.1),
        ];
        let channel = |c: usize| Channel {
            name: format!("c{c}"),
            wavelength: Some(400.0 + 5.0 * c as f64),
            scale: 1.0 / (1.0 + c as f64),
        };
        let grid = Grid::new(axes, (0..channels).map(channel).collect()).unwrap();
        let n = grid.positions();
        let mut random = SplitMix64(seed);
        let holes: Vec<u64> = (0..n * channels).map(|_| random.next_u64() % 16).collect();
        let value = |i: usize| match holes[if common { i % n } else { i }] {
            0 => f64::NAN,
            1 => 0.0,
            hole => ((i % n) as f64 * 0.01 + (i / n) as f64).sin().abs() + 0.01 * hole as f64,
        };
        let values: Vec<f64> = (0..n * channels).map(value).collect();
        let valid = values.iter().map(|v| v.is_finite()).collect();
        Table::from_parts(grid, values, valid).unwrap()
    }

    fn encoder() -> Encoder {
        Encoder::new().block_shape(&SHAPE).channels(ChannelCoding::Separate)
    }

    fn block(reader: &Reader<&[u8]>, number: usize) -> Vec<u32> {
        let mut values = vec![0.0; reader.block_values(number).unwrap()];
        reader.block_into(number, &mut values).unwrap();
        values.into_iter().map(f32::to_bits).collect()
    }

    /// Prunes, and checks that what is kept is what it was; gives the file.
    fn kept(bytes: &[u8], channels: &[usize]) -> Vec<u8> {
        let reader = Reader::open(bytes).unwrap().with_pruned(PrunedPolicy::Coarse);
        let pruned = Pruner::new().channels(channels).prune(&reader).unwrap();
        let small = Reader::open(&pruned.bytes[..]).unwrap().with_pruned(PrunedPolicy::Coarse);
        assert!(small.verify().is_empty(), "{:?}", small.verify());
        let mut sorted = channels.to_vec();
        sorted.sort_unstable();
        let named: Vec<_> = sorted.iter().map(|&c| reader.grid().channels()[c].clone()).collect();
        assert_eq!(small.grid().channels(), named);
        for number in 0..reader.block_count() {
            let n = reader.place(number).unwrap().positions();
            let of = |values: Vec<u32>| -> Vec<u32> {
                sorted.iter().flat_map(|c| &values[c * n..(c + 1) * n]).copied().collect()
            };
            assert_eq!(of(block(&reader, number)), block(&small, number), "block {number}");
            let valid = |reader: &Reader<&[u8]>| -> Vec<u32> {
                reader.block_validity(number).unwrap().into_iter().map(u32::from).collect()
            };
            assert_eq!(of(valid(&reader)), valid(&small), "block {number}");
        }
        pruned.bytes
    }

    /// Largest and rms error of ln(f + eps) of a block over its valid entries.
    fn errors(table: &Table, channels: &[usize], reader: &Reader<&[u8]>, number: usize) -> (f64, f64) {
        let (place, valid) = (reader.place(number).unwrap(), reader.block_validity(number).unwrap());
        let (n, eps) = (place.positions(), reader.coding().eps);
        let mut original = vec![0.0; n];
        let (mut squares, mut max, mut count) = (0.0, 0f64, 0);
        for ((&c, values), valid) in channels.iter().zip(block(reader, number).chunks(n)).zip(valid.chunks(n)) {
            place.gather(table.grid().shape(), table.plane(c), &mut original);
            let scale = table.grid().channels()[c].scale;
            for ((v, bits), _) in original.iter().zip(values).zip(valid).filter(|(_, valid)| **valid) {
                let error = ((v * scale + eps).ln() - (f64::from(f32::from_bits(*bits)) + eps).ln()).abs();
                (squares, max, count) = (squares + error * error, max.max(error), count + 1);
            }
        }
        (max, if count == 0 { 0.0 } else { (squares / f64::from(count)).sqrt() })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn kept_channels_stay_bit_for_bit_and_keep_the_errors_stated(
            count in 2usize..6, common: bool, seed: u64, setting in 0usize..5, keep in prop::collection::vec(any::<bool>(), 5)
        ) {
            let table = table(count, common, seed);
            let encoder = match setting {
                0 => encoder(),
                1 => encoder().contract(Contract::MaxError(0.02)),
                2 => encoder().lossless(true),
                3 => encoder().basis(Basis::Dft).sampling(Sampling::from_ratio(0.5).unwrap()),
                _ => encoder().preset(Preset::Sparse).block_shape(&SHAPE).channels(ChannelCoding::Separate).sampling_for(0.2),
            };
            let bytes = encoder.encode(&table).unwrap().bytes;
            let channels: Vec<usize> = (0..count).filter(|&c| keep[c]).collect();
            prop_assume!(!channels.is_empty());
            let pruned = kept(&bytes, &channels);
            let small = Reader::open(&pruned[..]).unwrap();
            prop_assert!(!small.is_lossless());
            for number in 0..small.block_count() {
                let (max, rms) = errors(&table, &channels, &small, number);
                let (stated_rms, stated_max) = small.stated_errors(number);
                prop_assert!(rms <= f64::from(stated_rms) + 1e-4 && max <= f64::from(stated_max) + 1e-4);
            }
        }
    }

    /// The same file with its channels mixed by a matrix.
    fn mixed(bytes: &[u8], matrix: &[f32]) -> Vec<u8> {
        let reader = Reader::open(bytes).unwrap();
        let transform = ChannelTransform::Matrix(matrix.to_vec());
        let section = |name| match name {
            directory::CODING => write_coding(&Coding { transform: transform.clone(), ..reader.coding().clone() }),
            name => reader.section(name).unwrap().unwrap(),
        };
        let names = [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES];
        let names = names.into_iter().chain(reader.has_profile().then_some(directory::PROFILE));
        let names = names.chain([directory::INDEX, directory::RECORDS]);
        write_file(crate::base::version::VERSION, &names.map(|name| (name, false, section(name))).collect::<Vec<_>>())
    }

    #[test]
    fn channels_stay_with_those_that_they_are_mixed_with() {
        let ChannelTransform::Matrix(three) = ChannelTransform::opponent() else { unreachable!() };
        // Components 0, 2 and 3 are of channels 0, 1 and 3; component 1 is channel 2.
        let mut four = vec![0.0; 16];
        for (t, row) in [0, 2, 3].into_iter().zip(three.chunks(3)) {
            [0, 1, 3].into_iter().zip(row).for_each(|(c, m)| four[4 * t + c] = *m);
        }
        four[4 + 2] = 1.0;
        let bytes = mixed(&encoder().encode(&table(4, true, 1)).unwrap().bytes, &four);
        kept(&bytes, &[2]);
        kept(&bytes, &[3, 0, 1]);
        let reader = Reader::open(&bytes[..]).unwrap();
        for channels in [&[0][..], &[0, 2], &[0, 1], &[1, 2, 3]] {
            let refused = Pruner::new().channels(channels).prune(&reader).unwrap_err().to_string();
            assert!(refused.contains("together") && refused.contains("--channels separate"), "{refused}");
        }
    }

    #[test]
    fn names_that_make_no_sense_are_refused() {
        let bytes = encoder().encode(&table(3, true, 2)).unwrap().bytes;
        let reader = Reader::open(&bytes[..]).unwrap();
        let refused = |channels: &[usize]| Pruner::new().channels(channels).prune(&reader).unwrap_err().to_string();
        assert!(refused(&[]).contains("at least"));
        assert!(refused(&[0, 3]).contains("channel 3 does not exist, the file has 3"));
        assert!(refused(&[1, 0, 1]).contains("channel 1 (\"c1\") is named twice"));
        // All of them: nothing is left out.
        assert_eq!(Pruner::new().channels(&[2, 0, 1]).prune(&reader).unwrap(), Pruner::new().prune(&reader).unwrap());
    }

    #[test]
    fn blocks_channels_and_detail_go_together_and_one_after_the_other() {
        let bytes = encoder().encode(&table(5, false, 3)).unwrap().bytes;
        let reader = Reader::open(&bytes[..]).unwrap();
        let some = Touched::new((0..reader.block_count()).map(|b| b % 2 == 0).collect(), reader.index_crc());
        let at_once = Pruner::new().blocks(&some).channels(&[1, 4]).prune(&reader).unwrap();
        let blocks_first = Pruner::new().blocks(&some).prune(&reader).unwrap();
        let then_channels = kept(&blocks_first.bytes, &[1, 4]);
        assert_eq!(then_channels, at_once.bytes);
        let small = Reader::open(&at_once.bytes[..]).unwrap();
        assert!(matches!(small.decode_all(), Err(Error::Pruned { block: 1 })));
        let one = kept(&then_channels, &[1]);
        let encoder = Reader::open(&one[..]).unwrap().metadata().unwrap().encoder.unwrap();
        assert_eq!(encoder["pruned"]["channels"], 5);
        assert_eq!(encoder["pruned"]["kept"], at_once.kept);

        let thin = Pruner::new().channels(&[1, 4]).detail(0.1).prune(&reader).unwrap();
        let whole = Pruner::new().channels(&[1, 4]).prune(&reader).unwrap();
        assert!(thin.bytes.len() < whole.bytes.len() && whole.bytes.len() < bytes.len());
        let (thin, whole) = (Reader::open(&thin.bytes[..]).unwrap(), Reader::open(&whole.bytes[..]).unwrap());
        for number in 0..thin.block_count() {
            let of = |reader| block(reader, number).into_iter().map(|bits| (f32::from_bits(bits) + 1e-3).ln());
            let squares: f64 = of(&thin).zip(of(&whole)).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            assert!((squares / block(&thin, number).len() as f64).sqrt() <= 0.1001);
        }
    }
}
