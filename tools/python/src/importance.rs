//! Directions drawn where a material reflects.

use codec::brdf::importance::Importance;
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::BATCH;
use crate::arrays::{Directions, Pairs, Vectors, zeros};
use crate::boundary::detached;
use crate::many::{pdf_many, sample_many};

type Doubles<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Draws directions about in proportion to BRDF times cosine, from brdf.importance(). Some 100 kB, independent of the file;
/// threads may share it.
///
/// A BRDF is reciprocal: wi may be the direction to the eye and what is drawn the one to the light, or the other way round.
/// Files over other angles than theta_h, theta_d, phi_d and phi_h are drawn from by the cosine alone.
#[pyclass(name = "Importance", module = "csbrdf", frozen)]
pub struct PyImportance(pub Importance);

#[pymethods]
impl PyImportance {
    /// Draws directions: wo, float64 (..., 3), unit vectors above the horizon, and pdf, float64 (...), their densities in
    /// 1/sr: the mean of eval(wi, wo) * wo[..., 2:] / pdf[..., None] is the albedo.
    ///
    /// Parameters: wi: array (..., 3) as for Brdf.eval(). u: array (..., 2) of numbers in [0, 1), random or of a stratified
    /// or low-discrepancy set; numbers outside go to the nearer end, NaN to 0. They broadcast against each other but for
    /// the last axis. Draws depend on wi and u alone.
    ///
    /// Rows whose wi is not above the horizon (z <= 0), zero or not finite have no draw: wo and pdf are 0 there.
    ///
    /// Raises ValueError for shapes that do not fit.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        wi: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
    ) -> PyResult<(Doubles<'py>, Doubles<'py>)> {
        let (wi, u) = (Directions::new(wi, "wi")?, Vectors::<2>::new(u, "u")?);
        let mut pairs = Pairs::new(py, ["wi", "u"], &wi, &u)?;
        let wo = zeros::<f64>(py, &[pairs.shape(), &[3]].concat(), "f8")?;
        let pdf = zeros::<f64>(py, pairs.shape(), "f8")?;
        {
            let (mut wo, mut pdf) = (wo.try_readwrite()?, pdf.try_readwrite()?);
            let rows = wo.as_slice_mut()?.as_chunks_mut().0.chunks_mut(BATCH);
            for (wo, pdf) in rows.zip(pdf.as_slice_mut()?.chunks_mut(BATCH)) {
                let (wi, u) = pairs.copy(pdf.len());
                detached(py, || sample_many(&self.0, &wi, &u, wo, pdf))?;
                py.check_signals()?;
            }
        }
        Ok((wo, pdf))
    }

    /// Densities of sample() in 1/sr, per solid angle of wo: float64 (...). Over the hemisphere of wo they integrate to 1.
    ///
    /// Parameters: wi, wo: arrays (..., 3) that broadcast against each other, as for Brdf.eval(). Pairs with a direction
    /// that is not above the horizon (z <= 0), zero or not finite give 0.
    ///
    /// Raises ValueError for shapes that do not fit.
    fn pdf<'py>(&self, py: Python<'py>, wi: &Bound<'py, PyAny>, wo: &Bound<'py, PyAny>) -> PyResult<Doubles<'py>> {
        let (wi, wo) = (Directions::new(wi, "wi")?, Directions::new(wo, "wo")?);
        let mut pairs = Pairs::new(py, ["wi", "wo"], &wi, &wo)?;
        let pdf = zeros::<f64>(py, pairs.shape(), "f8")?;
        {
            let mut pdf = pdf.try_readwrite()?;
            for pdf in pdf.as_slice_mut()?.chunks_mut(BATCH) {
                let (wi, wo) = pairs.copy(pdf.len());
                detached(py, || pdf_many(&self.0, &wi, &wo, pdf))?;
                py.check_signals()?;
            }
        }
        Ok(pdf)
    }
}
