//! One open file for many threads: the same bits as for one, whatever the cache throws out meanwhile. Golden files and the decoder
//! alone, so that `tools/sanitize.sh` can watch it.

use csbrdf::brdf::eval::Brdf;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{Pruned, Reader, Scratch};

const FILES: [&[u8]; 4] = [
    include_bytes!("data/v1/dct-dependent-profile.csbrdf"),
    include_bytes!("data/v1/dct-dependent-grazing-zeros.csbrdf"),
    include_bytes!("data/v1/dct-tiled.csbrdf"),
    include_bytes!("data/v1/pruned.csbrdf"),
];
const THREADS: u64 = 4;

fn open(file: &'static [u8]) -> Brdf<&'static [u8]> {
    Brdf::open(Reader::open(file).unwrap().with_pruned(Pruned::Coarse)).unwrap()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Pairs of directions in an order of the thread's own.
fn pairs(thread: u64, pairs: u64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let mut random = SplitMix64(7);
    let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut direction = || [2.0 * uniform() - 1.0, 2.0 * uniform() - 1.0, uniform()];
    let mut all: Vec<_> = (0..pairs).map(|_| (direction(), direction())).collect();
    all.rotate_left((thread * pairs / THREADS) as usize);
    all.into_iter().unzip()
}

#[test]
fn look_ups_of_many_threads_are_those_of_one() {
    for file in FILES {
        let single = open(file);
        let channels = single.reader().grid().channels().len();
        // Room for nothing, for a block or two, for everything: blocks come and go, and come once.
        for cache in [0, 1 << 14, usize::MAX] {
            let shared = open(file).with_cache_bytes(cache);
            std::thread::scope(|scope| {
                for thread in 0..THREADS {
                    let (single, shared) = (&single, &shared);
                    scope.spawn(move || {
                        let (wi, wo) = pairs(thread, if cache == usize::MAX { 400 } else { 40 });
                        let mut expected = vec![0.0; wi.len() * channels];
                        single.eval_many(&wi, &wo, &mut expected).unwrap();
                        let mut many = vec![f32::NAN; expected.len()];
                        shared.eval_many(&wi, &wo, &mut many).unwrap();
                        assert!(bits(&many) == bits(&expected));
                        let mut value = vec![f32::NAN; channels];
                        for (i, expected) in expected.chunks_exact(channels).enumerate() {
                            shared.eval_into(wi[i], wo[i], &mut value).unwrap();
                            assert!(bits(&value) == bits(expected));
                        }
                    });
                }
            });
            assert!(shared.blocks_rebuilt() > 0 || cache == usize::MAX);
            if cache == usize::MAX {
                assert_eq!(shared.touched().blocks(), single.touched().blocks());
            }
        }
    }
}

/// The profile and the tables of the transform are made at first use: by threads that all come at once.
#[test]
fn blocks_that_many_threads_ask_for_first_are_those_of_one() {
    for file in FILES {
        let reader = Reader::open(file).unwrap().with_pruned(Pruned::Coarse);
        let expected = Reader::open(file).unwrap().with_pruned(Pruned::Coarse);
        std::thread::scope(|scope| {
            for thread in 0..THREADS as usize {
                let (reader, expected) = (&reader, &expected);
                scope.spawn(move || {
                    let (mut scratch, blocks) = (Scratch::default(), reader.block_count());
                    for block in (0..blocks).map(|block| (block + thread * blocks / THREADS as usize) % blocks) {
                        let mut values = vec![f32::NAN; reader.block_values(block).unwrap()];
                        reader.block_with(block, &mut scratch, &mut values).unwrap();
                        let mut alone = values.clone();
                        expected.block_into(block, &mut alone).unwrap();
                        assert!(bits(&values) == bits(&alone));
                        assert_eq!(reader.block_origin(block).unwrap(), expected.block_origin(block).unwrap());
                    }
                });
            }
        });
    }
}
