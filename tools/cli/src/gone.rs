//! Blocks that a file holds no more than the mean of: what took them, damage or pruning, is kept apart.

use std::fmt::Write as _;

use csbrdf::decode::{Reader, State};

use crate::text::grouped;

/// Most runs of blocks that are listed.
const MOST_RUNS: usize = 8;

/// How many blocks are gone.
#[derive(Default)]
pub struct Gone {
    /// Blocks of the file.
    pub blocks: usize,
    /// Left out on purpose.
    pub pruned: usize,
    /// Taken by damage, by runs of neighbours: first and last.
    pub lost: Vec<(usize, usize)>,
    /// Without their source values, of a lossless file.
    pub exact: usize,
}

impl Gone {
    pub fn of<D: AsRef<[u8]>>(reader: &Reader<D>) -> Gone {
        let exact = if reader.is_lossless() { reader.lost_source().unwrap_or(0) } else { 0 };
        let mut gone = Gone { blocks: reader.block_count(), exact, ..Gone::default() };
        for block in 0..gone.blocks {
            match (reader.state(block), gone.lost.last_mut()) {
                (Ok(State::Lost), Some((_, last))) if *last + 1 == block => *last = block,
                (Ok(State::Lost), _) => gone.lost.push((block, block)),
                (Ok(State::Pruned), _) => gone.pruned += 1,
                _ => {}
            }
        }
        gone
    }

    /// Number of blocks that damage took.
    pub fn lost_count(&self) -> usize {
        self.lost.iter().map(|(first, last)| last - first + 1).sum()
    }

    /// Whether damage took anything.
    pub fn is_hurt(&self) -> bool {
        !self.lost.is_empty() || self.exact > 0
    }

    /// What damage took, in words.
    pub fn what_is_lost(&self) -> String {
        let mut text = String::new();
        if !self.lost.is_empty() {
            let (lost, blocks) = (self.lost_count(), grouped(self.blocks));
            let _ =
                write!(text, "{} of {blocks} blocks {} lost (", grouped(lost), if lost == 1 { "is" } else { "are" });
            for (i, (first, last)) in self.lost.iter().take(MOST_RUNS).enumerate() {
                let comma = if i > 0 { ", " } else { "" };
                let _ = if first == last {
                    write!(text, "{comma}{first}")
                } else {
                    write!(text, "{comma}{first} to {last}")
                };
            }
            let more = self.lost.len().saturating_sub(MOST_RUNS);
            text.push_str(&if more > 0 { format!(" and {more} more runs)") } else { ")".into() });
        }
        if self.exact > 0 {
            let and = if text.is_empty() { "" } else { ", and " };
            let _ = write!(text, "{and}the source values of {} blocks are lost", grouped(self.exact));
        }
        text
    }
}
