//! How much of an encode is done, as a value that its stages divide among themselves.

use std::sync::atomic::{AtomicUsize, Ordering};

/// A range of the whole that a stage reports into, from any thread.
#[derive(Clone, Copy)]
pub(in crate::encode) struct Progress<'a> {
    /// Is called with the share of the whole that is done, 0 to 1.
    sink: &'a (dyn Fn(f64) + Sync),
    from: f64,
    to: f64,
}

impl<'a> Progress<'a> {
    /// All of an encode.
    pub(in crate::encode) fn new(sink: &'a (dyn Fn(f64) + Sync)) -> Progress<'a> {
        Progress { sink, from: 0.0, to: 1.0 }
    }

    /// For what reports to nobody.
    pub(in crate::encode) fn none() -> Progress<'static> {
        Progress::new(&|_| {})
    }

    /// A part of this range, given as shares of it.
    pub(in crate::encode) fn part(self, from: f64, to: f64) -> Progress<'a> {
        let at = |share: f64| self.from + share * (self.to - self.from);
        Progress { from: at(from), to: at(to), ..self }
    }

    /// Step `number` of `count` equal ones.
    pub(in crate::encode) fn step(self, number: usize, count: usize) -> Progress<'a> {
        let count = count.max(1) as f64;
        self.part(number as f64 / count, (number + 1) as f64 / count)
    }

    /// Reports that a share of this range is done, 0 to 1.
    pub(in crate::encode) fn reach(self, share: f64) {
        (self.sink)(self.from + share * (self.to - self.from));
    }

    /// Counts `count` equal pieces of work that threads finish in any order.
    pub(in crate::encode) fn pieces(self, count: usize) -> Pieces<'a> {
        Pieces { progress: self, done: AtomicUsize::new(0), count }
    }
}

/// Pieces of work, see [`Progress::pieces`].
pub(in crate::encode) struct Pieces<'a> {
    progress: Progress<'a>,
    done: AtomicUsize,
    count: usize,
}

impl Pieces<'_> {
    /// One more is done.
    pub(in crate::encode) fn finish(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.reach(done as f64 / self.count as f64);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn parts_of_parts_end_where_the_next_begin() {
        let seen = Mutex::new(Vec::new());
        let sink = |share: f64| seen.lock().unwrap().push(share);
        let all = Progress::new(&sink);
        let half = all.part(0.5, 1.0);
        half.step(0, 2).reach(1.0);
        half.step(1, 2).reach(0.0);
        let pieces = all.part(0.0, 0.5).pieces(2);
        pieces.finish();
        pieces.finish();
        all.reach(1.0);
        assert_eq!(*seen.lock().unwrap(), [0.75, 0.75, 0.25, 0.5, 1.0]);
    }
}
