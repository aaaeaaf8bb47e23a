//! The golden files, one a feature of the format; `tests/crashes.rs` sees that none is left out.

macro_rules! golden {
    ($($name:literal),+ $(,)?) => {
        pub const GOLDEN: &[(&str, &[u8])] =
            &[$(($name, include_bytes!(concat!("../../../tests/data/v1/", $name, ".csbrdf")))),+];
    };
}

golden!(
    "dct-1d-single-positions",
    "dct-4d-spectral",
    "dct-corrected-channels",
    "dct-corrected-opponent",
    "dct-dependent-4d-spectral",
    "dct-dependent-corrected",
    "dct-dependent-grazing-zeros",
    "dct-dependent-lossless",
    "dct-dependent-profile",
    "dct-dependent",
    "dct-fine-step",
    "dct-grazing-zeros",
    "dct-lossless",
    "dct-mask-per-channel-extremes",
    "dct-opponent-mask",
    "dct-sampled-by-block",
    "dct-spare",
    "dct-tiled",
    "dft-1d",
    "dft-4d-coarse-extremes",
    "dft-dependent",
    "dft-sampled-draft-4",
    "dft-sampled-horizon",
    "final-4d-spectral",
    "final-corrected",
    "final-dft-sampled",
    "final-lossless",
    "final-profile",
    "final-pruned",
    "final-sampled-by-block",
    "final-tiled",
    "later-minor-version",
    "pruned",
);

/// The file that a byte chooses.
pub fn chosen(byte: u8) -> &'static [u8] {
    GOLDEN[usize::from(byte) % GOLDEN.len()].1
}
