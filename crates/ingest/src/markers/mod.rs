//! Estimates the pose of each link in each frame: assignment of markers to links (`layout`), weights of the
//! poses of rigid bodies (`bodies`), rigid registration (`rigid`), label correction (`labels`), and a test of whether the
//! marker noise is white (`whiteness`).

pub(crate) mod bodies;
pub(crate) mod labels;
pub(crate) mod layout;
pub(crate) mod rigid;
pub(crate) mod whiteness;
