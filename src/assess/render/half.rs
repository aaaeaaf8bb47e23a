//! Half vectors dense around the normal, as the bins of theta_h are: `sin(theta_h) = u^2`, phi_h uniform.

use std::f64::consts::PI;

/// The half vector of `u` in (0, 1) and the azimuth `phi`, in the frame of the surface.
pub(super) fn vector(u: f64, phi: f64) -> [f64; 3] {
    let (sin, cos) = (u * u, (1.0 - u * u * u * u).max(0.0).sqrt());
    let (sin_phi, cos_phi) = phi.sin_cos();
    [sin * cos_phi, sin * sin_phi, cos]
}

/// The mirror image of `wo` in a half vector, and the cosine of theta_d.
pub(super) fn reflect(half: [f64; 3], wo: [f64; 3]) -> ([f64; 3], f64) {
    let along = half[0] * wo[0] + half[1] * wo[1] + half[2] * wo[2];
    (std::array::from_fn(|k| 2.0 * along * half[k] - wo[k]), along)
}

/// Density per sr of the mirror images, `d(wi) = 4 cos(theta_d) d(h)`.
pub(super) fn density(half: [f64; 3], cos_theta_d: f64) -> f64 {
    let sin = (half[0] * half[0] + half[1] * half[1]).sqrt();
    // Infinite at the normal itself, where the weight becomes 0.
    half[2] / (4.0 * PI * sin * sin.sqrt()) / (4.0 * cos_theta_d)
}

/// [`density`] at the direction `wi`.
pub(super) fn density_of(wi: [f64; 3], wo: [f64; 3]) -> f64 {
    let half: [f64; 3] = std::array::from_fn(|k| wi[k] + wo[k]);
    let length = (half[0] * half[0] + half[1] * half[1] + half[2] * half[2]).sqrt();
    density(half.map(|c| c / length), length / 2.0)
}
