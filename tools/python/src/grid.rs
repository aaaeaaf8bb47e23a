//! Axes and channels as Python sees them.

use codec::table::grid::{Axis, Channel, Mapping};
use numpy::PyArray1;
use pyo3::prelude::*;

/// One axis of the grid: name, len, mapping, start, end. Angles are in radians.
#[pyclass(name = "Axis", module = "csbrdf", frozen, eq)]
#[derive(PartialEq)]
pub struct PyAxis(pub Axis);

#[pymethods]
impl PyAxis {
    /// What it measures: "theta_h", "phi_h", "theta_d", "phi_d" (half and difference angles), "theta_i", "phi_i",
    /// "theta_o", "phi_o" (incident and outgoing directions) or "other".
    #[getter]
    fn name(&self) -> &'static str {
        self.0.name.as_str()
    }

    /// Number of bins.
    #[getter]
    fn len(&self) -> usize {
        self.0.len
    }

    /// Spread of the bins: "linear", or "square" (angle = start + (end - start) * t**2: narrow near start).
    #[getter]
    fn mapping(&self) -> &'static str {
        match self.0.mapping {
            Mapping::Linear => "linear",
            Mapping::Square => "square",
            _ => "other",
        }
    }

    /// Angle at the lower edge of the first bin, radians.
    #[getter]
    fn start(&self) -> f64 {
        self.0.start
    }

    /// Angle at the upper edge of the last bin, radians.
    #[getter]
    fn end(&self) -> f64 {
        self.0.end
    }

    /// Angles of the bin centres, radians: float64 (len,).
    fn centers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, (0..self.0.len).map(|i| self.0.angle(i as f64 + 0.5)).collect())
    }

    /// Angles of the bin edges, radians: float64 (len + 1,).
    fn edges<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, (0..=self.0.len).map(|i| self.0.angle(i as f64)).collect())
    }

    fn __repr__(&self) -> String {
        let Axis { name, len, start, end, .. } = self.0;
        format!("Axis(name='{}', len={len}, mapping='{}', start={start}, end={end})", name.as_str(), self.mapping())
    }
}

/// One channel of the table: name, wavelength, scale.
#[pyclass(name = "Channel", module = "csbrdf", frozen, eq)]
#[derive(PartialEq)]
pub struct PyChannel(pub Channel);

#[pymethods]
impl PyChannel {
    /// "R", "G", "B", or a free name.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Centre wavelength in nanometres; None for broad-band channels such as R, G, B.
    #[getter]
    fn wavelength(&self) -> Option<f64> {
        self.0.wavelength
    }

    /// Factor from the units of the source to 1/sr (MERL: 1/1500, 1.15/1500, 1.66/1500). decode() and eval() have it
    /// applied.
    #[getter]
    fn scale(&self) -> f64 {
        self.0.scale
    }

    fn __repr__(&self) -> String {
        let wavelength = self.0.wavelength.map_or("None".into(), |w| w.to_string());
        format!("Channel(name={:?}, wavelength={wavelength}, scale={})", self.0.name, self.0.scale)
    }
}
