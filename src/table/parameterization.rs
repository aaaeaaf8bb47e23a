//! What the axes of a grid mean: pairs of directions to and from grid coordinates, and what the others ask of it.
//!
//! A parameterization is a file of the folder beside this one and a word in the list below. It is resolved once, when a
//! file or table is opened, and may keep tables of its own: a look-up then branches on the kind, nothing more.

mod half_difference;
mod mixed;
mod spherical;

pub(crate) use half_difference::HalfDifference;
use mixed::Mixed;
use spherical::Spherical;

use crate::base::error::{Error, Result};
use crate::table::coords::{Batch, closes};
use crate::table::grid::{Axis, Grid};

/// How pairs of directions map to the coordinates of a [`Grid`], and back.
///
/// Directions are vectors `[x, y, z]` away from the surface, z along its normal, x along its tangent. Coordinates are
/// counted in bins, `0..=len` an axis; bin `i` is centred at `i + 0.5`. There are four, with 0.5 in front for axes that the
/// grid does not have, as in [`Grid::shape`].
///
/// ```
/// use csbrdf::{Grid, Parameterization};
///
/// let merl = Parameterization::of(&Grid::merl())?;
/// let [_, theta_h, ..] = merl.coordinates([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]).unwrap();
/// assert_eq!(theta_h, 0.0); // a mirror's pair
/// assert!(merl.folds_by_reciprocity() && merl.is_below_horizon([0.5, 89.5, 89.5, 0.5]));
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Parameterization {
    kind: Kind,
}

/// What a parameterization answers. Axes are numbered as in the grid, coordinates are padded.
trait Angles {
    /// What it is, for people.
    fn name(&self) -> &'static str;

    /// The axes of its grid.
    fn axes(&self) -> &[Axis];

    /// The period of an axis whose first and last bins are neighbours.
    fn period(&self, axis: usize) -> Option<f64> {
        self.axes().get(axis).filter(|axis| closes(axis)).map(|axis| axis.end - axis.start)
    }

    /// Where a pair falls; `None` where it has no place.
    fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]>;

    /// The same of pair `i` of a batch; only of those that say that they take batches.
    fn batch_coordinates(&self, batch: &Batch, i: usize, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        let _ = (batch, i);
        self.coordinates(wi, wo)
    }

    /// Whether the angles of a [`Batch`] are all that it takes.
    fn takes_batches(&self) -> bool {
        false
    }

    /// A pair of unit directions at coordinates, be they above the horizon or not; `None` where none is known.
    fn directions(&self, coordinates: [f64; 4]) -> Option<([f64; 3], [f64; 3])>;

    /// Whether turning the surface changes no coordinate.
    fn is_isotropic(&self) -> bool;

    /// Whether exchanging the directions changes no coordinate.
    fn folds_by_reciprocity(&self) -> bool {
        false
    }

    /// The half and difference angles, if it is over these.
    fn half_difference(&self) -> Option<&HalfDifference> {
        None
    }
}

/// The list: what a grid's axes are is asked in this order.
macro_rules! kinds {
    ($($kind:ident),*) => {
        #[derive(Clone, Debug, PartialEq)]
        enum Kind { $($kind($kind)),* }

        impl Kind {
            fn of(grid: &Grid) -> Option<Kind> {
                None$(.or_else(|| $kind::of(grid).map(Kind::$kind)))*
            }

            /// What is not asked for every look-up.
            fn angles(&self) -> &dyn Angles {
                match self { $(Kind::$kind(kind) => kind),* }
            }

            #[inline]
            fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
                match self { $(Kind::$kind(kind) => kind.coordinates(wi, wo)),* }
            }

            #[inline]
            fn batch_coordinates(&self, batch: &Batch, i: usize, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
                match self { $(Kind::$kind(kind) => kind.batch_coordinates(batch, i, wi, wo)),* }
            }
        }
    };
}

kinds!(HalfDifference, Spherical, Mixed);

impl Parameterization {
    /// What the axes of a grid are: any of theta_h, phi_h, theta_d, phi_d (half and difference angles), or any of theta_i,
    /// phi_i, theta_o, phi_o (elevations and azimuths of the two directions). Axes of both kinds may be mixed: then pairs
    /// have coordinates, but coordinates no pair.
    ///
    /// # Errors
    /// `InvalidArgument`, with the names of the axes, if one of them has no angular meaning ([`AxisName::Other`](crate::AxisName::Other)).
    pub fn of(grid: &Grid) -> Result<Parameterization> {
        let kind = Kind::of(grid).ok_or_else(|| no_directions(grid))?;
        Ok(Parameterization { kind })
    }

