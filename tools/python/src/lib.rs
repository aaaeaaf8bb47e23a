//! Python bindings of the csbrdf decoder. What Python programs see is documented here and in `python/csbrdf`.

mod arrays;
mod boundary;
mod broadcast;
mod grid;
mod importance;
mod many;

use std::path::PathBuf;

use codec::brdf::importance::Importance;
use codec::decode::Origin;
use codec::table::block::Block;
use codec::table::coords::Lookup;
use codec::{Brdf, BrdfOptions, Bytes, Limits, PrunedPolicy, Reader};
use numpy::{Element, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PySlice, PyTuple};

use arrays::{Directions, Pairs, array, prepare, zeros};
use boundary::{Error, detached, exception, on_threads, watch_forks};
use grid::{PyAxis, PyChannel};
use importance::PyImportance;
use many::eval_many;

/// Bytes of decoded blocks that a file keeps by default.
const CACHE_BYTES: usize = 64 << 20;

/// Pairs of directions looked up between two looks at Ctrl-C, and most values that they may have.
const BATCH: usize = 1 << 16;
const BATCH_VALUES: usize = 1 << 22;

/// A measured BRDF in a .csbrdf file, from the file's bytes; csbrdf.open() maps a file.
///
/// Opening reads and checks the header and the index; blocks are read when they are first needed. Threads may share one
/// object: calls release the GIL.
///
/// Parameters: data: bytes of the file. cache_bytes: most bytes of decoded blocks that are kept for eval() (one block is
/// kept whatever it takes). lookup: "linear" between bin centres on every axis, or "nearest" for the bin that the
/// directions fall into. pruned: "refuse" makes blocks that were pruned from the file an error, "coarse" gives their mean.
/// limit: most values (positions times channels) of a table that is decoded as a whole, 2**28 if None; with larger ones a call may also
/// take more time and memory.
///
/// Raises csbrdf.Error if the bytes cannot be read, ValueError for another lookup or answer to pruned blocks.
#[pyclass(name = "Brdf", module = "csbrdf", frozen)]
struct PyBrdf(Brdf);

fn read_lookup(lookup: &str) -> PyResult<Lookup> {
    match lookup {
        "linear" => Ok(Lookup::Linear),
        "nearest" => Ok(Lookup::Nearest),
        _ => Err(PyValueError::new_err(format!("lookup is \"linear\" or \"nearest\", not {lookup:?}"))),
    }
}

fn read_pruned(pruned: &str) -> PyResult<PrunedPolicy> {
    match pruned {
        "refuse" => Ok(PrunedPolicy::Refuse),
        "coarse" => Ok(PrunedPolicy::Coarse),
        _ => Err(PyValueError::new_err(format!("pruned is \"refuse\" or \"coarse\", not {pruned:?}"))),
    }
}

fn read_options(cache_bytes: usize, lookup: &str, pruned: &str, limit: Option<usize>) -> PyResult<BrdfOptions> {
    let limits = limit.map_or_else(Limits::default, Limits::of_table);
    let options = BrdfOptions::new().limits(limits).cache_bytes(cache_bytes).any_axes(true);
    Ok(options.lookup(read_lookup(lookup)?).pruned(read_pruned(pruned)?))
}

/// Opens a .csbrdf file: maps it, reads and checks its header and index.
///
/// The file may be replaced by renaming another over it, but must not be written to or truncated while it is open: that
/// would end the process. Where it can happen, read the file and use csbrdf.Brdf(data).
///
/// Parameters: path: str or path object. cache_bytes, lookup, pruned, limit: as for csbrdf.Brdf.
///
/// Raises OSError (FileNotFoundError, ...) if the file cannot be opened or is a pipe, a socket or a device (read it and use
/// csbrdf.Brdf(data)), csbrdf.Error if it cannot be read.
#[pyfunction]
#[pyo3(signature = (path, cache_bytes = CACHE_BYTES, lookup = "linear", pruned = "refuse", limit = None))]
fn open(
    py: Python<'_>,
    path: PathBuf,
    cache_bytes: usize,
    lookup: &str,
    pruned: &str,
    limit: Option<usize>,
) -> PyResult<PyBrdf> {
    let options = read_options(cache_bytes, lookup, pruned, limit)?;
    detached(py, || Ok(PyBrdf(options.open(&path)?)))
}

