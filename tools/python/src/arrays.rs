//! NumPy arrays: directions in, values out.

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyTuple};

/// Directions of a caller: aligned, contiguous, in this machine's byte order.
pub enum Directions<'py> {
    /// As float32.
    Single(PyReadonlyArrayDyn<'py, f32>),
    /// As float64.
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl<'py> Directions<'py> {
    /// What NumPy makes an array of numbers of, the last axis x, y, z: float32 as it is, all else as float64.
    pub fn new(given: &Bound<'py, PyAny>, name: &str) -> PyResult<Directions<'py>> {
        let directions = match Directions::as_they_are(given)? {
            Some(directions) => directions,
            None => Directions::converted(given)?,
        };
        if directions.whole_shape().last() != Some(&3) {
            let shape = shown(given.py(), directions.whole_shape())?;
            return Err(PyValueError::new_err(format!("{name} has shape {shape}; its last axis must hold x, y, z")));
        }
        Ok(directions)
    }

    /// Arrays that need no conversion, without asking NumPy: calls for single pairs would wait for it.
    fn as_they_are(given: &Bound<'py, PyAny>) -> PyResult<Option<Directions<'py>>> {
        if let Ok(array) = given.cast::<PyArrayDyn<f32>>() {
            let array = array.try_readonly()?;
            return Ok(usable(&array).then(|| Directions::Single(array)));
        }
        if let Ok(array) = given.cast::<PyArrayDyn<f64>>() {
            let array = array.try_readonly()?;
            return Ok(usable(&array).then(|| Directions::Double(array)));
        }
        Ok(None)
    }

    fn converted(given: &Bound<'py, PyAny>) -> PyResult<Directions<'py>> {
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
            true => Directions::Single(array.cast::<PyArrayDyn<f32>>()?.try_readonly()?),
            false => Directions::Double(array.cast::<PyArrayDyn<f64>>()?.try_readonly()?),
        })
    }

    fn whole_shape(&self) -> &[usize] {
        match self {
            Directions::Single(array) => array.shape(),
            Directions::Double(array) => array.shape(),
        }
    }

    /// The shape without the axis of x, y, z.
    pub fn shape(&self) -> &[usize] {
        &self.whole_shape()[..self.whole_shape().len() - 1]
    }

    /// The directions in order.
    pub fn rows(&self) -> PyResult<Rows<'_>> {
        Ok(match self {
            Directions::Single(array) => Rows::Single(array.as_slice()?.as_chunks().0),
            Directions::Double(array) => Rows::Double(array.as_slice()?.as_chunks().0),
        })
    }
}

/// `as_slice` takes Fortran's order too, but not what is not aligned.
fn usable<T: Element>(array: &PyReadonlyArrayDyn<'_, T>) -> bool {
    array.is_c_contiguous() && array.as_slice().is_ok()
}

/// Directions in order.
#[derive(Clone, Copy)]
pub enum Rows<'a> {
    /// As float32.
    Single(&'a [[f32; 3]]),
    /// As float64.
    Double(&'a [[f64; 3]]),
}

impl Rows<'_> {
    /// One direction.
    pub fn get(self, row: usize) -> [f64; 3] {
        match self {
            Rows::Single(rows) => rows[row].map(f64::from),
            Rows::Double(rows) => rows[row],
        }
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

/// A shape as Python writes it.
pub fn shown(py: Python<'_>, shape: &[usize]) -> PyResult<String> {
    Ok(PyTuple::new(py, shape)?.repr()?.to_string())
}
