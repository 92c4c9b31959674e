//! Processing of time series with one value per frame, NaN where missing: gap filling, smoothing, derivatives.

mod derivative;
mod gaps;
mod smooth;

pub(crate) use derivative::{WEIGHTS, derivative};
pub(crate) use gaps::fill;
pub(crate) use smooth::{
    JointSignal, THIRD, THIRD_GAIN, WINDOW_WITHOUT_GAIT, best_window, moving_average, noise,
    response, third_differences,
};
