//! NumPy arrays: rows of numbers in, values out.

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyTuple};

use crate::broadcast::Broadcast;

/// Rows of N numbers of a caller: aligned, contiguous, in this machine's byte order.
pub enum Vectors<'py, const N: usize> {
    /// As float32.
    Single(PyReadonlyArrayDyn<'py, f32>),
    /// As float64.
    Double(PyReadonlyArrayDyn<'py, f64>),
}

/// Directions: x, y, z.
pub type Directions<'py> = Vectors<'py, 3>;

impl<'py, const N: usize> Vectors<'py, N> {
    /// What NumPy makes an array of numbers of, the last axis the N of a row: float32 as it is, all else as float64.
    pub fn new(given: &Bound<'py, PyAny>, name: &str) -> PyResult<Vectors<'py, N>> {
        let vectors = match Vectors::as_they_are(given)? {
            Some(vectors) => vectors,
            None => Vectors::converted(given)?,
        };
        if vectors.whole_shape().last() != Some(&N) {
            let shape = shown(given.py(), vectors.whole_shape())?;
            let row = if N == 3 { "x, y, z".into() } else { format!("{N} numbers") };
            return Err(PyValueError::new_err(format!("{name} has shape {shape}; its last axis must hold {row}")));
        }
        Ok(vectors)
    }

    /// Arrays that need no conversion, without asking NumPy: calls for single pairs would wait for it.
    fn as_they_are(given: &Bound<'py, PyAny>) -> PyResult<Option<Vectors<'py, N>>> {
        if let Ok(array) = given.cast::<PyArrayDyn<f32>>() {
            let array = array.try_readonly()?;
            return Ok(usable(&array).then(|| Vectors::Single(array)));
        }
        if let Ok(array) = given.cast::<PyArrayDyn<f64>>() {
            let array = array.try_readonly()?;
            return Ok(usable(&array).then(|| Vectors::Double(array)));
        }
        Ok(None)
    }

    fn converted(given: &Bound<'py, PyAny>) -> PyResult<Vectors<'py, N>> {
        let py = given.py();
        let numpy = py.import("numpy")?;
        let array = numpy.call_method1("asarray", (given,))?;
        let dtype = array.getattr("dtype")?;
        let kind: String = dtype.getattr("kind")?.extract()?;
        let single = kind == "f" && dtype.getattr("itemsize")?.extract::<usize>()? == 4;
        // Refuses complex numbers, text and objects instead of dropping parts of them.
        let options = [("casting", "same_kind")].into_py_dict(py)?;
        options.set_item("copy", false)?;
        let array = array.call_method("astype", (if single { "f4" } else { "f8" },), Some(&options))?;
        let array = numpy.call_method1("require", (array, py.None(), ["C", "A"]))?;
        Ok(match single {
            true => Vectors::Single(array.cast::<PyArrayDyn<f32>>()?.try_readonly()?),
            false => Vectors::Double(array.cast::<PyArrayDyn<f64>>()?.try_readonly()?),
        })
    }

    fn whole_shape(&self) -> &[usize] {
        match self {
            Vectors::Single(array) => array.shape(),
            Vectors::Double(array) => array.shape(),
        }
    }

    /// The shape without the axis of a row's numbers.
    pub fn shape(&self) -> &[usize] {
        &self.whole_shape()[..self.whole_shape().len() - 1]
    }

    /// The rows in order.
    pub fn rows(&self) -> PyResult<Rows<'_, N>> {
        Ok(match self {
            Vectors::Single(array) => Rows::Single(array.as_slice()?.as_chunks().0),
            Vectors::Double(array) => Rows::Double(array.as_slice()?.as_chunks().0),
        })
    }
}

/// `as_slice` takes Fortran's order too, but not what is not aligned.
fn usable<T: Element>(array: &PyReadonlyArrayDyn<'_, T>) -> bool {
    array.is_c_contiguous() && array.as_slice().is_ok()
}

/// Rows in order.
#[derive(Clone, Copy)]
pub enum Rows<'a, const N: usize> {
    /// As float32.
    Single(&'a [[f32; N]]),
    /// As float64.
    Double(&'a [[f64; N]]),
}

impl<const N: usize> Rows<'_, N> {
    /// One row.
    pub fn get(self, row: usize) -> [f64; N] {
        match self {
            Rows::Single(rows) => rows[row].map(f64::from),
            Rows::Double(rows) => rows[row],
        }
    }
}

/// Rows of two arrays that broadcast against each other.
pub struct Pairs<'a, const N: usize, const M: usize> {
    walk: Broadcast,
    left: Rows<'a, N>,
    right: Rows<'a, M>,
}

impl<'a, const N: usize, const M: usize> Pairs<'a, N, M> {
    /// Pairs of the rows of two arrays of these names.
    pub fn new(
        py: Python<'_>,
        names: [&str; 2],
        left: &'a Vectors<'_, N>,
        right: &'a Vectors<'_, M>,
    ) -> PyResult<Pairs<'a, N, M>> {
        let Some(walk) = Broadcast::new([left.shape(), right.shape()]) else {
            let ([a, b], left, right) = (names, shown(py, left.shape())?, shown(py, right.shape())?);
            return Err(PyValueError::new_err(format!(
                "{a} and {b} do not broadcast against each other: {left} and {right} before the last axis"
            )));
        };
        Ok(Pairs { walk, left: left.rows()?, right: right.rows()? })
    }

    /// The common shape.
    pub fn shape(&self) -> &[usize] {
        self.walk.shape()
    }

    /// The next pairs, `count` at most, copied while the GIL keeps others from changing them.
    pub fn copy(&mut self, count: usize) -> (Vec<[f64; N]>, Vec<[f64; M]>) {
        let (left, right) = (self.left, self.right);
        self.walk.by_ref().take(count).map(|[i, o]| (left.get(i), right.get(o))).unzip()
    }
}

/// A new array of a type (NumPy's code) and shape, whose memory NumPy asks for: too much of it is a MemoryError.
pub fn zeros<'py, T: Element>(py: Python<'py>, shape: &[usize], kind: &str) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let array = py.import("numpy")?.call_method1("zeros", (PyTuple::new(py, shape)?, kind))?;
    Ok(array.cast_into::<PyArrayDyn<T>>()?)
}

/// Values as an array of this shape, not copied.
pub fn array<'py, T: Element>(py: Python<'py>, values: Vec<T>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// Has NumPy's functions found when this module is imported. By the first call that makes an array it would be too late: that
/// imports NumPy and lets other threads go on meanwhile, and a child that one of them forks would wait for ever for the end of it.
pub fn prepare(py: Python<'_>) -> PyResult<()> {
    let made = array(py, vec![0.0f32], &[1])?;
    let made = made.into_any();
    let made = made.cast::<PyArrayDyn<f32>>()?;
    drop(made.try_readonly()?);
    drop(made.try_readwrite()?);
    made.cast::<PyArrayDyn<f64>>().err();
    array(py, vec![0.0f64], &[1])?;
    array(py, vec![0u8], &[1])?;
    array(py, vec![false], &[1])?;
    Ok(())
}

/// A shape as Python writes it.
pub fn shown(py: Python<'_>, shape: &[usize]) -> PyResult<String> {
    Ok(PyTuple::new(py, shape)?.repr()?.to_string())
}
