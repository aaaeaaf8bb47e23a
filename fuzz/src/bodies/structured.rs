//! Fields of a golden file changed, all checksums right again: opened, verified, decoded, evaluated, salvaged, repaired. The recipe is the
//! input (`recipe`).

use super::{eval, file, open, recipe, salvage};

pub fn run(data: &[u8]) {
    let Some(changed) = recipe::make(data) else { return };
    open::run(&changed);
    file::run(&changed);
    // Directions of the recipe's bytes, over and over.
    let head: Vec<u8> = data.iter().cycle().take(eval::HEAD).copied().collect();
    eval::run(&[&head[..], &changed].concat());
    // Without damage, and cut off.
    salvage::run(&[&[0; salvage::HEAD], &changed[..]].concat());
    if data.last().is_some_and(|last| last % 4 == 0) {
        let cut = [2, 0, data.len() as u8, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        salvage::run(&[&cut[..], &changed].concat());
    }
}
