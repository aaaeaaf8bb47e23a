//! A bar over the whole study, on standard error if that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::plan::Plan;
use crate::failure::{Failure, note};

/// Parts of one step, for its inner progress.
const FINE: u64 = 1000;

/// Progress in steps: an encode, or the recoveries of a material.
pub struct Progress {
    bar: ProgressBar,
    quiet: bool,
}

impl Progress {
    pub fn new(plan: &Plan, quiet: bool) -> Progress {
        let steps: usize = plan.materials.iter().map(|m| plan.steps_of(m)).sum();
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(steps as u64 * FINE), target);
        let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent:>3} %  {elapsed}, {eta} left");
        bar.set_style(style.map(|s| s.progress_chars("=> ")).unwrap_or_else(|_| ProgressStyle::default_bar()));
        Progress { bar, quiet }
    }

    /// Names what is worked on.
    pub fn begin(&self, what: &str) {
        self.bar.set_message(what.to_string());
    }

    /// A line on standard error beside the bar: what has been found so far, should the study be ended early.
    pub fn line(&self, line: &str) {
        if !self.quiet {
            self.bar.suspend(|| note(line));
        }
    }

    /// Reports a failure, quiet or not.
    pub fn report(&self, failure: &Failure) {
        self.bar.suspend(|| failure.report());
    }

    /// Runs one step; it is given a function to call with its own progress, 0 to 1.
    pub fn step<T>(&self, work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T) -> T {
        let start = self.bar.position();
        let result = work(&|share| self.bar.set_position(start + (share.clamp(0.0, 1.0) * FINE as f64) as u64));
        self.bar.set_position(start + FINE);
        result
    }

    /// Steps that will not be made.
    pub fn skip(&self, steps: usize) {
        let length = self.bar.length().unwrap_or(0);
        self.bar.set_length(length.saturating_sub(steps as u64 * FINE).max(self.bar.position()));
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