impl PyBrdf {
    fn reader(&self) -> &Reader {
        self.0.reader()
    }

    /// The file, if it can be evaluated.
    fn directional(&self) -> PyResult<&Brdf> {
        self.0.check_directions().map_err(|e| Error::new_err(e.to_string()))?;
        Ok(&self.0)
    }

    fn channel_count(&self) -> usize {
        self.reader().grid().channels().len()
    }

    /// `[channel, axes...]`.
    fn table_shape(&self) -> Vec<usize> {
        let axes = self.reader().grid().axes().iter().map(|axis| axis.len);
        [self.channel_count()].into_iter().chain(axes).collect()
    }

    /// The axes that the file has of four that the codec pads it to.
    fn unpadded<'a, T>(&self, padded: &'a [T; 4]) -> &'a [T] {
        &padded[4 - self.reader().grid().axes().len()..]
    }

    fn place(&self, block: i64) -> PyResult<(usize, Block)> {
        let found = usize::try_from(block).ok().and_then(|b| Some((b, self.reader().partition().block(b)?)));
        let count = self.reader().block_count();
        found.ok_or_else(|| PyIndexError::new_err(format!("there is no block {block}, the file has {count}")))
    }

    /// A whole table of what `of` gives for blocks, `[channel][position]`.
    fn assemble<'py, T: Element + Copy + Default + Sync>(
        &self,
        py: Python<'py>,
        kind: &str,
        of: impl Fn(&Reader, usize) -> codec::Result<Vec<T>> + Sync,
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let reader = self.reader();
        let positions = reader.grid().positions();
        let size = positions.saturating_mul(self.channel_count());
        let limit = reader.limits().table_values;
        if size > limit {
            let (got, limit) = (size as u64, limit as u64);
            return Err(exception(py, codec::Error::LimitExceeded { what: "values of the table", got, limit }));
        }
        let table = zeros::<T>(py, &self.table_shape(), kind)?;
        {
            let mut table = table.try_readwrite()?;
            let table = table.as_slice_mut()?;
            detached(py, || {
                for number in 0..reader.block_count() {
                    let Some(place) = reader.partition().block(number) else { continue };
                    let values = of(reader, number)?;
                    let planes = values.chunks_exact(place.positions());
                    for (plane, values) in table.chunks_exact_mut(positions).zip(planes) {
                        place.scatter(reader.grid().shape(), values, plane);
                    }
                }
                Ok(())
            })?;
        }
        Ok(table)
    }
}

#[pymethods]
impl PyBrdf {
    #[new]
    #[pyo3(signature = (data, cache_bytes = CACHE_BYTES, lookup = "linear", pruned = "refuse", limit = None))]
    fn new(
        py: Python<'_>,
        data: PyBackedBytes,
        cache_bytes: usize,
        lookup: &str,
        pruned: &str,
        limit: Option<usize>,
    ) -> PyResult<PyBrdf> {
        let options = read_options(cache_bytes, lookup, pruned, limit)?;
        detached(py, || Ok(PyBrdf(options.from_bytes(Bytes::new(data))?)))
    }

