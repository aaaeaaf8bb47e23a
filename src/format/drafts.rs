//! The versions that this build reads and writes, and what each draft of 1.0 has (spec section 1.5 and appendix A).

use crate::base::version::{DRAFTS, FINAL, VERSION};

/// First draft whose records may double the sampling ratio.
const DOUBLINGS_DRAFT: u16 = 2;
/// First draft with a coded index, codes of probabilities, exact zeros, grazing profiles, corrections.
const COMPACT_DRAFT: u16 = 3;
/// First draft with dependent quantisation and coded probabilities.
const DEPENDENT_DRAFT: u16 = 4;
/// First draft with pruned blocks.
const PRUNED_DRAFT: u16 = 5;

/// Whether this build reads files of a version: the same major one, with what later minor ones may be skipped of.
pub(crate) fn reads_version((major, minor, draft): (u16, u16, u16)) -> bool {
    major == VERSION.0 && (draft == FINAL || minor == 0 && DRAFTS.contains(&draft))
}

/// Whether records of a draft may double the sampling ratio; those of final versions may.
pub(crate) fn may_double(draft: u16) -> bool {
    draft == 0 || draft >= DOUBLINGS_DRAFT
}

/// Whether files of a draft have the coded index and what else came with it.
pub(crate) fn is_compact(draft: u16) -> bool {
    draft == 0 || draft >= COMPACT_DRAFT
}

/// Whether files of a draft may have dependent quantisation, and have the section of probabilities that came with it.
pub(crate) fn is_dependent(draft: u16) -> bool {
    draft == 0 || draft >= DEPENDENT_DRAFT
}

/// Whether blocks of a draft's files may be pruned.
pub(crate) fn may_prune(draft: u16) -> bool {
    draft == 0 || draft >= PRUNED_DRAFT
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A final version comes after all drafts: what they brought stays.
    #[test]
    fn what_drafts_brought_stays_when_the_version_is_final() {
        assert_eq!([0, 1, 2, 3].map(may_double), [true, false, true, true]);
        assert_eq!([0, 1, 2, 3, 4].map(is_compact), [true, false, false, true, true]);
        assert_eq!([0, 2, 3, 4, 5].map(is_dependent), [true, false, false, true, true]);
        assert_eq!([0, 3, 4, 5, 6].map(may_prune), [true, false, false, true, true]);
        let versions = [(1, 0, 0), (1, 0, 1), (1, 0, 5), (1, 7, 0), (1, 0, 6), (1, 1, 1), (0, 0, 0), (2, 0, 0)];
        assert_eq!(versions.map(reads_version), [true, true, true, true, false, false, false, false]);
    }
}
