//! When a solver stops, and why it did.

/// When to stop. All tolerances are relative and do not depend on the scale of the data.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Projected gradient steps at most; each is one forward and one adjoint transform. 0 returns zeros (or the start).
    pub max_iterations: usize,
    /// Residuals up to `sigma * (1 + sigma_tolerance)` reach sigma. 0 or more; default 1e-3.
    pub sigma_tolerance: f64,
    /// Residuals up to `bp_tolerance * ||y||` count as zero: basis pursuit (sigma = 0) and the LASSO. A sigma above 0 has
    /// its own tolerance alone, down to what rounding leaves (1e-13 ||y||). Above 0; default 1e-5.
    pub bp_tolerance: f64,
    /// Relative duality gap at which a solution is optimal. Above 0. Default 1e-2, with true errors mostly far below: the
    /// bound converges later than the solution. Infinity asks for no proof: the first point that reaches sigma, or where
    /// rows are orthonormal and not few the one that `splitting` ends at, with norms mostly within 0.3 % of the optimum.
    pub gap_tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { max_iterations: 1000, sigma_tolerance: 1e-3, bp_tolerance: 1e-5, gap_tolerance: 1e-2 }
    }
}

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stop {
    /// Optimal: sigma reached (BPDN) and the duality gap within its tolerance, which may be infinite.
    Converged,
    /// Sigma reached (BPDN), but the iterations or the precision did not suffice to prove the norm optimal.
    SigmaReached,
    /// Zero is the solution: sigma >= ||y||, or tau = 0.
    ZeroIsFeasible,
    /// The residual cannot get smaller, though above sigma (or tau is not active): a least-squares solution.
    LeastSquares,
    /// Out of iterations before sigma was reached, or before the LASSO was solved.
    IterationLimit,
    /// No descent left at working precision, short of the tolerances.
    LineSearchFailed,
    /// NaN or infinity in y or from the operator, or ||y|| or a result beyond the range of f64.
    NotFinite,
}
