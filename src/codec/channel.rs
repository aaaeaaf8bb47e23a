//! Channel transform: what the colour channels share is coded once (spec section 4.1).

#[cfg(feature = "encode")]
use crate::base::real::Real;

/// A transform over the channels of each position, in the log domain.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ChannelTransform {
    /// Channels as they are.
    None,
    /// Orthonormal matrix, `[component][channel]`: component = sum over channels of entry * log value.
    Matrix(Vec<f32>),
}

/// Most channels that a matrix may mix.
pub const MAX_MATRIX_CHANNELS: usize = 16;

impl ChannelTransform {
    /// Mean, red minus blue, and green minus the two: the orthonormal opponent transform of three channels.
    pub fn opponent() -> ChannelTransform {
        let [a, b, c] = [1.0 / 3f64.sqrt(), 1.0 / 2f64.sqrt(), 1.0 / 6f64.sqrt()].map(|x| x as f32);
        ChannelTransform::Matrix(vec![a, a, a, b, 0.0, -b, c, -2.0 * c, c])
    }

    /// Log values to components, in place: `planes[channel][position]`.
    #[cfg(feature = "encode")]
    pub(crate) fn forward<T: Real>(&self, planes: &mut [T], channels: usize) {
        let ChannelTransform::Matrix(matrix) = self else { return };
        let n = planes.len() / channels;
        if channels == 3 {
            return mix_three(planes, |t, c| matrix[3 * t + c]);
        }
        let mut values = vec![T::zero(); channels];
        for i in 0..n {
            for (c, value) in values.iter_mut().enumerate() {
                *value = planes[c * n + i];
            }
            for (t, row) in matrix.chunks_exact(channels).enumerate() {
                let products = row.iter().zip(&values).map(|(m, v)| T::of(f64::from(*m)) * *v);
                planes[t * n + i] = products.fold(T::zero(), |sum, product| sum + product);
            }
        }
    }

    /// Components to log values, in place, each the sum over components in ascending order.
    #[inline(always)]
    pub(crate) fn inverse(&self, planes: &mut [f32], channels: usize) {
        let ChannelTransform::Matrix(matrix) = self else { return };
        let n = planes.len() / channels;
        if channels == 3 {
            // The common case, laid out so that it vectorises; the same sums in the same order.
            let (first, rest) = planes.split_at_mut(n);
            let (second, third) = rest.split_at_mut(n);
            let m: [f32; 9] = std::array::from_fn(|i| matrix[i]);
            for ((a, b), c) in first.iter_mut().zip(second).zip(third) {
                let [x, y, z] = [*a, *b, *c];
                *a = (x * m[0] + y * m[3]) + z * m[6];
                *b = (x * m[1] + y * m[4]) + z * m[7];
                *c = (x * m[2] + y * m[5]) + z * m[8];
            }
            return;
        }
        let mut components = [0f32; MAX_MATRIX_CHANNELS];
        for i in 0..n {
            for (t, component) in components[..channels].iter_mut().enumerate() {
                *component = planes[t * n + i];
            }
            for c in 0..channels {
                let mut sum = components[0] * matrix[c];
                for t in 1..channels {
                    sum += components[t] * matrix[t * channels + c];
                }
                planes[c * n + i] = sum;
            }
        }
    }
}

/// Three planes, each replaced by the sum over all of them times `entry(new, old)`; laid out so that it vectorises.
#[cfg(feature = "encode")]
fn mix_three<T: Real>(planes: &mut [T], entry: impl Fn(usize, usize) -> f32) {
    let (first, rest) = planes.split_at_mut(planes.len() / 3);
    let (second, third) = rest.split_at_mut(first.len());
    let m: [[T; 3]; 3] = std::array::from_fn(|new| std::array::from_fn(|old| T::of(entry(new, old).into())));
    for ((a, b), c) in first.iter_mut().zip(second).zip(third) {
        let x = [*a, *b, *c];
        let sum = |row: &[T; 3]| x[0] * row[0] + x[1] * row[1] + x[2] * row[2];
        (*a, *b, *c) = (sum(&m[0]), sum(&m[1]), sum(&m[2]));
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_forward() {
        let opponent = ChannelTransform::opponent();
        let ChannelTransform::Matrix(three) = &opponent else { unreachable!() };
        // A four-channel orthonormal matrix: the opponent one and an untouched channel.
        let mut four = vec![0.0; 16];
        for row in 0..3 {
            four[row * 4..row * 4 + 3].copy_from_slice(&three[row * 3..row * 3 + 3]);
        }
        four[15] = 1.0;
        for (transform, channels) in
            [(opponent.clone(), 3), (ChannelTransform::Matrix(four), 4), (ChannelTransform::None, 2)]
        {
            let original: Vec<f64> = (0..channels * 5).map(|i| (i as f64 * 1.7).sin() * 5.0).collect();
            let mut planes = original.clone();
            transform.forward(&mut planes, channels);
            let energy = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
            assert!((energy(&planes) / energy(&original) - 1.0).abs() < 1e-6);
            let mut single: Vec<f32> = planes.iter().map(|&x| x as f32).collect();
            transform.inverse(&mut single, channels);
            for (a, b) in single.iter().zip(&original) {
                assert!((f64::from(*a) - b).abs() < 2e-6);
            }
        }
    }
}
