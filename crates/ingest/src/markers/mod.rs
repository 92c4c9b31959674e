//! Estimates the pose of each link in each frame: assignment of markers to links (`layout`), rigid registration
//! (`rigid`), label correction (`labels`), and a test of whether the marker noise is white (`whiteness`).

pub(crate) mod labels;
pub(crate) mod layout;
pub(crate) mod rigid;
pub(crate) mod whiteness;
