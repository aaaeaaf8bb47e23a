//! A golden file pruned by an arbitrary trace, channels and detail: refused, or what remains opens, verifies, and has in its kept
//! blocks and channels the bits that they had. The first byte chooses the file, two channels (upper six bits of the first, 0 for all)
//! and detail, the others the blocks that are looked at.

use csbrdf::base::error::Error;
use csbrdf::brdf::touched::Touched;
use csbrdf::decode::{Pruned, Reader};
use csbrdf::edit::prune::Pruner;

use super::golden::chosen;
use super::{is_value, same_bits};

pub fn run(data: &[u8]) {
    let [file, coarse, fine, keep @ ..] = data else { return };
    let reader = Reader::open(chosen(*file)).expect("golden files open");
    let blocks = reader.block_count();
    let detail = match coarse % 4 {
        0 => 0.0,
        1 => f64::from(*fine) / 256.0,
        2 => f64::from(*fine) * 1e3,
        _ => [-0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX, 5e-324, 1e-300, 1e300][usize::from(*fine % 8)],
    };
    let kept = |block: usize| keep.get(block / 8).is_some_and(|byte| byte >> (block % 8) & 1 == 1);
    let touched = trace(&reader, kept);
    let mut pruner = Pruner::new().blocks(&touched).detail(detail);
    let mut channels: Vec<usize> = (0..reader.grid().channels().len()).collect();
    if coarse >> 2 > 0 {
        // The six bits over and over: files have more channels.
        channels.retain(|c| coarse >> (2 + c % 6) & 1 == 1);
        pruner = pruner.channels(&channels);
    }
    let pruned = match pruner.prune(&reader) {
        Ok(pruned) => pruned,
        Err(Error::InvalidArgument(_)) => return,
        Err(e) => panic!("{e}"),
    };
    assert_eq!(pruned.kept + pruned.pruned, blocks);
    let small = Reader::open(&pruned.bytes[..]).expect("what prune makes opens");
    assert!(small.verify().is_empty(), "{:?}", small.verify());
    let coarse = Reader::open(&pruned.bytes[..]).expect("as before").with_pruned(Pruned::Coarse);
    let block = |reader: &Reader<&[u8]>, block| {
        let mut values = vec![f32::NAN; reader.block_values(block).expect("a block")];
        reader.block_into(block, &mut values).map(|()| values)
    };
    for number in 0..blocks {
        let after = block(&coarse, number).expect("its mean at least");
        assert!(after.iter().all(is_value));
        match (block(&reader, number), block(&small, number)) {
            (Ok(before), Ok(after)) => {
                let n = before.len() / reader.grid().channels().len();
                let before: Vec<f32> = channels.iter().flat_map(|c| &before[c * n..(c + 1) * n]).copied().collect();
                assert!(if detail == 0.0 { same_bits(&before, &after) } else { before.len() == after.len() });
            }
            (_, Err(Error::Pruned { block })) => assert_eq!(block, number),
            (before, after) => panic!("block {number}: {before:?} {after:?}"),
        }
        assert!(!kept(number) || block(&reader, number).is_ok() == block(&small, number).is_ok());
        let rms = |reader: &Reader<_>| reader.block_info(number).expect("a block").rms;
        let fewer = channels.len() < reader.grid().channels().len();
        assert!(block(&small, number).is_err() || fewer || rms(&small) >= rms(&reader));
    }
    // Pruned once more by a trace of its own that looks at everything, nothing changes.
    let again = Pruner::new().blocks(&trace(&small, |_| true)).prune(&small).expect("a file of this version");
    assert_eq!((again.kept, again.pruned), (pruned.kept, pruned.pruned));
}

fn trace(reader: &Reader<&[u8]>, kept: impl Fn(usize) -> bool) -> Touched {
    let index = reader.directory().sections().iter().find(|s| s.name() == "INDX").expect("it was opened");
    let mut text = format!("csbrdf trace 1\nblocks {} index {:08x}\n", reader.block_count(), index.crc);
    for block in (0..reader.block_count()).filter(|&block| kept(block)) {
        text += &format!("{block}\n");
    }
    Touched::from_text(&text).expect("a trace")
}
