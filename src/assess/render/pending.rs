//! Pairs of directions that wait until there are enough to look up at once.

use super::Point;
use crate::table::coords::BATCH;

/// What points are to receive from directions that are not looked up yet. Each is settled in its turn: the sums have the bits that they
/// would have one by one.
pub(super) struct Pending<const N: usize> {
    indices: Vec<usize>,
    wi: Vec<[f64; 3]>,
    wo: Vec<[f64; 3]>,
    /// Radiance that arrives, and the weight of it.
    light: Vec<([f64; 3], f64)>,
    brdfs: Vec<[[f32; 3]; N]>,
}

impl<const N: usize> Pending<N> {
    pub(super) fn new() -> Pending<N> {
        let (indices, light, brdfs) = (Vec::new(), Vec::new(), Vec::new());
        Pending { indices, wi: Vec::new(), wo: Vec::new(), light, brdfs }
    }

    /// Adds a direction of a point, and settles if there are enough.
    pub(super) fn add(
        &mut self,
        index: usize,
        wi: [f64; 3],
        radiance: [f64; 3],
        weight: f64,
        points: &mut [Point<N>],
        eval: &impl Fn(&[[f64; 3]], &[[f64; 3]], &mut [[[f32; 3]; N]]),
    ) {
        self.indices.push(index);
        self.wi.push(wi);
        self.wo.push(points[index].wo);
        self.light.push((radiance, weight));
        if self.indices.len() == BATCH {
            self.settle(points, eval);
        }
    }

    /// Looks up what waits and adds it to the points.
    pub(super) fn settle(
        &mut self,
        points: &mut [Point<N>],
        eval: &impl Fn(&[[f64; 3]], &[[f64; 3]], &mut [[[f32; 3]; N]]),
    ) {
        self.brdfs.clear();
        self.brdfs.resize(self.indices.len(), [[0.0; 3]; N]);
        eval(&self.wi, &self.wo, &mut self.brdfs);
        for ((&index, &(radiance, weight)), &brdfs) in self.indices.iter().zip(&self.light).zip(&self.brdfs) {
            points[index].add(brdfs, radiance, weight);
        }
        self.indices.clear();
        self.wi.clear();
        self.wo.clear();
        self.light.clear();
    }
}
