//! What the fuzz targets run. `tests/crashes.rs` of the codec runs the same bodies on inputs that once failed.

// The C ABI calls the codec so.
extern crate csbrdf as codec;

pub mod bodies;
pub mod mutate;

/// Has the codec work on the calling thread alone: waking another takes longer than most inputs.
pub fn on_one_thread() {
    #[cfg(feature = "cli")]
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global().expect("called once");
}
