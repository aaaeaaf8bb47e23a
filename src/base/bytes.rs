//! The bytes of a file, in memory or mapped, owned by whoever reads them.

use std::fmt;
use std::sync::Arc;

/// The bytes of a file: shared, never changed. A clone is another handle on the same bytes.
#[derive(Clone)]
pub struct Bytes(Arc<dyn AsRef<[u8]> + Send + Sync>);

impl Bytes {
    /// Bytes of any kind that gives the same ones each time.
    pub fn new(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Bytes {
        Bytes(Arc::new(bytes))
    }
}

impl AsRef<[u8]> for Bytes {
    fn as_ref(&self) -> &[u8] {
        (*self.0).as_ref()
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "Bytes({})", self.as_ref().len())
    }
}

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Bytes {
        Bytes::new(bytes)
    }
}

impl From<&'static [u8]> for Bytes {
    fn from(bytes: &'static [u8]) -> Bytes {
        Bytes::new(bytes)
    }
}

#[cfg(feature = "mmap")]
impl From<memmap2::Mmap> for Bytes {
    fn from(map: memmap2::Mmap) -> Bytes {
        Bytes::new(map)
    }
}