    /// Number of bins along each axis, slowest first: (90, 90, 180) for MERL. Arrays of decode() have the channels in
    /// front.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.table_shape()[1..])
    }

    /// The axes, slowest first, as a tuple of csbrdf.Axis: theta_h, theta_d, phi_d for MERL.
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let axes = self.reader().grid().axes().iter().map(|&axis| Py::new(py, PyAxis(axis)));
        PyTuple::new(py, axes.collect::<PyResult<Vec<_>>>()?)
    }

    /// The channels as a tuple of csbrdf.Channel: R, G, B for MERL.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let channels = self.reader().grid().channels().iter().map(|channel| Py::new(py, PyChannel(channel.clone())));
        PyTuple::new(py, channels.collect::<PyResult<Vec<_>>>()?)
    }

    /// Number of blocks that block() can decode by themselves.
    #[getter]
    fn block_count(&self) -> usize {
        self.reader().block_count()
    }

    /// Version of the file's format: (major, minor, draft); draft 0 is final.
    #[getter]
    fn version(&self) -> (u16, u16, u16) {
        self.reader().version()
    }

    /// Whether decode(exact=True) gives the bits of the table that the file was made from.
    #[getter]
    fn lossless(&self) -> bool {
        self.reader().is_lossless()
    }

    /// Where the table comes from and how it was encoded, a new dict at every access: name, instrument, licence, authors,
    /// source_file, encoder, ...; only keys that the file has.
    ///
    /// Raises csbrdf.Error if that part of the file is damaged.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let text = detached(py, || {
            let metadata = self.reader().metadata()?;
            serde_json::to_string(&metadata).map_err(|e| codec::Error::InvalidArgument(format!("metadata: {e}")))
        })?;
        py.import("json")?.call_method1("loads", (text,))
    }

    /// The whole table: float32 [channel, axes...], BRDF values in 1/sr without the cosine. MERL: [channel, theta_h,
    /// theta_d, phi_d] of shape (3, 90, 90, 180). Entries that were not measured hold what the recovery filled in;
    /// validity() says which.
    ///
    /// With exact=True float64 in the units of the source (times channel.scale: 1/sr), bit for bit the table that the file
    /// was made from, with what marked missing entries there; only lossless files have it.
    ///
    /// Raises csbrdf.Error if a block is damaged, the table has more than 2**28 values, or source values are not in the file.
    #[pyo3(signature = (*, exact = false))]
    fn decode<'py>(&self, py: Python<'py>, exact: bool) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.table_shape();
        if exact {
            let values = detached(py, || on_threads(|| self.reader().source_table()))?;
            return Ok(array(py, values, &shape)?.into_any());
        }
        let values = detached(py, || on_threads(|| self.reader().decode_all()))?;
        Ok(array(py, values, &shape)?.into_any())
    }

    /// One block: float32 [channel, axes...] in 1/sr, and the tuple of slices that it has in an array of decode().
    ///
    /// Raises IndexError if there is no such block (0 to block_count - 1), csbrdf.Error if it is damaged.
    fn block<'py>(&self, py: Python<'py>, index: i64) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyTuple>)> {
        let (number, place) = self.place(index)?;
        let channels = self.channel_count();
        let values = detached(py, || {
            let mut values = vec![0.0; self.reader().block_values(number)?];
            self.reader().block_into(number, &mut values)?;
            Ok(values)
        })?;
        let shape: Vec<usize> = [channels].into_iter().chain(self.unpadded(&place.shape).iter().copied()).collect();
        let bounds = self.unpadded(&place.origin).iter().zip(&shape[1..]).map(|(&origin, &n)| (origin, origin + n));
        let bounds = [(0, channels)].into_iter().chain(bounds);
        let slices = bounds.map(|(from, to)| PySlice::new(py, from as isize, to as isize, 1));
        Ok((array(py, values, &shape)?, PyTuple::new(py, slices.collect::<Vec<_>>())?))
    }

    /// Which entries of decode() were measured: bool [channel, axes...].
    ///
    /// Raises csbrdf.Error as decode() does.
    fn validity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
        self.assemble(py, "?", |reader, block| reader.block_validity(block))
    }

    /// Where each entry of decode() comes from: uint8 [channel, axes...] of csbrdf.Origin's numbers.
    ///
    /// Raises csbrdf.Error as decode() does.
    fn origin<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let number = |origin: Origin| match origin {
            Origin::Sampled => 0,
            Origin::Measured => 1,
            Origin::Filled => 2,
            Origin::Impossible => 3,
        };
        self.assemble(py, "u1", |reader, block| Ok(reader.block_origin(block)?.into_iter().map(number).collect()))
    }

    /// BRDF values in 1/sr, without the cosine: float32 (..., channels) for light from wi and view to wo.
    ///
    /// Parameters: wi, wo: arrays (..., 3) that broadcast against each other, float32 or float64 (others are converted to
    /// float64). Both point away from the surface, in its frame: z along the normal, x along the tangent. Their lengths do
    /// not matter. Pairs with a direction below the horizon (z < 0), zero or not finite give 0.
    ///
    /// Values between bin centres are interpolated (lookup="linear"); blocks that are needed are decoded and kept, up to
    /// cache_bytes. Many pairs are shared out to all cores.
    ///
    /// Raises ValueError for shapes that do not fit, csbrdf.Error if a block that is needed is damaged or the axes of the
    /// file do not say how directions map to the grid.
    fn eval<'py>(
        &self,
        py: Python<'py>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let brdf = self.directional()?;
        let (wi, wo) = (Directions::new(wi, "wi")?, Directions::new(wo, "wo")?);
        let mut pairs = Pairs::new(py, ["wi", "wo"], &wi, &wo)?;
        let channels = self.channel_count();
        let values = zeros::<f32>(py, &[pairs.shape(), &[channels]].concat(), "f4")?;
        {
            let mut values = values.try_readwrite()?;
            for values in values.as_slice_mut()?.chunks_mut(channels * BATCH.min(BATCH_VALUES / channels)) {
                let (wi, wo) = pairs.copy(values.len() / channels);
                detached(py, || eval_many(brdf, &wi, &wo, values))?;
                py.check_signals()?;
            }
        }
        Ok(values)
    }

    /// What draws directions for this file: a csbrdf.Importance, made anew by every call. Decodes the file once, block
    /// after block, and keeps none of it; keep the object and use it for all draws.
    ///
    /// Blocks that were pruned from the file, unless it was opened with pruned="coarse", get few draws.
    ///
    /// Raises csbrdf.Error if a block is damaged or the axes of the file do not say how directions map to the grid.
    fn importance(&self, py: Python<'_>) -> PyResult<PyImportance> {
        let brdf = self.directional()?;
        detached(py, || Ok(PyImportance(Importance::new(brdf.reader())?)))
    }

    /// Checks every byte: all sections' checksums, and that each block decodes. Returns what is damaged, a text each; an
    /// empty list if the file is intact.
    fn verify(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        detached(py, || on_threads(|| Ok(self.reader().verify().iter().map(ToString::to_string).collect())))
    }

    fn __repr__(&self) -> String {
        let grid = self.reader().grid();
        let axes: Vec<_> = grid.axes().iter().map(|axis| format!("{} {}", axis.name.as_str(), axis.len)).collect();
        let channels = match grid.channels() {
            few if few.len() <= 4 => few.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(" "),
            many => many.len().to_string(),
        };
        format!("<csbrdf.Brdf {}; channels {channels}; {} blocks>", axes.join(" x "), self.reader().block_count())
    }
}

/// Decoder of .csbrdf files, compiled; `import csbrdf` has it all.
#[pymodule]
fn _csbrdf(module: &Bound<'_, PyModule>) -> PyResult<()> {
    prepare(module.py())?;
    watch_forks(module)?;
    module.add("Error", module.py().get_type::<Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<PyBrdf>()?;
    module.add_class::<PyAxis>()?;
    module.add_class::<PyChannel>()?;
    module.add_class::<PyImportance>()?;
    module.add_function(wrap_pyfunction!(open, module)?)
}