    /// A name for people, such as "half and difference angles".
    pub fn name(&self) -> &'static str {
        self.kind.angles().name()
    }

    /// Where a pair of directions falls; they need not have unit length.
    ///
    /// A grid with only one of phi_i and phi_o is isotropic: that axis is the azimuth difference to the other direction,
    /// folded by mirror symmetry where the axis covers only half a turn. A phi_d axis that covers pi is folded by
    /// reciprocity. Elevations beyond the ends of their axis go to its end.
    ///
    /// `None` if a direction is zero, not finite or below the horizon (`z < 0`), if the two are opposite, and for an
    /// azimuth outside an axis that covers only a part of the turn.
    #[inline]
    pub fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        self.kind.coordinates(wi, wo)
    }

    /// Coordinates of pair `i` of a batch, the same bits.
    #[inline]
    pub(crate) fn batch_coordinates(
        &self,
        batch: &Batch,
        i: usize,
        wi: [f64; 3],
        wo: [f64; 3],
    ) -> Option<[f64; 4]> {
        self.kind.batch_coordinates(batch, i, wi, wo)
    }

    /// Whether a batch saves work.
    pub(crate) fn takes_batches(&self) -> bool {
        self.kind.angles().takes_batches()
    }

    /// A pair of unit directions `(wi, wo)` at coordinates: [`Parameterization::coordinates`] leads back there if both are
    /// above the horizon, `z` is negative where one is below it.
    ///
    /// What the axes leave open is chosen so that the pair is as far from the horizon as it can be: azimuths of 0, phi_d of
    /// a quarter turn, elevations of 0. `None` if the axes do not fix a pair.
    pub fn directions(&self, coordinates: [f64; 4]) -> Option<([f64; 3], [f64; 3])> {
        self.kind.angles().directions(coordinates)
    }

    /// Whether one of the directions at coordinates is below the horizon; false where that is not known.
    pub fn is_below_horizon(&self, coordinates: [f64; 4]) -> bool {
        self.directions(coordinates).is_some_and(|(wi, wo)| wi[2] < 0.0 || wo[2] < 0.0)
    }

    /// The period of an axis (number in the grid) whose first and last bins are neighbours, radians; `None` for others, and
    /// if there is no such axis. It is the whole turn, or half of it for a phi_d that reciprocity folds.
    pub fn period(&self, axis: usize) -> Option<f64> {
        self.kind.angles().period(axis)
    }

    /// Whether exchanging light and view never changes the coordinates: phi_d covers half a turn, or there is none.
    pub fn folds_by_reciprocity(&self) -> bool {
        self.kind.angles().folds_by_reciprocity()
    }

    /// Whether turning the surface about its normal never changes the coordinates.
    pub fn is_isotropic(&self) -> bool {
        self.kind.angles().is_isotropic()
    }

    /// The half and difference angles of the axes, if they are these.
    pub(crate) fn half_difference(&self) -> Option<&HalfDifference> {
        self.kind.angles().half_difference()
    }

    /// The axes over which the elevations of both directions are known from sines and cosines of the bins, as the horizon and
    /// the trend of the encoder need: theta_h, theta_d, phi_d. Other axes of the grid may mean anything.
    pub(crate) fn elevation_axes(grid: &Grid) -> Option<[usize; 3]> {
        half_difference::elevation_axes(grid)
    }

    /// The same of a grid that has these axes in this order and no others: the grazing profile is defined over these (spec
    /// section 4.10), and plans are drawn over them.
    pub(crate) fn grazing_axes(grid: &Grid) -> Option<[usize; 3]> {
        Parameterization::elevation_axes(grid).filter(|axes| *axes == [0, 1, 2] && grid.axes().len() == 3)
    }
}

/// The error of a grid whose axes are no parameterization.
#[cold]
pub(crate) fn no_directions(grid: &Grid) -> Error {
    let names: Vec<_> = grid.axes().iter().map(|axis| axis.name.as_str()).collect();
    Error::InvalidArgument(format!("axes {names:?} do not say how directions map to the grid"))
}

/// Coordinates of one pair on a grid: for many, keep the [`Parameterization`].
pub fn grid_coordinates(grid: &Grid, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
    Parameterization::of(grid).ok()?.coordinates(wi, wo)
}

#[cfg(test)]
mod tests;
